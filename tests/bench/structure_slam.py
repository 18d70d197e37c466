"""Figures 2 and 4 of the filter alone: consistency over seeds, and what faults do to the map. No scan is cast: what a scan
shows of the paper's structure is drawn from the truth with the noise that the filter is told, on the virtual chamber's way and
navigation, whose DVL is out for 20, 20 and 12 s in every run.

    python -m tests.bench.structure_slam              10 seeds without fault, then 3 of each fault
    python -m tests.bench.structure_slam --seeds 2 --fault-seeds 1
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from device.structure.database import shipped_knowledge
from device.structure.run import Reckoner, VirtualChamber, feed
from device.structure.scores import matching, rms
from device.structure.told import consistent, warnings
from drivers.navigation.readings import Attitude, Depth, NavReading, Velocity
from drivers.virtual.chamber.navigation import navigation_log
from drivers.virtual.chamber.structure import load_structure
from estimators.structure.types import Parts, Segment, Sighting
from tests.bench.table import print_table

Array = NDArray[np.float64]

OFFSET, TURN, POINT = 0.0015, 0.002, 0.012
"""Noise of a segment's offset (m) and turn (rad), and of an object's position (m)."""
FAULTS = {
    "none": "nothing",
    "false": "one in ten observations is 5 to 15 cm beside the truth",
    "shuffled": "scans come with times up to half a second wrong",
    "no DVL": "the DVL is lost after 150 s",
    "no AHRS": "the AHRS is lost after 150 s",
    "no pressure": "the pressure sensor is lost after 150 s",
    "no scans": "no scan from 150 s to 250 s",
    "moved": "from 250 s on the structure stands half a metre further",
}


@dataclass(frozen=True)
class Told:
    """One run: position errors (m) at each scan by filter, dead reckoning and smoothing, NEES, and what the map came to."""

    error: Array
    reckoned: Array
    smoothed: Array
    nees: Array
    pipes: int
    false_pipes: int
    objects: int
    false_objects: int
    inconsistent: int
    consistent: bool
    warnings: list[str]


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--fault-seeds", type=int, default=3)
    arguments = parser.parse_args()
    for fault, about in FAULTS.items():
        count = arguments.seeds if fault == "none" else arguments.fault_seeds
        runs = [run(seed, fault) for seed in range(1, count + 1)]
        nees = np.concatenate([told.nees for told in runs])
        low, high = chi2.ppf([0.025, 0.975], 3 * count) / count
        print_table(
            f"Fault: {about} ({count} seeds; NEES over runs should lie between {low:.2f} and {high:.2f})",
            [
                "RMS (m)",
                "worst (m)",
                "smoothed RMS (m)",
                "dead reckoning (m)",
                "ratio",
                "NEES",
                "pipes",
                "false",
                "objects",
                "false",
                "strange scans",
                "says inconsistent",
                "warns",
            ],
            [
                [
                    f"{rms(np.concatenate([t.error for t in runs])):.4f}",
                    f"{max(t.error.max() for t in runs):.3f}",
                    f"{rms(np.concatenate([t.smoothed for t in runs])):.4f}",
                    f"{rms(np.concatenate([t.reckoned for t in runs])):.3f}",
                    f"{rms(np.concatenate([t.reckoned for t in runs])) / rms(np.concatenate([t.error for t in runs])):.1f}",
                    f"{nees.mean():.2f}",
                    "/".join(str(t.pipes) for t in runs),
                    sum(t.false_pipes for t in runs),
                    "/".join(str(t.objects) for t in runs),
                    sum(t.false_objects for t in runs),
                    sum(t.inconsistent for t in runs),
                    f"{sum(not t.consistent for t in runs)} of {count}",
                    f"{sum(bool(t.warnings) for t in runs)} of {count}",
                ]
            ],
        )
        for warning in sorted({warning for told in runs for warning in told.warnings}):
            print(f"    {warning}")


def run(seed: int, fault: str) -> Told:
    """One way around the paper's structure."""
    chamber = VirtualChamber(load_structure(), seed)
    mapper = chamber.mapper(shipped_knowledge())
    reckoner = Reckoner(0.0, mapper.slam)
    rng = np.random.default_rng([seed, 8])
    readings = navigation_log(chamber.path, chamber.structure.description.navigation, np.random.default_rng([seed, 2]))
    errors, reckoned, nees, times = [], [], [], []
    for event in merged(readings, chamber.scanner.times(), fault):
        if not isinstance(event, float):
            reckoner.feed(event)
            feed(mapper, event)
            continue
        mapper.advance(event)
        shown_at = event + (rng.uniform(-0.5, 0.5) if fault == "shuffled" else 0.0)
        shift = np.array([0.5, 0.0, 0.0]) if fault == "moved" and event > 250 else np.zeros(3)
        mapper.add_parts(parts(chamber, shown_at, shift, 0.1 if fault == "false" else 0.0, rng))
        times.append(event)
        away = mapper.slam.vehicle[:3] - chamber.path.pose(event).position
        errors.append(float(np.linalg.norm(away)))
        reckoned.append(float(np.linalg.norm(reckoner.filter.vehicle[:3] - chamber.path.pose(event).position)))
        nees.append(float(away @ np.linalg.solve(mapper.slam.covariance[:3, :3], away)))
    states = np.array(mapper.smooth())
    found = mapper.result()
    match = matching(found, chamber.structure)
    return Told(
        np.array(errors),
        np.array(reckoned),
        np.linalg.norm(states[:, :3] - chamber.path.pose(np.array(times)).position, axis=1),
        np.array(nees),
        len(match.pipes),
        len(found.pipes) - len(match.pipes),
        len(match.objects),
        len(found.objects) - len(match.objects),
        mapper.doubts.unexpected,
        consistent(mapper),
        warnings(mapper),
    )


