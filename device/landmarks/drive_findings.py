"""The map of a drive once it is over: what the survey stores, and what a replay comes to again."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from device.landmarks.as_json import landmark_json
from device.landmarks.pipeline import LandmarkPipeline
from device.landmarks.smoothing import Mapped

Row = dict[str, Any]
Marks = dict[int, tuple[float, Row]]
"""Marked by hand, by number: the moment (on the frames' clock) and the landmark."""


def numbered_rows(pipeline: LandmarkPipeline, numbers: dict[int, int], marks: Marks) -> list[Row]:
    """Every landmark of this moment, candidates too, each under its number; who is new gets the next one in ``numbers``."""
    rows = []
    for landmark in pipeline.landmarks(candidates=True):
        if landmark.id not in numbers:
            numbers[landmark.id] = next_number(numbers, marks)
        rows.append(landmark_json(numbers[landmark.id], landmark))
    return [*rows, *(row for _, row in marks.values())]


def next_number(numbers: dict[int, int], marks: Marks) -> int:
    """The number that nobody has yet."""
    return 1 + max([*numbers.values(), *marks], default=0)


def filtered_rows(pipeline: LandmarkPipeline, numbers: dict[int, int], marks: Marks) -> dict[int, Row]:
    """Those that are more than a suspicion, by number: the map of this moment."""
    return {row["id"]: row for row in numbered_rows(pipeline, numbers, marks) if row["status"] != "candidate"}


def smoothed_rows(smoothed: Mapped, filtered: dict[int, Row], numbers: dict[int, int], marks: Marks) -> dict[int, Row]:
    """The smoothed map, by number; each with where the filter had it."""
    rows = {numbers[found.id]: landmark_json(numbers[found.id], found) for found in smoothed.landmarks}
    for number, (moment, row) in marks.items():
        shift = smoothed.shift(moment)
        rows[number] = {**row, **{key: round(row[key] + shift, 3) for key in ("chainage_m", "chainage_to_m")}}
    before = {number: row["chainage_m"] for number, row in filtered.items()}
    return {number: {**row, "filtered_chainage_m": before.get(number)} for number, row in rows.items()}


@dataclass(frozen=True)
class DriveFindings:
    """What a drive comes to, whoever computes it from the same pictures and readings. ``rows`` by number."""

    state: str
    rows: dict[int, Row]
    rings: list[dict[str, Any]]
    slips: list[dict[str, Any]]
    summary: dict[str, Any]

    def to_json(self) -> dict[str, Any]:
        """As it is written into the log."""
        return {
            "state": self.state,
            "landmarks": [self.rows[number] for number in sorted(self.rows)],
            "rings": self.rings,
            "slips": self.slips,
            **self.summary,
        }


def findings(
    pipeline: LandmarkPipeline,
    state: str,
    filtered: dict[int, Row],
    numbers: dict[int, int],
    marks: Marks,
    smoothed: Mapped | None,
) -> DriveFindings:
    """The finding of a drive in its last ``state``; ``smoothed`` is None where there was nothing to smooth."""
    rings = pipeline.joints(last=True)
    from_m, to_m = pipeline.span()
    summary: dict[str, Any] = {
        "frames": pipeline.frames,
        "from_m": from_m,
        "to_m": to_m,
        "focal_radius": pipeline.focal_radius(),
        "smoothed": smoothed is not None,
    }
    if smoothed is None:
        return DriveFindings(state, filtered, rings, [], summary)
    rows = smoothed_rows(smoothed, filtered, numbers, marks)
    return DriveFindings(state, rows, smoothed.joints or rings, smoothed.slips, {**summary, **smoothed.summary})
