"""The real crawler run end to end from its stills and its burned-in counter (issue 3, figure 2): joints, spacing, f R; and the
rings' centres extrapolated to 1/Z = 0 beside those of rings marked by hand (figure 1, second half).

BORESCOUT_DATA=... python -m tests.bench.cctv_run [--overlays FOLDER]

Lengths are in the unit of the counter, which the recording does not state. Marked by hand, with a pixel grid over the enlarged
picture, were two rings of each straight-ahead picture that shows two. Beside them stands the focus of expansion from each still
and its neighbours (see ``still_flow``). The pipe bends at its joints, so the far ring lies in another pipe than the crawler,
and the line through both rings of one picture ("one line") leads to where that other pipe goes. Each ring on its own line, over
the pictures of one pipe ("bends", see ``estimators.rings.bends``), leads to where the crawler goes; flow has no part in it. The
near
ring alone, c + (e / R) rho with flow's own c and e / R, is compared too.
"""

from __future__ import annotations

import argparse
import csv
import os
import time
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from drivers.base import EndOfRecording
from drivers.encoder.osd import OsdReader, read_series
from drivers.grabber.base import VideoFrame
from drivers.registry import open_grabber
from estimators.foe import video_aspect
from estimators.rings import (
    AxisView,
    JointConfig,
    JointMap,
    JointRing,
    Ring,
    RingMap,
    axis_view,
    dark_centre,
    find,
    joint_centres,
    ring_centres,
)
from tests.bench.real_data import fail
from tests.bench.still_flow import still_flow
from tests.bench.table import print_table

Array = NDArray[np.float64]
FIRST_S = 129.0
"""Before it the counter is reset twice."""
RANGE = (7.0, 50.0)
MARKS = Path(__file__).with_name("cctv_run_marks.csv")
"""Rings marked by hand: picture (s), centre and half width (px)."""
MARK_STD = 1.0
"""Of a marked ring's radius (px)."""
STANDS = 0.05
"""Less way than this by the counter is none."""
COUNTER_STD = 0.12
"""The counter's step, and that it and the picture are not of one moment, at half a unit a second."""


