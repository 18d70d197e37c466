"""Landmarks as the page, the store and the command line state them: metres, clock hours, shares."""

from __future__ import annotations

import math
from typing import Any

from estimators.landmarks.projection import clock_hour
from estimators.landmarks.types import Landmark

HOURS_PER_RADIAN = 6.0 / math.pi


def landmark_json(number: int, landmark: Landmark) -> dict[str, Any]:
    """One measured landmark under the number that the survey gives it. What people say of it comes on top in the store."""
    begin, end = landmark.ends_std
    return {
        "id": number,
        "class": landmark.label,
        "status": landmark.status,
        "chainage_m": round(landmark.chainage_from, 3),
        "chainage_to_m": round(landmark.chainage_to, 3),
        "clock": hour(landmark.angle_from),
        "clock_to": hour(landmark.angle_to),
        "sigma_chainage_m": round(begin, 4),
        "sigma_chainage_to_m": round(end, 4),
        "sigma_clock": round(HOURS_PER_RADIAN * math.sqrt(max(float(landmark.covariance[1, 1]), 0.0)), 3),
        "hits": landmark.hits,
        "misses": landmark.misses,
        "belief": {name: round(float(share), 4) for name, share in landmark.belief.items()},
        "marked_by_hand": False,
    }


def marked_json(number: int, label: str, chainage_m: float, sigma_m: float | None, clock: float | None) -> dict[str, Any]:
    """A landmark that the operator marked where the crawler was."""
    return {
        "id": number,
        "class": label,
        "status": "confirmed",
        "chainage_m": round(chainage_m, 3),
        "chainage_to_m": round(chainage_m, 3),
        "clock": clock,
        "clock_to": clock,
        "sigma_chainage_m": None if sigma_m is None else round(sigma_m, 4),
        "sigma_chainage_to_m": None if sigma_m is None else round(sigma_m, 4),
        "sigma_clock": None,
        "hits": 0,
        "misses": 0,
        "belief": {label: 1.0},
        "marked_by_hand": True,
    }


def hour(angle: float) -> float:
    """Clock position of an image angle to a hundredth, in (0, 12]."""
    rounded = round(clock_hour(angle), 2)
    return rounded if rounded > 0 else 12.0
