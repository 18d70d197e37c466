"""The unrolled map as a picture: chainage to the right, the clock from 6 over 12 to 6 downwards, the crown in the middle."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from device.errors import Invalid

Image = NDArray[np.uint8]
Color = tuple[int, int, int]

_LEFT, _RIGHT, _TOP, _BOTTOM = 60, 30, 40, 50
_HIGH = 360
_LEAST_WIDE, _MOST_WIDE = 640, 6000
_PX_PER_M = 60.0
_INK: Color = (40, 40, 40)
_RULE: Color = (225, 225, 225)
_JOINT: Color = (190, 160, 120)
COLORS: dict[str, Color] = {
    "connection": (190, 90, 20),
    "deposit": (30, 110, 170),
    "displaced joint": (150, 40, 150),
    "fracture": (40, 40, 210),
    "roots": (50, 130, 40),
}
_OTHER: Color = (100, 100, 100)
_STEPS_M = (0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0)


def save_map_picture(path: Path, found: dict[str, Any]) -> None:
    """Write the picture of a map (``landmarks``, ``rings``) as PNG or JPEG, as the name says. Raises Invalid."""
    if path.suffix.lower() not in (".png", ".jpg", ".jpeg"):
        raise Invalid(f"A picture of the map is a .png or .jpg file, not {path.name}.")
    written, data = cv2.imencode(path.suffix.lower(), map_picture(found["landmarks"], found["rings"]))
    try:
        path.write_bytes(data.tobytes())
    except OSError as error:
        raise Invalid(f"The picture {path} cannot be written: {error.strerror}.") from None
    assert written  # an array of bytes can always be encoded


def map_picture(landmarks: Sequence[dict[str, Any]], rings: Sequence[dict[str, Any]]) -> Image:
    """(h, w, 3) BGR of landmarks and joints with the fields of the map's JSON."""
    chainages = [row[key] for row in landmarks for key in ("chainage_m", "chainage_to_m")]
    chainages += [ring["chainage_m"] for ring in rings]
    low, high = (math.floor(min(chainages)), math.ceil(max(chainages))) if chainages else (0, 1)
    low, high = low - 1, high + 1
    wide = int(np.clip((high - low) * _PX_PER_M, _LEAST_WIDE, _MOST_WIDE))
    sheet = _Sheet(low, high, wide)
    sheet.rule()
    for ring in rings:
        sheet.joint(ring["chainage_m"])
    for row in landmarks:
        sheet.landmark(row)
    return sheet.picture


class _Sheet:
    """The paper, with where things go on it."""

    def __init__(self, low: float, high: float, wide: int) -> None:
        self._low, self._high, self._wide = low, high, wide
        self.picture: Image = np.full((_TOP + _HIGH + _BOTTOM, _LEFT + wide + _RIGHT, 3), 255, np.uint8)

    def x(self, chainage: float) -> int:
        return _LEFT + round((chainage - self._low) / (self._high - self._low) * self._wide)

    def y(self, clock: float) -> int:
        """6 o'clock at the top, 12 in the middle, 6 at the bottom: as if cut open along the invert."""
        return _TOP + round(((clock + 6.0) % 12.0) / 12.0 * _HIGH)

    def rule(self) -> None:
        step = next((step for step in _STEPS_M if step / (self._high - self._low) * self._wide >= 70), _STEPS_M[-1])
        for k in range(math.ceil(self._low / step), math.floor(self._high / step) + 1):
            x = self.x(k * step)
            cv2.line(self.picture, (x, _TOP), (x, _TOP + _HIGH), _RULE, 1)
            self._text(f"{k * step:g} m", x - 14, _TOP + _HIGH + 20)
        for share, clock in enumerate((6, 9, 12, 3, 6)):
            y = _TOP + share * _HIGH // 4
            cv2.line(self.picture, (_LEFT, y), (_LEFT + self._wide, y), _RULE, 1)
            self._text(f"{clock} h", 18, y + 4)

    def joint(self, chainage: float) -> None:
        x = self.x(chainage)
        for y in range(_TOP, _TOP + _HIGH, 10):
            cv2.line(self.picture, (x, y), (x, y + 4), _JOINT, 1)

    def landmark(self, row: dict[str, Any]) -> None:
        color = COLORS.get(row["class"], _OTHER)
        left, right = self.x(row["chainage_m"]), self.x(row["chainage_to_m"])
        if row["clock"] is None:  # marked by hand without a clock position: a line over all of them
            cv2.line(self.picture, (left, _TOP), (left, _TOP + _HIGH), color, 2)
            self._text(row["class"], left + 6, _TOP - 8, color)
            return
        around = (row["clock_to"] - row["clock"]) % 12.0
        begin, reach = (row["clock"] + 6.0) % 12.0, around / 12.0 * _HIGH
        top = _TOP + begin / 12.0 * _HIGH
        for y in (top, top - _HIGH):  # what crosses the cut shows at both edges
            y0, y1 = max(y, _TOP), min(y + reach, _TOP + _HIGH)
            if y1 >= y0 and right - left + reach > 2:
                cv2.rectangle(self.picture, (left - 2, round(y0)), (right + 2, round(y1)), color, 2)
        middle = ((left + right) // 2, self.y(row["clock"] + around / 2))
        cv2.circle(self.picture, middle, 5, color, -1, cv2.LINE_AA)
        self._text(f"{row['class']} {row['chainage_m']:.2f} m", middle[0] + 9, middle[1] - 6, color)

    def _text(self, text: str, x: int, y: int, color: Color = _INK) -> None:
        plain = text.encode("ascii", "replace").decode()
        cv2.putText(self.picture, plain, (x, y), cv2.FONT_HERSHEY_SIMPLEX, 0.42, color, 1, cv2.LINE_AA)
