"""The real crawler run end to end from its stills and its burned-in counter (issue 3, figure 2): joints, spacing, f R; and the
rings' centres extrapolated to 1/Z = 0 beside those of rings marked by hand (figure 1, second half).

BORESCOUT_DATA=... python -m tests.bench.cctv_run [--overlays FOLDER]

Lengths are in the unit of the counter, which the recording does not state. Marked by hand, with a pixel grid over the enlarged
picture, were two rings of each straight-ahead picture that shows two: a picture a second
is too coarse for flow (printed beside: what it gives), so that the marks stand for the focus of expansion.
"""

from __future__ import annotations

import argparse
import csv
import os
import time
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from drivers.base import EndOfRecording
from drivers.encoder.osd import OsdReader, read_series
from drivers.grabber.base import VideoFrame
from drivers.registry import open_grabber
from estimators.flow import FlowConfig, flow
from estimators.foe import paper_foe
from estimators.rings import JointConfig, JointMap, Ring, RingMap, axis_view, dark_centre, find
from tests.bench.real_data import fail
from tests.bench.table import print_table

FIRST_S = 129.0
"""Before it the counter is reset twice."""
RANGE = (7.0, 50.0)
MARKS = Path(__file__).with_name("cctv_run_marks.csv")
"""Rings marked by hand: picture (s), centre and half width (px)."""
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
    _compare(frames, result)
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


def _compare(frames: list[VideoFrame], result: JointMap) -> None:
    """Centre at 1/Z = 0 from the rings that are joints, from the marks, and from flow to the picture before."""
    marks: dict[float, list[tuple[float, float, float]]] = {}
    with MARKS.open() as file:
        for row in csv.DictReader(file):
            marks.setdefault(float(row["time_s"]), []).append((float(row["u"]), float(row["v"]), float(row["across"])))
    rows, offs = [], []
    diagonal = float(np.hypot(*frames[0].image.shape[:2]))
    for before, frame in pairwise(frames):
        if frame.time_s not in marks:
            continue
        (u0, v0, a0), (u1, v1, a1) = marks[frame.time_s]
        by_hand = np.array([u0, v0]) - a0 * np.array([u1 - u0, v1 - v0]) / (a1 - a0)
        own = [seen.ring for joint in result.joints for seen in joint.sightings if seen.frame == frame.number]
        view = axis_view(own)
        off = None if view is None else 100 * float(np.hypot(*(view.centre - by_hand))) / diagonal
        offs.append(np.inf if off is None else off)
        foe = _flow(before, frame)
        rows.append(
            (
                f"{frame.time_s:.0f}",
                len(own),
                f"{by_hand[0]:.0f}, {by_hand[1]:.0f}",
                "-" if view is None else f"{view.centre[0]:.0f}, {view.centre[1]:.0f}",
                "-" if view is None else f"{view.lean[0]:+.2f}, {view.lean[1]:+.2f}",
                "-" if off is None else f"{off:.1f} %",
                "-" if foe is None else f"{100 * float(np.hypot(*(foe - by_hand))) / diagonal:.0f} %",
            )
        )
    header = ("picture s", "rings", "marked", "found", "e / R", "off, share of diagonal", "flow off")
    print_table("Centre of the rings at 1/Z = 0", header, rows)
    print(f"within 3 %: {sum(off <= 3 for off in offs)} of {len(offs)}, a picture without two joints counted as a miss")


def _flow(before: VideoFrame, frame: VideoFrame) -> NDArray[np.float64] | None:
    """The focus of expansion by eqs. 6 and 7, from a picture and the one a second before."""
    gray = [np.asarray(cv2.cvtColor(one.image, cv2.COLOR_BGR2GRAY), np.uint8) for one in (before, frame)]
    small = [np.asarray(cv2.resize(one, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA), np.uint8) for one in gray]
    foe = paper_foe(flow(*small, FlowConfig(levels=4)), np.random.default_rng(0))
    return None if foe is None else 2 * foe.centre


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
