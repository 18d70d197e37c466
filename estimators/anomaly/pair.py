"""One pair of pictures to findings: follow the wall, measure what lies off it, score it and cut it into regions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimators.anomaly.deviation import DeviationMap, PointDeviations, deviation_map, point_deviations
from estimators.anomaly.displaced import with_displaced
from estimators.anomaly.joints import Joint, find_joints, ring_cells
from estimators.anomaly.regions import Region, anomalous_share, find_regions
from estimators.anomaly.score import BandScore, band_scores, plain_score, score, sure_score
from estimators.anomaly.seams import find_seams, with_seams
from estimators.radial_profile.shape import Shape, shape_of
from estimators.stereo.follow import FollowedWall, Refused, follow_wall
from estimators.stereo.rig import StereoRig

BAND_M = 0.1
_SEEN = 0.1
"""An angle was seen where a tenth of the band was measured."""
_FOLLOWS, _BOTH_WAYS = 0.92, 0.002
"""A wall of which less follows the best surface, and whose means beyond the noise are larger than this share of the radius both
inwards and outwards, was misread: a fit that went astray has as much on either side of it. Deposits come inwards alone, and of
lost wall little is ever seen."""


@dataclass(frozen=True)
class PairFindings:
    """What one pair tells. ``inward`` and ``outward`` (m) are eq. 18 of the RADIUS paper and its twin, which is of the share
    ``told`` of the wall; ``offset_px`` the disparity offset that the depths are by, ``offset_std_px`` how well it is known,
    ``own_offset`` whether this pair had to find it. ``plain`` and ``sure`` (m): both means with the noise in them, and
    without."""

    followed: FollowedWall
    points: PointDeviations
    map: DeviationMap
    shape: Shape
    joints: list[Joint]
    regions: list[Region]
    inward: float
    outward: float
    told: float
    bands: list[BandScore]
    anomalous: float
    offset_px: float
    offset_std_px: float
    own_offset: bool
    plain: tuple[float, float] = (float("nan"), float("nan"))
    sure: tuple[float, float] = (float("nan"), float("nan"))


def misread(share: float, sure: tuple[float, float], radius: float) -> bool:
    """Whether so small a ``share`` of the points on the wall, and such means (m) inwards and outwards, are no pipe's."""
    return share < _FOLLOWS and min(sure) > _BOTH_WAYS * radius


def inspect_pair(left: NDArray[np.uint8], right: NDArray[np.uint8], rig: StereoRig, rng: np.random.Generator) -> PairFindings:
    """Findings of a rectified grey pair (H, W). Raises ``follow.Refused``, also where the wall was misread."""
    followed = follow_wall(left, right, rig, rng)
    used = followed.wall.rig
    own = used.offset_px != rig.offset_px or rig.offset_px is None
    points = point_deviations(followed)
    found = deviation_map(followed, points)
    joints = with_seams(with_displaced(found, find_joints(found)), find_seams(left, followed.wall, found))
    left_out = ring_cells(found, joints)
    regions = find_regions(found, joints)
    sure = sure_score(found, left_out)
    if misread(followed.wall.share, sure, float(np.median(found.radius))):
        raise Refused("not_smooth")
    inward, outward, told = score(found, left_out)
    visible = followed.usable.sum(axis=0) > _SEEN * (followed.ends.last - followed.ends.first)
    return PairFindings(
        followed,
        points,
        found,
        shape_of(followed.wall, visible, followed.grid.theta),
        joints,
        regions,
        inward,
        outward,
        told,
        band_scores(found, BAND_M, left_out),
        anomalous_share(found, regions),
        float(used.offset_px or 0.0),
        used.offset_std_px,
        own,
        plain_score(found, left_out),
        sure,
    )
