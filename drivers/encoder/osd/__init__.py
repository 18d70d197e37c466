"""The distance burned into a video as an encoder: reader (OCR), filter, and the encoder made of both.

Use: ``require_distance(first_frames, reader)``; live ``OsdEncoder(reader)``, ``feed(frame)``, ``read()``; for a whole recording
``read_series(frames, reader)``. Raises SensorMissing where the extra ``osd`` is not installed.
"""

from __future__ import annotations

from drivers.encoder.osd.encoder import NoDistance, OsdEncoder, OsdSeries, read_series, require_distance
from drivers.encoder.osd.filter import Filtered, FilterSettings, OsdFilter, Reset
from drivers.encoder.osd.reader import Box, OsdReader, OsdText

__all__ = [
    "Box",
    "FilterSettings",
    "Filtered",
    "NoDistance",
    "OsdEncoder",
    "OsdFilter",
    "OsdReader",
    "OsdSeries",
    "OsdText",
    "Reset",
    "read_series",
    "require_distance",
]
