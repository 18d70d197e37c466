"""What the worker of the anomaly survey does: a glance at a pair while somebody aims, the whole inspection of a scan."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from device.anomaly.result import grey, inspect, refused
from device.anomaly.views import Views, views
from device.json_text import plain
from device.prompts import PROMPTS
from estimators.stereo.glance import Glance, glance
from estimators.stereo.rig import StereoRig

Result = dict[str, Any]

DARK, WHITE, BLURRED, SMOOTH, NEAR, LEAST_MATCHED = 25.0, 0.35, 0.42, 1.0, 0.3, 0.25
"""Where a glance begins to mean trouble; see ``estimators.stereo.glance``. In 9 real pairs the focus is 0.49 and more, the
texture 2 and more."""
ASIDE, LEAST_AROUND = 0.35, 0.6


@dataclass(frozen=True)
class Inspected:
    """One pair of a scan: its numbers or why there are none, and what is kept for the eye where it was fitted."""

    result: Result
    views: Views | None


def work(whole: bool, left: NDArray[np.uint8], right: NDArray[np.uint8], rig: StereoRig) -> Inspected | Result:
    """Run in the worker's process."""
    if not whole:
        return looked(left, right, rig)
    if float(np.percentile(grey(left)[::4, ::4], 90)) < DARK:  # a wall fitted to a few grey levels is not to be trusted
        return Inspected(refused("pair_dark", PROMPTS["pair_dark"].reason), None)
    result, findings = inspect(left, right, rig)
    if findings is None:
        seen = glance(grey(left), grey(right), rig)
        return Inspected({**result, "reason": reason_of(result["reason"], seen)}, None)
    return Inspected(plain(result), views(left, findings))


def looked(left: NDArray[np.uint8], right: NDArray[np.uint8], rig: StereoRig) -> Result:
    """The live state: {"matched", "around" (shares), "right", "down" (in radii), "radius_mm", "light", "focus", "code"}."""
    seen = glance(grey(left), grey(right), rig)
    return {
        "matched": round(seen.matched, 3),
        "around": round(seen.around, 3),
        "radius_mm": _or_none(1000 * seen.radius, 0),
        "right": _or_none(seen.aside[0], 2),
        "down": _or_none(seen.aside[1], 2),
        "light": round(seen.light),
        "focus": round(seen.focus, 2),
        "code": trouble(seen),
    }


def trouble(seen: Glance) -> str | None:
    """The code of what has to be mended before a scan is worth it; None where nothing has to be."""
    if seen.light < DARK:
        return "pair_dark"
    if seen.white > WHITE:
        return "pair_bright"
    if seen.focus < BLURRED:
        return "pair_blurred"
    if seen.near > NEAR:
        return "pair_near"
    if seen.texture < SMOOTH:
        return "pair_too_smooth"
    if seen.matched < LEAST_MATCHED:
        return "pair_no_match"
    if seen.around < LEAST_AROUND:
        return "pair_one_sided" if seen.around > 0.2 else "pair_no_wall"
    if np.hypot(*seen.aside) > ASIDE:
        return "pair_aside"
    return None


def reason_of(refusal: str, seen: Glance) -> str:
    """The code of a refused pair: what the glance tells is nearer to the cause than where the fit gave up."""
    cause = trouble(seen)
    return cause if cause in ("pair_dark", "pair_bright", "pair_blurred", "pair_near") else f"pair_{refusal}"


def _or_none(value: float, digits: int) -> float | None:
    return None if np.isnan(value) else round(float(value), digits)
