"""The boards that cameras are calibrated with: a chessboard, or a ChArUco board, whose parts are known by their markers."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

KINDS = ("charuco", "chessboard")
_MARKER = 0.74
"""Side of a marker as a share of its square."""
_DICTIONARIES = {
    50: cv2.aruco.DICT_5X5_50,
    100: cv2.aruco.DICT_5X5_100,
    250: cv2.aruco.DICT_5X5_250,
    1000: cv2.aruco.DICT_5X5_1000,
}
"""By how many markers they have. Each begins with those of the one before; a smaller one is searched faster."""
_PROFILE = 0.35
"""How much of a square's side about each corner its sharpness is read from."""


@dataclass(frozen=True)
class Sighting:
    """What one camera saw of a board: ``ids`` (N,) of its inner corners, ``pixels`` (N, 2), and how blurred the edges about
    them are: the standard deviation (px) of the blur."""

    ids: NDArray[np.int64]
    pixels: NDArray[np.float64]
    blur_px: float


@dataclass(frozen=True)
class Board:
    """A board of ``columns`` by ``rows`` squares, each ``square_m`` wide. Raises ValueError for one that cannot be used."""

    kind: str = "charuco"
    columns: int = 9
    rows: int = 6
    square_m: float = 0.03

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise ValueError(f"a board is one of {', '.join(KINDS)}, got {self.kind}")
        if not (4 <= self.columns <= 40 and 4 <= self.rows <= 40):
            raise ValueError(f"a board has 4 to 40 squares each way, got {self.columns} x {self.rows}")
        if not 0.002 <= self.square_m <= 0.5:
            raise ValueError(f"squares are 2 to 500 mm wide, got {1000 * self.square_m:g} mm")

    @property
    def name(self) -> str:
        """As it is written into a calibration."""
        return f"{self.kind} {self.columns} x {self.rows}, {1000 * self.square_m:g} mm"

    @property
    def corners(self) -> int:
        """How many inner corners it has."""
        return (self.columns - 1) * (self.rows - 1)

    @property
    def points(self) -> NDArray[np.float64]:
        """(N, 3) of the inner corners on the board (m), row by row."""
        x, y = np.meshgrid(np.arange(1, self.columns), np.arange(1, self.rows))
        return np.asarray(self.square_m * np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1), dtype=np.float64)

    def find(self, grey: NDArray[np.uint8]) -> Sighting | None:
        """What a picture (H, W) shows of it, None where nothing can be told."""
        found = self._by_markers(grey) if self.kind == "charuco" else self._whole(grey)
        if found is None:
            return None
        ids, pixels = found
        spacing = self._spacing(ids, pixels)
        if not np.isfinite(spacing) or spacing < 4:
            return None
        return Sighting(ids, pixels, edge_blur(grey, pixels, _PROFILE * spacing))

    def picture(self, square_px: int) -> NDArray[np.uint8]:
        """The board as it is printed, (rows, columns) squares of ``square_px`` pixels, without a margin."""
        if self.kind == "charuco":
            drawn = self._charuco().generateImage((self.columns * square_px, self.rows * square_px), None, 0, 1)
            return np.asarray(drawn, dtype=np.uint8)
        row, column = np.mgrid[0 : self.rows * square_px, 0 : self.columns * square_px] // square_px
        return np.where((row + column) % 2 == 0, 0, 255).astype(np.uint8)

    def _charuco(self) -> cv2.aruco.CharucoBoard:
        needed = self.columns * self.rows // 2
        dictionary = cv2.aruco.getPredefinedDictionary(next(kind for size, kind in _DICTIONARIES.items() if size >= needed))
        return cv2.aruco.CharucoBoard((self.columns, self.rows), 1.0, _MARKER, dictionary)

    def _by_markers(self, grey: NDArray[np.uint8]) -> tuple[NDArray[np.int64], NDArray[np.float64]] | None:
        corners, ids, _, _ = cv2.aruco.CharucoDetector(self._charuco()).detectBoard(grey)
        if corners is None or ids is None or len(ids) < 4:
            return None
        return np.asarray(ids, dtype=np.int64).ravel(), np.asarray(corners, dtype=np.float64).reshape(-1, 2)

    def _whole(self, grey: NDArray[np.uint8]) -> tuple[NDArray[np.int64], NDArray[np.float64]] | None:
        size = (self.columns - 1, self.rows - 1)
        found, corners = cv2.findChessboardCornersSB(grey, size, flags=cv2.CALIB_CB_ACCURACY | cv2.CALIB_CB_NORMALIZE_IMAGE)
        if not found:
            return None
        return np.arange(self.corners), np.asarray(corners, dtype=np.float64).reshape(-1, 2)

    def _spacing(self, ids: NDArray[np.int64], pixels: NDArray[np.float64]) -> float:
        """Pixels between neighbouring corners, the median; nan where no two are neighbours."""
        place = {int(number): index for index, number in enumerate(ids)}
        steps = [
            float(np.linalg.norm(pixels[place[number + 1]] - pixels[index]))
            for number, index in place.items()
            if number + 1 in place and (number + 1) % (self.columns - 1)
        ]
        return float(np.median(steps)) if steps else float("nan")


def edge_blur(grey: NDArray[np.uint8], pixels: NDArray[np.float64], reach: float) -> float:
    """Standard deviation (px) of the blur of the edges that meet in each corner, the median over the corners.

    An ideal edge between a and b blurred by a Gaussian has its steepest slope |b - a| / (sigma sqrt(2 pi)).
    """
    reach_px = int(np.clip(round(reach), 3, 40))
    slope = np.hypot(*(cv2.Sobel(grey, cv2.CV_32F, *order, ksize=3, scale=1 / 8) for order in ((1, 0), (0, 1))))
    found = []
    for u, v in np.round(pixels).astype(int):
        window = np.s_[max(v - reach_px, 0) : v + reach_px + 1, max(u - reach_px, 0) : u + reach_px + 1]
        dark, bright = np.percentile(grey[window], (5, 95))
        steepest = float(np.percentile(slope[window], 98))
        if bright - dark > 10 and steepest > 0:
            found.append((bright - dark) / (steepest * np.sqrt(2 * np.pi)))
    return float(np.median(found)) if found else float("inf")


def as_seen_by_both(left: Sighting, right: Sighting) -> Sighting:
    """``right`` with its corners counted from the same end as ``left``: a whole chessboard looks the same upside down, two
    cameras side by side do not stand on each other's heads."""
    common, in_left, in_right = np.intersect1d(left.ids, right.ids, return_indices=True)
    if len(common) < 2:
        return right
    along = [pixels[-1] - pixels[0] for pixels in (left.pixels[in_left], right.pixels[in_right])]
    if float(along[0] @ along[1]) >= 0:
        return right
    return Sighting(right.ids, right.pixels[::-1].copy(), right.blur_px)
