"""From the pairs of one scan to its finding: what most of them say, and no region that one of them saw alone.

Pure: results of pairs in (``anomaly_result``), one result out.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

from device.prompts import PROMPTS

Result = dict[str, Any]

_APART_M = 0.03
_APART_HOURS = 0.5
_OTHER = "pair_no_wall"
_NO_DIAMETER: Result = {"diameter_mm": None, "interval_mm": None, "dn": None, "position": None}


def concluded(results: Sequence[Result], camera: str, chainage: float | None) -> tuple[Result, int | None]:
    """The RESULT of a scan and which pair it is of. ``chainage`` (m) is where the camera stood, None where nobody said.

    Refused where less than half of the pairs were fitted. Else the pair with the middle score speaks for all; its regions are
    those that more than half of the fitted pairs have too, the others are counted as "unconfirmed".
    """
    fitted = sorted((k for k, one in enumerate(results) if one["fitted"]), key=lambda k: (results[k]["score_mm"] or 0.0, k))
    if 2 * len(fitted) <= len(results):
        codes = Counter(_code(one["reason"]) for one in results if not one["fitted"])
        code = codes.most_common(1)[0][0] if codes else "camera_lost"
        return refused(code, camera, len(results), chainage), None
    chosen = fitted[(len(fitted) - 1) // 2]
    middle = results[chosen]
    others = [results[k] for k in fitted if k != chosen]
    regions, unconfirmed = [], 0
    for region in middle["regions"]:
        seen_in = 1 + sum(any(same(region, other) for other in one["regions"]) for one in others)
        if 2 * seen_in > len(fitted):
            regions.append({**placed(region, chainage), "seen_in": seen_in})
        else:
            unconfirmed += 1
    scores = [results[k]["score_mm"] for k in fitted if results[k]["score_mm"] is not None]
    found = {
        **middle,
        **_NO_DIAMETER,
        "verdict": "accept",
        "reasons": [],
        "prompts": [],
        "camera": camera,
        "frames": len(results),
        "pairs_fitted": len(fitted),
        "score_range_mm": [min(scores), max(scores)] if scores else None,
        "chainage_m": chainage,
        "regions": regions,
        "unconfirmed": unconfirmed,
        "joints": [placed(joint, chainage) for joint in middle["joints"]],
    }
    return found, chosen


def refused(code: str, camera: str, pairs: int, chainage: float | None) -> Result:
    """The RESULT of a scan that tells nothing, for the reason ``code`` of PROMPTS."""
    return {
        **_NO_DIAMETER,
        "fitted": False,
        "verdict": "retry",
        "reasons": [code],
        "prompts": [PROMPTS[code].to_json()],
        "camera": camera,
        "frames": pairs,
        "chainage_m": chainage,
        "score_mm": None,
        "outward_mm": None,
        "coverage": 0.0,
        "regions": [],
        "joints": [],
        "bands": [],
        "smooth": [],
    }


def same(one: Mapping[str, Any], other: Mapping[str, Any], apart_m: float = _APART_M) -> bool:
    """Whether two regions are of one thing: the same side of the wall, and no more than ``apart_m`` from each other."""
    if (one["peak_mm"] or 0) * (other["peak_mm"] or 0) <= 0:
        return False
    apart = max(one["from_m"], other["from_m"]) - min(one["to_m"], other["to_m"])
    around = abs((one["clock"] - other["clock"] + 6) % 12 - 6) - (one["width_hours"] + other["width_hours"]) / 2
    return bool(apart <= apart_m and around <= _APART_HOURS)


def placed(thing: Mapping[str, Any], chainage: float | None) -> Result:
    """``thing``, "z_m" ahead of a camera that stood at ``chainage`` (m, None where nobody said), with its "chainage_m"."""
    return {**thing, "chainage_m": None if chainage is None else round(chainage + thing["z_m"], 3)}


def _code(reason: str) -> str:
    return reason if reason in PROMPTS else _OTHER
