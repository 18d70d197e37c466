"""The camera's place in the cross-section, from two or more rings of one picture.

A ring at depth Z is centred at c + f e / Z and has the radius f R / Z: its centre moves along a line with its radius, which at
radius 0 (1/Z = 0) is the focus of expansion c and whose slope is e / R. The paper's eq. 5 silently takes e as zero.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimators.rings.find import Ring

Array = NDArray[np.float64]
_LEVER = 1.2
"""Ratio of the largest to the smallest radius that tells a slope."""
_SLOPE_STD = 0.3
"""Prior of e / R: a camera is seldom further off the axis."""
_MOST = 0.6
"""Of e / R: what leans more are not rings of one pipe, or the camera is panned."""


@dataclass(frozen=True)
class AxisView:
    """``centre`` (2,) px of the focus of expansion with ``covariance`` (2, 2); ``lean`` (2,) = e / R, the pipe's axis as seen
    from the camera over the radius, to the right and down."""

    centre: Array
    covariance: Array
    lean: Array


def axis_view(
    rings: Sequence[Ring], centre_std: float = 1.5, foe: tuple[tuple[float, float], float] | None = None
) -> AxisView | None:
    """Centre and lean by weighted least squares over the ``rings`` of one picture; None where they do not tell a slope.

    ``centre_std`` (px) is what a ring's centre errs by beside its radius' own error. ``foe`` is the focus of expansion (px) as
    flow tells it, with its standard deviation (px): it is a ring of radius 0, and beside it one ring is enough.
    """
    if len(rings) < (2 if foe is None else 1):
        return None
    radius = np.array([ring.radius for ring in rings])
    if foe is None and radius.max() < _LEVER * radius.min():
        return None
    # the share of the error that grows with the ring: neither pipe nor lens is perfect
    std = np.sqrt(centre_std**2 + np.array([ring.std for ring in rings]) ** 2 + (0.01 * radius) ** 2)
    centres = np.array([ring.centre for ring in rings])
    if foe is not None:
        radius, std, centres = np.append(radius, 0.0), np.append(std, max(foe[1], 1e-3)), np.vstack([centres, foe[0]])
    design = np.stack([np.ones_like(radius), radius], axis=1) / std[:, None]
    information = design.T @ design + np.diag([0.0, _SLOPE_STD**-2])
    solution = np.linalg.solve(information, design.T @ (centres / std[:, None]))
    if np.hypot(*solution[1]) > _MOST:
        return None
    variance = float(np.linalg.inv(information)[0, 0])
    return AxisView(solution[0], variance * np.eye(2), solution[1])
