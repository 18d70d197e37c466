"""Drawings of the anomaly survey for the report: the unrolled wall with its axes, and the score along the pipe."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from typing import Any

from reportlab.graphics.shapes import Drawing, Image, Line, Rect, String
from reportlab.lib import colors
from reportlab.lib.units import mm

from device.inspections.model import AnomalySheet

_INK, _GREY = colors.HexColor("#12333f"), colors.HexColor("#5b6b72")
_IN, _OUT, _UNSURE = colors.HexColor("#c01818"), colors.HexColor("#1266c8"), colors.HexColor("#dfe5e8")
_LEFT, _FOOT = 10 * mm, 9 * mm
_LEAST_MM = 1.0
"""The score's scale never shows less than this: noise must not look like a finding."""


def wall_drawing(sheet: AnomalySheet, jpeg: bytes, regions: Sequence[Mapping[str, Any]], width: float) -> Drawing:
    """The unrolled wall, cut open at the invert, near at the bottom; stations at the left where they are known."""
    from PIL import Image as Picture

    height = 0.62 * width
    drawing = Drawing(width, height + _FOOT)
    inner, tall = width - _LEFT, height - 2 * mm
    drawing.add(Image(_LEFT, _FOOT, inner, tall, Picture.open(io.BytesIO(jpeg)).convert("RGB")))
    drawing.add(Rect(_LEFT, _FOOT, inner, tall, fillColor=None, strokeColor=_GREY, strokeWidth=0.5))
    for clock, share in ((6, 0.0), (9, 0.25), (12, 0.5), (3, 0.75), (6, 1.0)):
        drawing.add(_text(_LEFT + share * inner, _FOOT - 9, str(clock)))
    near, far = sheet.near or 0.0, sheet.far or 1.0
    for share in (0.0, 0.5, 1.0):
        metres = (sheet.station or 0.0) + near + share * (far - near)
        drawing.add(_text(_LEFT - 2, _FOOT + share * (tall - 7), f"{metres:.2f}", "end"))
    for region in regions:
        x = _LEFT + ((float(region["clock"]) - 6) % 12) / 12 * inner
        y = _FOOT + (float(region["z_m"]) - near) / max(far - near, 1e-6) * tall
        drawing.add(Rect(x - 5, y - 5, 10, 10, rx=5, ry=5, fillColor=_INK, strokeColor=colors.white, strokeWidth=0.8))
        drawing.add(_text(x, y - 2.5, str(region["number"]), colour=colors.white))
    return drawing


def score_drawing(bands: Sequence[Mapping[str, Any]], words: Mapping[str, str], width: float) -> Drawing | None:
    """Mean deviation inwards (up) and outwards (down) of every band, on one scale along the pipe; pale where less than half
    was measured. None where there is no band."""
    if not bands:
        return None
    height, middle = 34 * mm, 20 * mm
    reach = 12 * mm
    first, last = min(band["from_m"] for band in bands), max(band["to_m"] for band in bands)
    most = max(_LEAST_MM, *(max(band["score_mm"] or 0.0, band["outward_mm"] or 0.0) for band in bands))
    drawing = Drawing(width, height)

    def at(metres: float) -> float:
        return float(_LEFT + (metres - first) / max(last - first, 1e-6) * (width - _LEFT))

    for band in bands:
        x, wide = at(band["from_m"]), at(band["to_m"]) - at(band["from_m"])
        if band["measured"] < 0.5:
            drawing.add(Rect(x, middle - reach, wide, 2 * reach, fillColor=_UNSURE, strokeColor=None))
        inward, outward = (reach * (band[key] or 0.0) / most for key in ("score_mm", "outward_mm"))
        drawing.add(Rect(x, middle, wide, inward, fillColor=_IN, strokeColor=colors.white, strokeWidth=0.3))
        drawing.add(Rect(x, middle - outward, wide, outward, fillColor=_OUT, strokeColor=colors.white, strokeWidth=0.3))
    drawing.add(Line(_LEFT, middle, width, middle, strokeColor=_GREY, strokeWidth=0.5))
    for y, text in ((middle + reach, f"{most:.1f}"), (middle, "0"), (middle - reach, f"{most:.1f}")):
        drawing.add(_text(_LEFT - 2, y - 2.5, text, "end"))
    drawing.add(_text(width, height - 3, f"{words['inwards']}, mm", "end", _IN))
    drawing.add(_text(width, 1 * mm, f"{words['outwards']}, mm", "end", _OUT))
    for share in (0.0, 0.5):
        drawing.add(_text(at(first + share * (last - first)), 1 * mm, f"{first + share * (last - first):.2f} m", "start"))
    return drawing


def _text(x: float, y: float, text: str, anchor: str = "middle", colour: colors.Color = _GREY) -> String:
    return String(x, y, text, fontSize=7, textAnchor=anchor, fillColor=colour)
