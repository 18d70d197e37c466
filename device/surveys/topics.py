"""The topics of a survey in its recording, beside those of its sensors: what was computed of what, and what came of it."""

from __future__ import annotations

FRAMES = "/survey/frames"
"""Of a diameter survey: which frame was estimated, with what seed."""
STEPS = "/survey/steps"
"""Of a drive: which picture was mapped, after how many readings of the counter, and what was seen in it."""
NUMBERS, MARKS = "/survey/numbers", "/survey/marks"
"""Of a drive: the number that a landmark got, what somebody marked by hand."""
CHAMBER = "/chamber"
"""Of a structure survey: readings and scans in the order in which they were mapped."""
PAIRS = "/survey/pairs"
"""Of an anomaly survey: the rig that a recorded pair is read with, after its two pictures."""
ESTIMATES = "/survey/estimates"
PROMPTED = "/survey/prompts"
ENDED = "/survey/ended"
FINDINGS = "/survey/findings"
"""As they were stored; a replay is compared with them."""
