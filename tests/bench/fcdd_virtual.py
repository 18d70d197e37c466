"""Figure 3 of the detector: on rendered drives whose truth is known.

    python -m tests.bench.fcdd_virtual --only connections    AUROC of connections on drives through unseen pipes
    python -m tests.bench.fcdd_virtual --only segment        the paper's 28 m from rendered pictures alone
    python -m tests.bench.fcdd_virtual --every 2 --work DIR  each second picture of the segment; pictures are kept in DIR

Connections: pictures of the drives that --virtual shows, at their own places and looks, none of which trained the network;
what lies at the border of the field counts neither way. Segment: a pipe of 600 mm in which the connections and deposits of the
record lie where the record has them, driven through at the record's mean speed with a counter of 0.1 m steps; the survey's own
pipeline is given nothing but the pictures, the counter, and the camera. Found and false as in tests.bench.landmark_segment: the
same class within 1 m and 45 degrees. With each fifth picture the focus of expansion is some 25 px off, since the wall moves too
far from one to the next, and landmarks are missed that the network sees.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np

from device.fcdd.detector import FcddDetector
from device.fcdd.frames import shown_in
from device.fcdd.model import load_model
from device.landmarks.detectors import EVERY
from device.landmarks.pipeline import LandmarkPipeline, PipelineSetup
from device.landmarks.recorded_way import recorded_way
from drivers.grabber.base import VideoFrame
from drivers.virtual.drive import Drive, Go, demo_drive
from drivers.virtual.grabber import FPS, Footage
from drivers.virtual.landmarks import Connection, Patch, Thing
from drivers.virtual.profile import circular
from drivers.virtual.world import Joint, VirtualSewer
from estimators.fcdd import Fcdd
from estimators.fcdd_training.folds import auroc, auroc_interval
from tests.bench.landmark_scenes import Truth, compare
from tests.bench.landmark_segment import SEGMENT, recorded, smooth
from tests.bench.table import print_table

FIRST_SEED = 900
"""Of the drives; training pictures come from other pipes."""
DIAMETER = 0.6
LATERAL = 0.15
"""Interior diameter (m) of the laterals: the record does not state it."""
WATER = 0.02
"""Its depth (m)."""
BEFORE, BEHIND = 1.0, 3.0
"""The pipe goes on so far (m) on either side of the segment."""


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.bench.fcdd_virtual", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--model", type=Path)
    parser.add_argument("--only", choices=("connections", "segment"))
    parser.add_argument("--drives", type=int, default=6)
    parser.add_argument("--pictures", type=int, default=20, help="of each drive")
    parser.add_argument("--every", type=int, default=1, help="of the segment's pictures")
    parser.add_argument("--work", type=Path, help="where pictures are kept between runs")
    chosen = parser.parse_args()
    network = load_model(chosen.model)
    if chosen.only in (None, "connections"):
        connections(network, chosen.drives, chosen.pictures, chosen.work)
    if chosen.only in (None, "segment"):
        segment(network, chosen.every, chosen.work)


def connections(network: Fcdd, drives: int, pictures: int, work: Path | None) -> None:
    """Scores of pictures with and without a connection in the field."""
    scores, positive, groups, hits, false = [], [], [], [], 0
    for seed in range(FIRST_SEED, FIRST_SEED + drives):
        drive = demo_drive(seed)
        moments = np.random.default_rng([seed, 5]).uniform(0, drive.length_s, pictures)
        for t, image in zip(moments, _pictures(drive, moments, work, f"drive{seed}"), strict=True):
            seen, unsure = shown_in(drive.sewer, drive.camera, drive.pose(t))
            if "connection" in unsure:
                continue
            there = [one for one in seen if one.label == "connection"]
            scores.append(network.see(image).scores["connection"])
            positive.append(bool(there))
            groups.append(str(seed))
            told = [one for one in network.detect(image) if one.label == "connection"]
            near = [[np.hypot(one.u - other.u, one.v - other.v) < 60 for other in told] for one in there]
            hits += [any(row) for row in near]
            false += sum(not any(row[k] for row in near) for k in range(len(told)))
    values, truth = np.array(scores), np.array(positive)
    low, high = auroc_interval(values, truth, groups, np.random.default_rng(0))
    print(f"{len(truth)} pictures of {drives} drives, {int(truth.sum())} with a connection in the field:")
    print(f"AUROC {auroc(values, truth):.3f} ({low:.3f} to {high:.3f} over drives), wanted 0.95")
    print(f"detected within 60 px: {sum(hits)} of {len(hits)}; false detections a picture: {false / len(truth):.2f}")


def segment(network: Fcdd, every: int, work: Path | None) -> None:
    """The map of the rebuilt segment against its truth."""
    drive, truths = rebuilt()
    moments = np.arange(0, drive.length_s, every / FPS)
    camera = drive.camera
    setup = PipelineSetup((camera.fx, camera.fy), (camera.cx, camera.cy), DIAMETER / 2, sparse=every > 2)
    way = recorded_way(moments.tolist(), [drive.encoder(t) for t in moments], drive.quantum)
    pipeline = LandmarkPipeline(setup, FcddDetector(network, EVERY if every == 1 else 1))
    for number, (t, image) in enumerate(zip(moments, _pictures(drive, moments, work, f"segment{every}"), strict=True), 1):
        pipeline.step(VideoFrame(image, int(t * 1e9), number, float(t), "rendered"), way.at(float(t)))
        if number % 50 == 0:
            print(f"picture {number} of {len(moments)}", file=sys.stderr, flush=True)
    smoothed = pipeline.smooth()
    landmarks = pipeline.landmarks() if smoothed is None else list(smoothed.landmarks)
    matched, false = compare(truths, landmarks)
    rows = [
        (
            one.truth.label,
            f"{one.truth.middle:.2f}",
            "missed" if one.landmark is None else f"{one.along:.2f}",
            "-" if one.landmark is None else f"{np.degrees(one.around):.0f}",
        )
        for one in matched
    ]
    title = f"The 28 m segment from rendered pictures alone, each {every}. of {FPS:.0f} a second ({len(moments)} pictures)"
    print_table(title, ("landmark", "at m", "error m", "error degrees"), rows)
    for label, wanted in (("connection", 5), ("deposit", 2)):
        ours = [one for one in matched if one.truth.label == label]
        print(f"  {label}s found: {sum(one.landmark is not None for one in ours)} of {len(ours)} (wanted {wanted})")
    told = ", ".join(f"{one.label} at {one.chainage_from:.1f} m" for one in false) or "none"
    print(f"  false landmarks: {len(false)} (wanted at most 3): {told}")


def rebuilt() -> tuple[Drive, list[Truth]]:
    """A drive through the record's segment; chainages are counted from a metre before it."""
    shown, everything = recorded()
    positions = smooth(shown, "nearest")[SEGMENT]
    start, end = float(positions[0]), float(positions[-1])
    shift = BEFORE - start
    truths = [
        Truth(one.label, one.low + shift, one.high + shift, one.angle, one.angle_known)
        for one in everything
        if start <= one.low < end - 0.5
    ]
    things = tuple(_thing(one) for one in truths)
    length = end + shift + BEHIND
    joints = tuple(Joint(float(z), 0.02) for z in np.arange(0.7, length, 2.44))
    sewer = VirtualSewer(circular(DIAMETER), length, WATER, joints=joints, things=things)
    speed = (end - start) / (len(positions) / FPS)
    return Drive(sewer, (Go(end + shift, speed),), BEFORE, seed=FIRST_SEED), truths


def _thing(truth: Truth) -> Thing:
    angle = float(np.remainder(truth.angle + np.pi, 2 * np.pi) - np.pi)
    if truth.label == "connection":
        return Connection(truth.middle, angle, LATERAL)
    return Patch(truth.low, max(truth.high, truth.low + 0.3), angle, 0.5, 0.05)


def _pictures(drive: Drive, moments: np.ndarray, work: Path | None, name: str) -> Iterator[np.ndarray]:
    footage = Footage(drive)
    for number, t in enumerate(moments):
        file = None if work is None else work / name / f"{round(1000 * t):07d}.jpg"
        kept = None if file is None or not file.exists() else cv2.imread(str(file))
        if kept is None:
            kept = footage.picture(float(t), number)
            if file is not None:
                file.parent.mkdir(parents=True, exist_ok=True)
                cv2.imwrite(str(file), kept, [cv2.IMWRITE_JPEG_QUALITY, 95])
        yield np.asarray(kept, np.uint8)


if __name__ == "__main__":
    main()
