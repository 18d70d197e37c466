"""From what the surveys found to coded observations (EN 13508-2). Pure: findings in, observations out.

Only what is measured is quantified: a class that says nothing of a size gets no number, since a number that nobody measured
would be believed.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

from device.inspections.codes import of_class
from device.inspections.model import DiameterSheet, Inspection, Observation

LONG_M = 0.5
"""From this extent along the pipe on, an observation is a continuous defect with a beginning and an end."""
_OVAL_FROM = 0.05
"""Ovality from which a pipe is called deformed: below, new pipes of plastic vary as much."""
_REFUSED = ("rejected",)
LEAST_SURE = 0.5
"""Regions less sure than this are listed and not coded."""
DISPLACED_MM = 10.0
"""A joint displaced by less is not coded: pipes are laid so."""
_DEVIATIONS = {
    "deposit": ("BBC", "Z", ""),
    "intrusion": ("BBB", "Z", ""),
    "attached": ("BBB", "Z", ""),
    "object": ("BBE", "Z", ""),
    "loss": ("BAF", "Z", "Z"),
}
"""Code and characterisations of a region: on the invert, elsewhere on the wall, the same of another colour, free of it, missing
wall."""


def observations(inspection: Inspection) -> tuple[Observation, ...]:
    """Start and finish node with all that was found between them, in the order of stations and numbered."""
    length = _end(inspection)
    found = [
        *_landmarks(inspection.landmarks),
        *_deformations(inspection.diameters),
        *_regions(inspection.anomalies),
        *_displaced(inspection.joints),
    ]
    inside = [one for one in found if 0 <= one.station <= length + 1e-9]
    start = Observation(0.0, "BCD", remark=inspection.start.name)
    end = Observation(length, "BCE", remark=inspection.end.name)
    if inspection.pipe.length is not None and length < inspection.pipe.length - 0.5:
        end = Observation(length, "BDC", remark=f"of {inspection.pipe.length:.2f} m")
    return numbered([start, *inside, end])


def numbered(found: Iterable[Observation]) -> tuple[Observation, ...]:
    """In the order of stations, start first and finish last, numbered from 1; the ends of continuous defects keep theirs."""
    rank = {"BCD": 0, "BCE": 2, "BDC": 2}
    ordered = sorted(found, key=lambda one: (rank.get(one.code, 1), one.station, one.continuous[:1] == "B"))
    return tuple(replace(one, number=number) for number, one in enumerate(ordered, 1))


def hour(clock: float | None) -> int | None:
    """A clock position as observations have it: whole hours, 1 to 12."""
    return None if clock is None else (round(clock) - 1) % 12 + 1


def _end(inspection: Inspection) -> float:
    if inspection.length is not None:
        return inspection.length
    stations = [float(one["chainage_to_m"]) for one in inspection.landmarks]
    return inspection.pipe.length if inspection.pipe.length is not None else max(stations, default=0.0)


def _landmarks(landmarks: Iterable[Mapping[str, Any]]) -> list[Observation]:
    """Confirmed ones with what people corrected; what somebody rejected is none."""
    found: list[Observation] = []
    continuous = 0
    for one in sorted(landmarks, key=lambda one: float(_said(one, "chainage_m"))):
        label = str(_said(one, "class"))
        coded = of_class(label)
        if coded is None or one.get("decision") in _REFUSED or one.get("status") == "candidate":
            continue
        station = float(_said(one, "chainage_m"))
        extent = float(one["chainage_to_m"]) - float(one["chainage_m"])
        clock_from, clock_to = hour(_said(one, "clock")), hour(one.get("clock_to"))
        corrected = one.get("corrected") or {}
        base = Observation(
            station=round(max(station, 0.0), 2),
            code=str(coded["code"]),
            ch1=str(coded.get("ch1", "")),
            ch2=str(coded.get("ch2", "")),
            clock_from=clock_from,
            clock_to=None if clock_to == clock_from or coded["code"] == "BCA" or "clock" in corrected else clock_to,
            at_joint=bool(coded.get("at_joint", False)),
            remark=str(one.get("note") or ""),
            photo=str(one.get("photo") or ""),
            source=f"landmark {one['id']}",
        )
        if extent >= LONG_M and "chainage_m" not in corrected and not base.at_joint:
            continuous += 1
            found.append(replace(base, continuous=f"A{continuous}"))
            end = round(station + extent, 2)
            found.append(replace(base, station=end, continuous=f"B{continuous}", photo="", remark=""))
        else:
            found.append(base)
    return found


def _deformations(sheets: Sequence[DiameterSheet]) -> list[Observation]:
    """Ovality of accepted measurements, and water that stood in the pipe."""
    found = []
    for sheet in sheets:
        if sheet.verdict != "accept" or sheet.station is None or sheet.diameter_mm is None:
            continue
        if sheet.ovality is not None and math.isfinite(sheet.ovality) and sheet.ovality >= _OVAL_FROM:
            found.append(
                Observation(
                    round(sheet.station, 2), "BAA", ch1="A", q1=round(100 * sheet.ovality, 1), source=f"survey {sheet.survey}"
                )
            )
        if sheet.water_mm is not None and sheet.water_mm > 0:
            share = min(100.0, round(100 * sheet.water_mm / sheet.diameter_mm))
            found.append(Observation(round(sheet.station, 2), "BDD", q1=share, source=f"survey {sheet.survey}"))
    return found


def _regions(regions: Iterable[Mapping[str, Any]]) -> list[Observation]:
    """Regions of the wall that deviate and are sure enough; what is expected at a joint is none. How much of the height a
    deposit takes is told where the height is known."""
    found = []
    for one in regions:
        peak, confidence = one.get("peak_mm"), one.get("confidence")
        if peak is None or one.get("chainage_m") is None or one.get("expected"):
            continue
        if confidence is not None and confidence < LEAST_SURE:
            continue
        kind = str(one.get("kind") or ("intrusion" if peak < 0 else "loss"))
        coded = _DEVIATIONS.get(kind, _DEVIATIONS["intrusion" if peak < 0 else "loss"])
        height = one.get("height_mm")
        first, last = _around(one)
        found.append(
            Observation(
                round(float(one["chainage_m"]), 2),
                coded[0],
                ch1=coded[1],
                ch2=coded[2],
                q1=round(100 * abs(peak) / height) if kind == "deposit" and height else None,
                clock_from=first,
                clock_to=None if last == first else last,
                remark=f"{abs(float(peak)):.0f} mm over {float(one.get('area_mm2') or 0) / 100:.0f} cm2",
                photo=str(one.get("photo") or ""),
                source=f"survey {one['survey']} region {one['number']}" if "survey" in one else str(one.get("source", "")),
            )
        )
    return found


def _displaced(joints: Iterable[Mapping[str, Any]]) -> list[Observation]:
    """Joints whose second pipe is displaced by enough to be coded."""
    return [
        Observation(
            round(float(joint["chainage_m"]), 2),
            "BAJ",
            ch1="B",
            q1=round(float(joint["offset_mm"])),
            clock_from=hour(joint.get("offset_clock")),
            at_joint=True,
            source=f"survey {joint['survey']}",
        )
        for joint in joints
        if joint["chainage_m"] is not None and (joint.get("offset_mm") or 0.0) >= DISPLACED_MM
    ]


def _around(region: Mapping[str, Any]) -> tuple[int | None, int | None]:
    """Hours from which to which a region lies, clockwise."""
    clock, width = region.get("clock"), float(region.get("width_hours") or 0.0)
    if clock is None:
        return None, None
    return hour((clock - width / 2) % 12), hour((clock + width / 2) % 12)


def _said(one: Mapping[str, Any], key: str) -> Any:
    """What somebody corrected, else what was measured."""
    return (one.get("corrected") or {}).get(key, one.get(key))
