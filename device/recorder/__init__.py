"""Raw data of every survey in MCAP files: written while it goes on, pruned when room is short, recovered after a power cut.

``recorder.py`` writes one survey, ``shelf.py`` holds all of them, ``reader.py`` reads them back for a replay.
"""

from device.recorder.recorder import Recorder, RecorderStatus
from device.recorder.shelf import Shelf

__all__ = ["Recorder", "RecorderStatus", "Shelf"]