def main() -> None:
    """Print the joints."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--overlays", type=Path, help="draw the rings into the pictures and write them here")
    arguments = parser.parse_args()
    root = os.environ.get("BORESCOUT_DATA")
    if not root or not (Path(root) / "cctv_run").is_dir():
        fail("Set BORESCOUT_DATA to the folder of the shared recordings.")
    frames = [frame for frame in _frames(Path(str(root)) / "cctv_run") if frame.time_s >= FIRST_S]
    series = read_series(frames, OsdReader())
    found = RingMap(config=JointConfig(position_std=COUNTER_STD))
    rings: dict[int, list[Ring]] = {}
    started = time.perf_counter()
    for frame, told in zip(frames, series.told, strict=True):
        gray = np.asarray(cv2.cvtColor(frame.image, cv2.COLOR_BGR2GRAY), np.uint8)
        rings[frame.number] = find(gray, dark_centre(gray), aspect=found.aspect)
        if told.distance is not None:
            found.add(frame.number, told.distance, rings[frame.number])
    seconds = time.perf_counter() - started
    result = found.solve(last=True)
    _print(result, len(frames), seconds)
    _compare(frames, [told.distance for told in series.told], result)
    if arguments.overlays is not None:
        _draw(frames, result, rings, arguments.overlays)


def _frames(folder: Path) -> list[VideoFrame]:
    grabber = open_grabber("stills", folder=folder)
    grabber.open()
    frames = []
    try:
        while True:
            frames.append(grabber.read())
    except EndOfRecording:
        return frames
    finally:
        grabber.close()


def _print(result: JointMap, count: int, seconds: float) -> None:
    joints = [joint for joint in result.joints if RANGE[0] <= joint.chainage <= RANGE[1]]
    rows = []
    before = None
    for joint in joints:
        radii = [sighting.ring.radius for sighting in joint.sightings]
        gap = "" if before is None else f"{joint.chainage - before:.2f}"
        rows.append(
            (f"{joint.chainage:.2f}", gap, len(joint.sightings), f"{min(radii):.0f}-{max(radii):.0f}", f"{joint.spread:.3f}")
        )
        before = joint.chainage
    print_table("Joints of cctv_run", ("counter", "to the one before", "sightings", "radius px", "median spread"), rows)
    aspects = [s.ring.across / s.ring.upright for joint in joints for s in joint.sightings]
    print(f"{len(joints)} joints between {RANGE[0]} and {RANGE[1]} from {count} pictures, {1000 * seconds / count:.0f} ms each")
    print(f"median spread of the sightings of one joint: {np.median([joint.spread for joint in joints]):.3f}")
    if result.focal_radius is not None:
        print(f"f R: {result.focal_radius.value:.1f} px units, sigma {result.focal_radius.sigma:.1f}")
    print(f"pixel aspect: {np.median(aspects):.3f}")


def _compare(frames: list[VideoFrame], places: list[float | None], result: JointMap) -> None:
    """Centre at 1/Z = 0 from the rings that are joints and from the marks, focus of expansion from the stills beside."""
    marks: dict[float, list[tuple[float, float, float]]] = {}
    with MARKS.open() as file:
        for row in csv.DictReader(file):
            marks.setdefault(float(row["time_s"]), []).append((float(row["u"]), float(row["v"]), float(row["across"])))
    rows, offs, apart = [], [], []
    agreed: dict[str, list[float]] = {"one line": [], "bends": [], "found": [], "near": []}
    diagonal = float(np.hypot(*frames[0].image.shape[:2]))
    by_bends = _marked_centres(frames, places, result, marks)
    by_found = joint_centres(result.joints)
    for k, frame in enumerate(frames):
        if frame.time_s not in marks:
            continue
        (u0, v0, a0), (u1, v1, a1) = marks[frame.time_s]
        line = np.array([u0, v0]) - a0 * np.array([u1 - u0, v1 - v0]) / (a1 - a0)
        own = [seen.ring for joint in result.joints for seen in joint.sightings if seen.frame == frame.number]
        view = axis_view(own)
        off = None if view is None else 100 * float(np.hypot(*(view.centre - line))) / diagonal
        offs.append(np.inf if off is None else off)
        bends, found = by_bends[frame.number], by_found.get(frame.number)
        told = _flows(frames, places, k, result)
        told_row = ["stands", *["-"] * 5]
        if told:
            weight = np.array([std**-2 for _, std, _ in told])
            foe, slope = (np.average([one[j] for one in told], axis=0, weights=weight) for j in (0, 2))
            centres = {"one line": line, "bends": bends.centre, "found": None if found is None else found.centre}
            centres["near"] = foe - np.array([u0, v0]) + foe + slope * a0
            told_row = [f"{foe[0]:.0f}, {foe[1]:.0f}", f"{slope[0]:+.2f}, {slope[1]:+.2f}"]
            for name, centre in centres.items():
                agreed[name].append(np.inf if centre is None else 100 * float(np.hypot(*(foe - centre))) / diagonal)
                told_row.append("-" if centre is None else f"{agreed[name][-1]:.1f} %")
            if len(told) == 2:
                apart.append(100 * float(np.hypot(*(told[0][0] - told[1][0]))) / diagonal)
        rows.append(
            (
                f"{frame.time_s:.0f}",
                f"{line[0]:.0f}, {line[1]:.0f}",
                "-" if off is None else f"{off:.1f} %",
                f"{bends.centre[0]:.0f}, {bends.centre[1]:.0f} +- {np.sqrt(bends.covariance[0, 0]):.0f}",
                f"{bends.lean[0]:+.2f}, {bends.lean[1]:+.2f}",
                *told_row,
            )
        )
    header = (
        "picture s", "one line", "found", "bends", "e / R", "flow", "e / R", "one line off", "bends off", "found, bends",
        "near ring",
    )  # fmt: skip
    print_table("Centre of the rings at 1/Z = 0 and focus of expansion; shares of the diagonal", header, rows)
    print(
        f"found rings on one line within 3 % of the marks on one line: {sum(off <= 3 for off in offs)} of {len(offs)},"
        " without two joints a miss"
    )
    print("flow's focus of expansion within 3 % of the centre of the rings; where the counter stands there is no flow:")
    for name, what in (
        ("one line", "two marked rings on one line, as if the pipe were straight"),
        ("bends", "marked rings, each on its own line"),
        ("found", "found rings, each on its own line"),
        ("near", "the near ring, with flow's own e / R"),
    ):
        print(
            f"  {sum(off <= 3 for off in agreed[name])} of {len(agreed[name])}, median {np.median(agreed[name]):.1f} %: {what}"
        )
    print(f"flow from the still before and from the one after: apart by {np.median(apart):.1f} % (median of {len(apart)})")


def _marked_centres(
    frames: list[VideoFrame],
    places: list[float | None],
    result: JointMap,
    marks: dict[float, list[tuple[float, float, float]]],
) -> dict[int, AxisView]:
    """By frame, from the marks: the near ring is the joint at the end of the crawler's pipe, the far one the next."""
    aspect = video_aspect(frames[0].image.shape[1], frames[0].image.shape[0])
    seen = []
    for frame, place in zip(frames, places, strict=True):
        if place is None:
            continue
        passed = int(np.searchsorted([joint.chainage for joint in result.joints], place))
        for ahead, (u, v, across) in enumerate(marks.get(frame.time_s, [])):
            ring = Ring((u, v), across, across / aspect, MARK_STD, 1.0, 1.0)
            seen.append(JointRing(frame.number, passed, passed + ahead, ring))
    return ring_centres(seen)


