"""Raw data of every survey in MCAP files: written while it goes on, pruned when room is short, recovered after a power cut.

``recorder.py`` writes one survey, ``shelf.py`` holds all of them, ``reader.py`` reads them back for a replay. A survey asks the
shelf for a recorder (``shelf.begin(number, head)``), writes samples to it under topics of its own, what it consumed and found
under those of ``surveys/topics.py``, and closes it; ``device/replay/survey.py`` lists who computes which kind of survey again.
"""

from device.recorder.recorder import Recorder, RecorderStatus
from device.recorder.shelf import Shelf

__all__ = ["Recorder", "RecorderStatus", "Shelf"]
