"""The focus of expansion from the rings of successive pictures, where a pipe bends at its joints.

Rings of one picture are centred on one line only if their joints are: the joint at the end of the pipe that the crawler is in
lies on that pipe's axis, the next one on the next pipe's. But while the crawler drives straight every joint stays as far beside
its way as it is: seen from t, joint j is centred at c_t + p_j rho_tj, with p_j = e_j / R for the whole of the pipe. Two joints
in two pictures tell both c and both p, however the camera pans between. What the joints at the end of the crawler's own pipe
have in common is the camera's place in the pipe: their p differ by no more than the crawler wanders.
"""

from __future__ import annotations

import bisect
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimators.rings.find import Ring
from estimators.rings.joints import JointPlace
from estimators.rings.offset import AxisView

Array = NDArray[np.float64]
OWN_STD = 0.3
"""Prior of the camera's place in the pipe, e / R."""
WANDER_STD = 0.05
"""How much further off or nearer the axis it is in one pipe than in another, in radii."""
BEND_STD = 1.5
"""A joint of another pipe may be so far beside the way, in radii."""
CENTRE_STD, SHARE_STD = 1.5, 0.01
"""A ring's centre errs by so much (px), and by this share of its radius."""
GATE = 3.0
_ROUNDS = 15


@dataclass(frozen=True)
class JointRing:
    """``ring`` in ``picture``, of joint number ``joint`` along the pipe, when the crawler had passed ``passed`` joints."""

    picture: int
    passed: int
    joint: int
    ring: Ring


def ring_centres(seen: Sequence[JointRing]) -> dict[int, AxisView]:
    """Focus of expansion of each picture, with ``lean`` of the pipe that the crawler is in, by robust least squares over all.

    Where neither driving nor another joint tells it, the centre is as unsure as ``covariance`` says.
    """
    pictures = sorted({one.picture for one in seen})
    joints = sorted({(one.passed, one.joint) for one in seen})
    if not pictures:
        return {}
    place = {picture: k for k, picture in enumerate(pictures)}
    beside = {key: len(pictures) + k for k, key in enumerate(joints)}
    own = len(pictures) + len(joints)
    radius = np.array([one.ring.radius for one in seen])
    # the axes of all rings have one ratio, that of the pixels: where a ring's have another, it was drawn beside the joint
    ratio = np.log([one.ring.across / one.ring.upright for one in seen])
    share = np.hypot(SHARE_STD, ratio - np.median(ratio))
    std = np.sqrt(CENTRE_STD**2 + np.array([one.ring.std for one in seen]) ** 2 + (share * radius) ** 2)
    centres = np.array([one.ring.centre for one in seen])
    rows = np.zeros((len(seen), own + 1))
    for k, one in enumerate(seen):
        rows[k, place[one.picture]], rows[k, beside[one.passed, one.joint]] = 1.0, radius[k]
    priors = np.zeros((len(joints) + 1, own + 1))
    priors[0, own] = 1 / OWN_STD
    for k, (passed, joint) in enumerate(joints, 1):
        column = beside[passed, joint]
        if joint == passed:
            priors[k, column], priors[k, own] = 1 / WANDER_STD, -1 / WANDER_STD
        else:
            priors[k, column] = 1 / BEND_STD
    known, state, inverse = priors.T @ priors, np.zeros((own + 1, 2)), np.zeros((own + 1, own + 1))
    weight = std**-2
    for _ in range(_ROUNDS):
        inverse = np.linalg.inv((rows * weight[:, None]).T @ rows + known)
        state = inverse @ ((rows * weight[:, None]).T @ centres)
        off = np.hypot(*(rows @ state - centres).T) / std
        weight = 1 / (std**2 * (1 + (off / GATE) ** 2))
    pipe = {one.picture: one.passed for one in seen}
    return {
        picture: AxisView(state[k], inverse[k, k] * np.eye(2), state[beside.get((pipe[picture], pipe[picture]), own)])
        for picture, k in place.items()
    }


def joint_centres(joints: Sequence[JointPlace]) -> dict[int, AxisView]:
    """The same from the joints of a drive, which come in the order of chainage: of their rings those that lie ahead count."""
    along = [joint.chainage for joint in joints]
    seen = []
    for number, joint in enumerate(joints):
        for sighting in joint.sightings:
            passed = bisect.bisect_left(along, sighting.position)
            if passed <= number:
                seen.append(JointRing(sighting.frame, passed, number, sighting.ring))
    return ring_centres(seen)
