"""What a schema does not check: observations that make sense together. A fault is a sentence; nothing is mended silently."""

from __future__ import annotations

import re
from collections.abc import Sequence

from device.inspections.codes import codes
from device.inspections.model import Inspection, Observation

TOLERANCE = 0.05
"""By how much (m) a station may lie beyond the length that was inspected: the counter's last digit."""
_PAIR = re.compile(r"([AB])([1-9][0-9]?)")


def faults(inspection: Inspection) -> list[str]:
    """Every rule that ``inspection`` breaks, as sentences; empty where it may go out."""
    observations = inspection.observations
    return [
        *(fault for one in observations for fault in _alone(one)),
        *_stations(inspection),
        *_ends(observations),
        *_pairs(observations),
        *(
            f"{_name(one)} names the photo {one.photo}, which is not there."
            for one in observations
            if one.photo and inspection.photo(one.photo) is None
        ),
        *_names(inspection),
    ]


def _alone(one: Observation) -> list[str]:
    found: list[str] = []
    code = codes().get(one.code)
    if code is None:
        return [f"{_name(one)}: the code {one.code} is not in the table."]
    for what, value, allowed in (("characterisation 1", one.ch1, code.ch1), ("characterisation 2", one.ch2, code.ch2)):
        if value and allowed and value not in allowed:
            found.append(f"{_name(one)}: {what} {value} is not one of {', '.join(allowed)}.")
    for hour in (one.clock_from, one.clock_to):
        if hour is not None and not 1 <= hour <= 12:
            found.append(f"{_name(one)}: {hour} is no clock position, they go from 1 to 12.")
    if one.clock_from is None and one.clock_to is not None:
        found.append(f"{_name(one)}: a clock position to without one from.")
    if code.clock == "one" and one.clock_from is None:
        found.append(f"{_name(one)}: it needs a clock position.")
    if code.q1 == "%" and one.q1 is not None and not 0 <= one.q1 <= 100:
        found.append(f"{_name(one)}: {one.q1:g} % cannot be.")
    if one.q1 is not None and one.q1 < 0:
        found.append(f"{_name(one)}: a quantification below zero.")
    return found


def _stations(inspection: Inspection) -> list[str]:
    limit = inspection.length if inspection.length is not None else inspection.pipe.length
    found = []
    last = 0.0
    for one in inspection.observations:
        if one.station < last:
            found.append(f"{_name(one)} comes after one at {last:.2f} m: stations must not go back.")
        last = max(last, one.station)
        if one.station < 0 or (limit is not None and one.station > limit + TOLERANCE):
            where = "" if limit is None else f" of {limit:.2f} m"
            found.append(f"{_name(one)} lies outside the length{where}.")
    return found


def _ends(observations: Sequence[Observation]) -> list[str]:
    if not observations:
        return ["There is no observation: even a clean pipe has a start and an end."]
    found = []
    if observations[0].code != "BCD":
        found.append("The first observation must be the start node (BCD).")
    if observations[-1].code not in ("BCE", "BDC"):
        found.append("The last observation must be the finish node (BCE) or say why it was abandoned (BDC).")
    return found


def _pairs(observations: Sequence[Observation]) -> list[str]:
    found = []
    open_defects: dict[int, Observation] = {}
    for one in observations:
        if not one.continuous:
            continue
        match = _PAIR.fullmatch(one.continuous)
        if match is None:
            found.append(f"{_name(one)}: {one.continuous} is no mark of a continuous defect, they are A1 to B99.")
            continue
        number = int(match[2])
        if match[1] == "A":
            if number in open_defects:
                found.append(f"{_name(one)}: the continuous defect {number} has begun already.")
            open_defects[number] = one
        elif number not in open_defects:
            found.append(f"{_name(one)}: the continuous defect {number} ends without having begun.")
        elif open_defects.pop(number).code != one.code:
            found.append(f"{_name(one)}: the continuous defect {number} began as another code.")
    found += [f"{_name(one)}: the continuous defect {number} never ends." for number, one in sorted(open_defects.items())]
    return found


def _names(inspection: Inspection) -> list[str]:
    found = []
    if not inspection.pipe.name.strip():
        found.append("The pipe has no name.")
    if inspection.pipe.upstream.name == inspection.pipe.downstream.name:
        found.append("The pipe starts and ends at the same node.")
    return found


def _name(one: Observation) -> str:
    return f"{one.code} at {one.station:.2f} m"
