"""The distance burned into a video as an encoder: reader (OCR), filter, and the encoder made of both."""

from __future__ import annotations

from drivers.encoder.osd.reader import OsdReader, OsdText

__all__ = ["OsdReader", "OsdText"]
