"""Scans from successive places of one pipe, joined along its chainage: a score for each band of it, each thing told once.

The camera is taken to look to where chainages grow: scans from both ends of a pipe count from one of them, or are not joined.
Pure: what scans found and where the camera stood in, JSON-ready out.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from device.anomaly.scan import placed, same
from estimators.anomaly.pair import BAND_M

Thing = Mapping[str, Any]

_APART_M = 0.1
"""How far apart two scans may place one thing: tether and depths are wrong by some centimetres each."""
_SPREAD = 4
"""The variance of a depth grows with this power of how far off it is: its sigma is a disparity's times z^2 / (f b)."""
_UNSCANNED = 0.1
"""A band of which less was measured is a gap."""
_WELL = 0.5
"""One of which more was measured needs no second look."""


@dataclass(frozen=True)
class PlacedScan:
    """What one scan found, with a "chainage_m" (m, None where nobody said where the camera stood) and the "survey" of each
    thing; bands have "from_m" and "to_m" along the pipe and "ahead_m" of the camera."""

    regions: list[dict[str, Any]]
    joints: list[dict[str, Any]]
    bands: list[dict[str, Any]]


def placed_scan(survey: int, result: Thing, station: float | None) -> PlacedScan:
    """A RESULT of the anomaly survey ``survey`` whose camera stood at ``station`` (m)."""

    def at(ahead: float) -> float | None:
        return None if station is None else round(station + ahead, 3)

    return PlacedScan(
        [{**placed(region, station), "survey": survey, "number": number} for number, region in enumerate(result["regions"], 1)],
        [{**placed(joint, station), "survey": survey} for joint in result["joints"]],
        [
            {
                "survey": survey,
                "from_m": at(band["first_m"]),
                "to_m": at(band["last_m"]),
                "ahead_m": round((band["first_m"] + band["last_m"]) / 2, 3),
                **{key: band.get(key) for key in ("score_mm", "outward_mm", "measured", "sees_mm2")},
            }
            for band in result["bands"]
        ],
    )


def joined(scans: Sequence[PlacedScan]) -> dict[str, Any]:
    """What ``scans`` of one pipe tell together: {"from_m", "to_m", "surveys", "bands", "gaps", "regions", "joints", "next_m"}.
    "next_m" is where the camera stands next, to fill the first gap or to go on; None where no band has a place."""
    bands = joined_bands([band for scan in scans for band in scan.bands])
    seen = [band for scan in scans for band in scan.bands if band["from_m"] is not None and band["measured"] >= _WELL]
    left_out = gaps(bands)
    reach = left_out[0]["from_m"] if left_out else max((band["to_m"] for band in seen), default=None)
    near = min((band["ahead_m"] for band in seen), default=0.0) - BAND_M / 2
    return {
        "from_m": bands[0]["from_m"] if bands else None,
        "to_m": bands[-1]["to_m"] if bands else None,
        "surveys": sorted({survey for band in bands for survey in band["surveys"]}),
        "bands": bands,
        "gaps": left_out,
        "regions": joined_regions([region for scan in scans for region in scan.regions]),
        "joints": joined_joints([joint for scan in scans for joint in scan.joints]),
        "next_m": None if reach is None else round(reach - near, 2),
    }


def joined_regions(regions: Sequence[Thing]) -> list[dict[str, Any]]:
    """Each region once, as the scan that saw most of it did (a nearer one may have seen an end of it), in the order of their
    places; "seen_from" are the surveys that saw it. Those without a place come last, as they are."""

    def alike(one: Thing, other: Thing) -> bool:
        return same(_along(one), _along(other), _APART_M)

    return _once(sorted(regions, key=lambda one: -one["area_mm2"]), alike)


def joined_joints(joints: Sequence[Thing]) -> list[dict[str, Any]]:
    """Joints likewise, as the scan that was nearest saw them."""
    return _once(
        sorted(joints, key=lambda one: one["z_m"]), lambda one, other: abs(one["chainage_m"] - other["chainage_m"]) <= _APART_M
    )


def joined_bands(bands: Sequence[Thing]) -> list[dict[str, Any]]:
    """One row of bands, BAND_M (m) each, over all that was scanned: means weighted by the wall measured and the inverse
    variance of its depths. {"from_m", "to_m", "score_mm", "outward_mm", "measured", "sees_mm2", "surveys"}; both scores are
    None where no scan tells them, and a band that none reaches was measured to 0. Bands without a place are left out."""
    placed = [band for band in bands if band["from_m"] is not None]
    if not placed:
        return []
    first = int(np.floor(round(min(band["from_m"] for band in placed) / BAND_M, 6)))
    last = int(np.ceil(round(max(band["to_m"] for band in placed) / BAND_M, 6)))
    return [_band(placed, round(k * BAND_M, 3), round((k + 1) * BAND_M, 3)) for k in range(first, last)]


def gaps(bands: Sequence[Thing]) -> list[dict[str, float]]:
    """The stretches {"from_m", "to_m"} between joined ``bands`` that no scan measured."""
    seen = [k for k, band in enumerate(bands) if band["measured"] >= _UNSCANNED]
    return [
        {"from_m": bands[before]["to_m"], "to_m": bands[after]["from_m"]}
        for before, after in pairwise(seen)
        if after > before + 1
    ]


def _band(bands: Sequence[Thing], first: float, last: float) -> dict[str, Any]:
    """What ``bands`` tell of the pipe between two chainages."""
    parts = [(band, min(band["to_m"], last) - max(band["from_m"], first)) for band in bands]
    parts = [(band, overlap) for band, overlap in parts if overlap > 1e-6 and band["measured"] > 0]
    weights = [overlap * band["measured"] / max(band["ahead_m"], BAND_M) ** _SPREAD for band, overlap in parts]

    def mean(key: str) -> float | None:
        told = [(weight, band[key]) for weight, (band, _) in zip(weights, parts, strict=True) if band[key] is not None]
        return round(sum(w * value for w, value in told) / sum(w for w, _ in told), 3) if told else None

    heaviest = max(zip(weights, parts, strict=True), key=lambda one: one[0])[1][0] if parts else None
    return {
        "from_m": first,
        "to_m": last,
        "score_mm": mean("score_mm"),
        "outward_mm": mean("outward_mm"),
        "measured": round(max((overlap / (last - first) * band["measured"] for band, overlap in parts), default=0.0), 3),
        "sees_mm2": None if heaviest is None else heaviest["sees_mm2"],
        "surveys": sorted({band["survey"] for band, _ in parts}),
    }


def _once(things: Sequence[Thing], alike: Callable[[Thing, Thing], bool]) -> list[dict[str, Any]]:
    """Each of ``things``, the best sighting first, once: what another scan has too is that."""
    kept: list[dict[str, Any]] = []
    for thing in (one for one in things if one["chainage_m"] is not None):
        known = next((one for one in kept if one["survey"] != thing["survey"] and alike(one, thing)), None)
        if known is None:
            kept.append({**thing, "seen_from": [thing["survey"]]})
        elif thing["survey"] not in known["seen_from"]:
            known["seen_from"].append(thing["survey"])
    unplaced = [{**one, "seen_from": [one["survey"]]} for one in things if one["chainage_m"] is None]
    return sorted(kept, key=lambda one: one["chainage_m"]) + unplaced


def _along(region: Thing) -> dict[str, Any]:
    """``region`` with its ends along the pipe instead of ahead of the camera."""
    station = region["chainage_m"] - region["z_m"]
    return {**region, "from_m": station + region["from_m"], "to_m": station + region["to_m"]}