def _flows(frames: list[VideoFrame], places: list[float | None], k: int, result: JointMap) -> list[tuple[Array, float, Array]]:
    """The focus of expansion (px) in still ``k`` with its std and e / R: from the still before it and from the one after."""
    aspect = video_aspect(frames[k].image.shape[1], frames[k].image.shape[0])
    found: list[tuple[Array, float, Array]] = []
    for first in (k - 1, k):
        if first < 0 or first + 1 >= len(frames) or result.focal_radius is None:
            continue
        begin, end = places[first], places[first + 1]
        if begin is None or end is None or abs(end - begin) < STANDS:
            continue
        pair = [np.asarray(cv2.cvtColor(one.image, cv2.COLOR_BGR2GRAY), np.uint8) for one in frames[first : first + 2]]
        told = still_flow(*pair, (end - begin) / (result.focal_radius.value * np.sqrt(aspect)), aspect)
        if told is not None and told.share > 0.5:
            found.append((told.after, told.std[1], told.slope) if first < k else (told.before, told.std[0], told.slope))
    return found


def _draw(frames: list[VideoFrame], result: JointMap, rings: dict[int, list[Ring]], folder: Path) -> None:
    """Every picture with a joint: its rings thin, those of joints thick with their place, the rings' centre at infinity."""
    folder.mkdir(parents=True, exist_ok=True)
    owners: dict[int, list[tuple[float, Ring]]] = {}
    for joint in result.joints:
        for sighting in joint.sightings:
            owners.setdefault(sighting.frame, []).append((joint.chainage, sighting.ring))
    for frame in frames:
        if frame.number not in owners:
            continue
        picture = frame.image.copy()
        for ring in rings[frame.number]:
            _ellipse(picture, ring, (90, 160, 90), 1)
        for chainage, ring in owners[frame.number]:
            _ellipse(picture, ring, (0, 255, 0), 2)
            place = (int(ring.centre[0] - 30), max(18, int(ring.centre[1] - ring.upright) - 4))
            cv2.putText(picture, f"{chainage:.2f}", place, cv2.FONT_HERSHEY_SIMPLEX, 0.6, (255, 255, 0), 2)
        view = axis_view([ring for _, ring in owners[frame.number]])
        if view is not None:
            u, v = (int(value) for value in view.centre)
            cv2.drawMarker(picture, (u, v), (0, 255, 255), cv2.MARKER_CROSS, 20, 2)
        cv2.imwrite(str(folder / f"{frame.time_s:05.0f}.jpg"), picture)


def _ellipse(picture: NDArray[np.uint8], ring: Ring, color: tuple[int, int, int], width: int) -> None:
    centre = (round(ring.centre[0]), round(ring.centre[1]))
    cv2.ellipse(picture, centre, (round(ring.across), round(ring.upright)), 0, 0, 360, color, width, cv2.LINE_AA)


if __name__ == "__main__":
    main()
