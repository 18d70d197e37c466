"""The predicted wall unrolled: where each cell of angle by depth lies in the left picture, and at which disparity."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from estimators.radial_profile.fit import Wall

Floats = NDArray[np.float32]

ANGLES = 1080
ROWS = 320


@dataclass(frozen=True)
class Unrolled:
    """A grid of ``theta`` (A,) rad about the wall's axis by ``depth`` (Z,) m, near to far, on a predicted wall; other arrays
    are (Z, A). Depths grow by the same share from row to row: so cells cover about as many pixels along the pipe as around it,
    near and far, and texture keeps one scale.

    ``x``, ``y``: pixel of the left picture whose ray meets the wall there; ``u``, ``v`` that ray (X/Z, Y/Z); ``disparity`` (px)
    that it should have; ``seen`` where that pixel lies in the picture.
    """

    theta: NDArray[np.float64]
    depth: NDArray[np.float64]
    x: Floats
    y: Floats
    u: Floats
    v: Floats
    disparity: Floats
    seen: NDArray[np.bool_]

    @property
    def cell(self) -> tuple[float, float]:
        """Depth of a cell as a share of the depth it lies at (its logarithm), and its angle (rad)."""
        return float(np.log(self.depth[1] / self.depth[0])), float(self.theta[1] - self.theta[0])

    def row_of(self, depth: NDArray[np.floating]) -> NDArray[np.float64]:
        """Row, with its fraction, of depths (m) of any shape: whole at the middle of a row, far below 0 behind the camera."""
        return np.asarray(np.log(np.maximum(depth, 1e-9) / self.depth[0]) / self.cell[0], dtype=np.float64)

    @property
    def fineness(self) -> float:
        """Its cells around the pipe as a share of those of the finest grid."""
        return len(self.theta) / ANGLES

    @cached_property
    def pixels(self) -> Floats:
        """Pixels of the left picture that each cell (Z, A) covers."""
        (x_down, x_along), (y_down, y_along) = np.gradient(self.x), np.gradient(self.y)
        return np.asarray(np.abs(x_down * y_along - x_along * y_down), dtype=np.float32)


def unroll(wall: Wall, nearest: float, farthest: float, angles: int = ANGLES, rows: int = ROWS) -> Unrolled:
    """The wall from ``nearest`` to ``farthest`` (m)."""
    rig = wall.rig
    camera = rig.intrinsics
    theta: NDArray[np.float64] = (np.arange(angles, dtype=np.float64) + 0.5) * (2 * np.pi / angles) - np.pi
    depth: NDArray[np.float64] = nearest * (farthest / nearest) ** ((np.arange(rows, dtype=np.float64) + 0.5) / rows)
    constant, slope = wall.profile(theta)
    z = depth[:, None]
    radius = constant + slope * z
    middle_x, middle_y = wall.axis.at(z)
    u, v = (middle_x + radius * np.cos(theta)) / z, (middle_y + radius * np.sin(theta)) / z
    x, y = u * camera.fx + camera.ppx, v * camera.fy + camera.ppy
    margin = 3.0
    seen = (x > margin) & (x < camera.width - 1 - margin) & (y > margin) & (y < camera.height - 1 - margin) & (radius > 0)
    disparity = np.broadcast_to((rig.offset_px or 0.0) + rig.range_px_m / z, x.shape)
    single = [np.asarray(values, dtype=np.float32) for values in (x, y, u, v, disparity)]
    return Unrolled(theta, depth, single[0], single[1], single[2], single[3], single[4], np.asarray(seen, dtype=np.bool_))