def merged(readings: list[NavReading], scans: Array, fault: str) -> Iterator[NavReading | float]:
    """Readings and times of scans in order, without what the fault takes away."""
    gone = {"no DVL": Velocity, "no AHRS": Attitude, "no pressure": Depth}.get(fault)
    position = 0
    for time_s in scans:
        while position < len(readings) and readings[position].time_s <= time_s:
            reading = readings[position]
            position += 1
            if gone is None or reading.time_s < 150 or not isinstance(reading, gone):
                yield reading
        if fault != "no scans" or not 150 < time_s < 250:
            yield float(time_s)


def parts(chamber: VirtualChamber, time_s: float, shift: Array, false: float, rng: np.random.Generator) -> Parts:
    """What a scan at ``time_s`` would show of pipes and objects, moved by ``shift`` (3,), a share of them false."""
    pose = chamber.path.pose(time_s)
    rotation = pose.rotation @ chamber.scanner.mount.rotation
    place = pose.position + pose.rotation @ chamber.scanner.mount.offset - shift
    segments = []
    for pipe in chamber.structure.runs:
        along = np.linspace(0, 1, 60)
        points = (pipe.start + along[:, None] * (pipe.end - pipe.start) - place) @ rotation
        inside = visible(chamber, points)
        if inside.sum() < 0.35 / np.linalg.norm(pipe.end - pipe.start) * 60 or rng.random() < 0.15:
            continue
        start, end = points[inside][0], points[inside][-1]
        segments.append(noisy(start, end, wrong(false, rng), rng))
    sightings = []
    for thing in chamber.structure.objects:
        point = (thing.position - place) @ rotation
        if visible(chamber, point[None])[0] and rng.random() > 0.4:
            seen = point + rng.normal(0, POINT, 3) + wrong(false, rng)
            sightings.append(Sighting(seen, np.eye(3) * POINT**2, np.zeros((0, 3)), np.zeros((0, 3)), "inline"))
    return Parts(tuple(segments), tuple(sightings))


def wrong(share: float, rng: np.random.Generator) -> Array:
    """Mostly nothing, else 5 to 15 cm in any direction."""
    if rng.random() >= share:
        return np.zeros(3)
    direction = rng.normal(size=3)
    return direction / np.linalg.norm(direction) * rng.uniform(0.05, 0.15)


def visible(chamber: VirtualChamber, points: Array) -> NDArray[np.bool_]:
    """Which points (N, 3) in the sensor's frame lie in its view."""
    settings = chamber.structure.description.scanner
    half = np.radians(settings.field_deg) / 2
    azimuth = np.arctan2(points[:, 0], points[:, 2])
    elevation = np.arctan2(points[:, 1], np.hypot(points[:, 0], points[:, 2]))
    return np.asarray(
        (np.abs(azimuth) < half[0]) & (np.abs(elevation) < half[1]) & (np.linalg.norm(points, axis=1) < settings.range_m[1])
    )


def noisy(start: Array, end: Array, off: Array, rng: np.random.Generator) -> Segment:
    """A segment with errors of offset and turn."""
    direction = (end - start) / np.linalg.norm(end - start)
    first = np.cross(direction, np.eye(3)[int(np.argmin(np.abs(direction)))])
    first /= np.linalg.norm(first)
    across = np.array([first, np.cross(direction, first)])
    middle = (start + end) / 2 + rng.normal(0, OFFSET, 2) @ across + off
    half = (direction + rng.normal(0, TURN, 2) @ across) * np.linalg.norm(end - start) / 2
    direction = half / np.linalg.norm(half)
    first = np.cross(direction, np.eye(3)[int(np.argmin(np.abs(direction)))])
    first /= np.linalg.norm(first)
    covariance = np.diag([OFFSET, OFFSET, TURN, TURN]) ** 2
    bins = np.arange(0.01, 2 * np.linalg.norm(half), 0.02)
    return Segment(middle - half, middle + half, np.array([first, np.cross(direction, first)]), covariance, bins)


if __name__ == "__main__":
    main()
