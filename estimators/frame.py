"""One depth picture to one estimate of the pipe: the pipeline of the diameter survey on one screen."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimators.cylinder import Cylinder, CylinderFit, assess, search, wall_points
from estimators.pinhole import Intrinsics
from estimators.pointcloud import OrientedPoints, oriented_points
from estimators.profile import Profile, cross_section

_TILE = 8
"""Side of a resampling block in cells: wider than the matching window of a stereo camera, so that blocks err independently."""
KEPT_SHARE = 0.7


@dataclass(frozen=True)
class FrameEstimate:
    """What one depth picture says. ``fit`` and ``profile`` are None where nothing could be fitted.

    ``resampled`` are fits to random blocks of the picture, None where one found nothing; ``valid_share`` is the share of
    pixels with a depth in the crop, ``points`` the size of the thinned cloud.
    """

    fit: CylinderFit | None
    profile: Profile | None
    valid_share: float
    points: int
    intrinsics: Intrinsics
    resampled: tuple[CylinderFit | None, ...] = ()

    @property
    def diameter(self) -> float | None:
        """Interior diameter in metres, forced: whatever the fit is worth."""
        return None if self.fit is None else 2 * self.fit.radius


def estimate_frame(
    depth: NDArray[np.uint16], intrinsics: Intrinsics, depth_unit_m: float, seed: int = 0, resamples: int = 0
) -> FrameEstimate:
    """Estimate the pipe from one depth picture (H, W) in ``depth_unit_m``.

    ``resamples`` > 0 repeats the search on that many random halves of the picture, for recordings too short to show a spread.
    """
    rng = np.random.default_rng(seed)
    cloud = oriented_points(depth, intrinsics, depth_unit_m)
    cylinder = search(cloud, rng)
    fit = None if cylinder is None else assess(cloud, cylinder)
    if cylinder is None or fit is None:
        return FrameEstimate(None, None, cloud.valid_share, len(cloud), intrinsics)
    resampled = tuple(_resampled(cloud, rng, cylinder) for _ in range(resamples))
    return FrameEstimate(fit, cross_section(cloud, fit), cloud.valid_share, len(cloud), intrinsics, resampled)


def _resampled(cloud: OrientedPoints, rng: np.random.Generator, known: Cylinder) -> CylinderFit | None:
    """A fit to a random share of the picture's blocks, searched anew with ``known`` as one candidate."""
    tile = (cloud.cells[:, 0] // _TILE) * 1000 + cloud.cells[:, 1] // _TILE
    names, index = np.unique(tile, return_inverse=True)
    kept = rng.random(len(names)) < KEPT_SHARE
    part = cloud.take(kept[index])
    found = search(part, rng, known)
    return None if found is None else assess(part, found)


def sample_cloud(
    depth: NDArray[np.uint16], intrinsics: Intrinsics, depth_unit_m: float, fit: CylinderFit | None, count: int = 3000
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """A thin cloud for the operator's eye: points (n, 3) in metres, n <= ``count``, and which of them (n,) lie on the
    cylinder."""
    cloud = oriented_points(depth, intrinsics, depth_unit_m)
    if len(cloud) > count:
        cloud = cloud.take(np.random.default_rng(0).permutation(len(cloud))[:count])
    return cloud.points, np.zeros(len(cloud), bool) if fit is None else wall_points(cloud, fit.cylinder)
