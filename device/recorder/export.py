"""A recording as plain files: pictures with a manifest that ``borescout measure --replay`` or, of stereo pairs,
``borescout anomaly --replay`` reads, scans and navigation that ``borescout structure`` reads, tables, and point clouds."""

from __future__ import annotations

import csv
import json
from collections import Counter
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any, TextIO

import cv2
import numpy as np
from foxglove_schemas_protobuf.PackedElementField_pb2 import PackedElementField
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from google.protobuf.timestamp_pb2 import Timestamp

from device.errors import Invalid
from device.json_text import dumps
from device.recorder.reader import Entry, open_recording
from device.recorder.samples import Picture, Words
from device.recorder.schemas import Message, foxglove_schema, topic_name
from device.recorder.writer import LogWriter
from device.surveys.topics import PAIRS
from drivers.depth.base import DepthFrame
from drivers.encoder.base import Reading
from drivers.navigation.readings import Attitude, Depth, NavReading, Velocity
from drivers.navigation.recorded import LogHeader, log_rows
from drivers.navigation.scans import Scan
from estimators.pinhole import rays

MANIFEST, READINGS, NOTES, PICTURES, CLOUDS = "manifest.json", "tether.csv", "notes.jsonl", "pictures.csv", "clouds.mcap"
SCANS, NAVIGATION = "scans", "navigation.csv"
SIDES = ("left", "right")
_THIN = 2
"""Every second pixel of every second row: as many points as can be looked at."""


def export_recording(path: Path, folder: Path, clouds: bool = False) -> dict[str, int]:
    """Write the recording that ``path`` is a part of into the new ``folder``; how much of what. Raises Invalid."""
    recording = open_recording(path)
    if folder.exists() and any(folder.iterdir()):
        raise Invalid(f"The folder {folder} is not empty: name another with --to.")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with _Export(folder, clouds, recording.head) as export:
            for entry in recording.entries():
                export.add(entry)
    except OSError as error:
        raise Invalid(f"The recording cannot be written to {folder}: {error.strerror}.") from None
    return dict(export.counts)


class _Export:
    """The files of one export; each is begun when the first thing comes that belongs in it."""

    def __init__(self, folder: Path, clouds: bool, head: dict[str, Any]) -> None:
        self.counts: Counter[str] = Counter()
        self._folder = folder
        self._clouds = clouds
        self._about = {"pipe": (head.get("pipe") or {}).get("name"), "position": head.get("position")}
        taken = {"pipe": self._about["pipe"], "chainage_m": head.get("chainage_m")}
        self._taken = {name: value for name, value in taken.items() if value is not None}
        self._mount = _mount_of(head)
        self._cloud_log: LogWriter | None = None
        self._manifest: list[dict[str, Any]] = []
        self._pairs: dict[str, Any] = {}
        self._files: dict[str, TextIO] = {}

    def __enter__(self) -> _Export:
        return self

    def __exit__(self, *failure: object) -> None:
        for file in self._files.values():
            file.close()
        if self._manifest:
            (self._folder / MANIFEST).write_text(json.dumps(self._manifest, indent=1) + "\n", encoding="utf-8")
        elif self._pairs:
            (self._folder / MANIFEST).write_text(json.dumps(self._pairs, indent=1) + "\n", encoding="utf-8")
        if self._cloud_log is not None:
            self._cloud_log.finish()

    def add(self, entry: Entry) -> None:
        """One sample."""
        sample = entry.sample
        if isinstance(sample, DepthFrame):
            self._depth(entry.topic, sample, entry.log_ns)
        elif isinstance(sample, Picture):
            self._picture(entry.topic, sample)
        elif isinstance(sample, Reading):
            told = vars(sample)
            self._row(READINGS, list(told), ["" if value is None else value for value in told.values()])
            self.counts["readings"] += 1
        elif isinstance(sample, Scan):
            self._scan(sample)
        elif isinstance(sample, Velocity | Depth | Attitude):
            self._reading(sample)
        else:
            if entry.topic == PAIRS and isinstance(sample, dict):
                self._pair(sample)
            note: Any = asdict(sample) if isinstance(sample, Words) else sample
            self._open(NOTES).write(dumps({"topic": entry.topic, "log_ns": entry.log_ns, "told": note}) + "\n")
            self.counts["notes"] += 1

    def _pair(self, told: dict[str, Any]) -> None:
        """A stereo pair, whose pictures are written: for ``borescout anomaly --replay``."""
        lens = told["intrinsics"]
        folders = {side: topic_name("stereo", told["camera"], side).strip("/").replace("/", "-") for side in SIDES}
        paths = {side: f"{folder}/{told['number']:08d}.png" for side, folder in folders.items()}
        self._pairs.setdefault("pairs", []).append(paths | self._taken)
        self._pairs |= {
            "width": lens["width"],
            "height": lens["height"],
            "focal_px": lens["fx"],
            "principal_px": [lens["ppx"], lens["ppy"]],
            "baseline_mm": 1000 * told["baseline_m"],
            "disparity_offset_px": told["offset_px"],
            "disparity_offset_std_px": told["offset_std_px"],
            "scale_std": told["scale_std"],
        }
        self.counts["stereo pairs"] += 1

    def _scan(self, scan: Scan) -> None:
        (self._folder / SCANS).mkdir(exist_ok=True)
        (self._folder / SCANS / f"{scan.time_s:.4f}.ply").write_bytes(ply_bytes(scan))
        self.counts["scans"] += 1

    def _reading(self, reading: NavReading) -> None:
        *header, row = log_rows(self._mount, [reading])
        csv.writer(self._open(NAVIGATION)).writerows([row] if self.counts["navigation readings"] else [*header, row])
        self.counts["navigation readings"] += 1

    def _depth(self, topic: str, frame: DepthFrame, log_ns: int) -> None:
        name = topic.strip("/").replace("/", "-")
        stem = f"{name}/{frame.number:08d}"
        (self._folder / name).mkdir(exist_ok=True)
        self._write(f"{stem}-depth.png", lambda file: cv2.imwrite(file, frame.depth))
        told: dict[str, Any] = {
            "depth": f"{stem}-depth.png",
            **{key: value or "unknown" for key, value in self._about.items()},
            "recording": name,
            "depth_unit_m": frame.depth_unit_m,
            "intrinsics": asdict(frame.intrinsics),
            "number": frame.number,
            "monotonic_ns": frame.monotonic_ns,
        }
        color = frame.color
        if color is not None:
            told["color"] = f"{stem}-color.png"
            self._write(told["color"], lambda file: cv2.imwrite(file, color))
        self._manifest.append(told)
        self.counts["depth pictures"] += 1
        if self._clouds:
            self._cloud(topic, frame, log_ns)

    def _picture(self, topic: str, picture: Picture) -> None:
        """The very bytes that were recorded."""
        name = topic.strip("/").replace("/", "-")
        (self._folder / name).mkdir(exist_ok=True)
        file = f"{name}/{picture.number:08d}.{'jpg' if picture.format == 'jpeg' else 'png'}"
        (self._folder / file).write_bytes(picture.jpeg)
        row = [file, picture.number, picture.monotonic_ns, "" if picture.media_s is None else picture.media_s]
        self._row(PICTURES, ["file", "number", "monotonic_ns", "media_s"], row)
        self.counts["pictures"] += 1

    def _cloud(self, topic: str, frame: DepthFrame, log_ns: int) -> None:
        if self._cloud_log is None:
            self._cloud_log = LogWriter(self._folder / CLOUDS, {"kind": "clouds"}, log_ns)
        message = Message(f"{topic}/points", foxglove_schema(PointCloud), point_cloud(topic, frame, log_ns))
        self._cloud_log.write([message], log_ns, log_ns, frame.number)
        self.counts["point clouds"] += 1

    def _write(self, file: str, write: Callable[[str], bool]) -> None:
        if not write(str(self._folder / file)):
            raise OSError(0, f"the picture {file} could not be written")

    def _row(self, file: str, names: list[str], row: list[Any]) -> None:
        known = file in self._files
        table = csv.writer(self._open(file))
        if not known:
            table.writerow(names)
        table.writerow(row)

    def _open(self, file: str) -> TextIO:
        if file not in self._files:
            self._files[file] = (self._folder / file).open("w", encoding="utf-8", newline="")
        return self._files[file]


def _mount_of(head: dict[str, Any]) -> LogHeader:
    """How the scanner of a structure survey was mounted; nothing of other surveys."""
    setup = head.get("setup") or {}
    if "mount" not in setup:
        return LogHeader()
    forward = np.array(setup["mount"])[:, 2]
    x, y, z = setup["offset"]
    return LogHeader(float(np.arctan2(forward[2], forward[0])), (x, y, z))


def ply_bytes(scan: Scan) -> bytes:
    """A binary PLY file of the scan, each point with its moment after the scan's (s)."""
    late = np.zeros(len(scan.points)) if scan.late_s is None else scan.late_s
    names = ("x", "y", "z", "late_s")
    head = ["ply", "format binary_little_endian 1.0", f"element vertex {len(scan.points)}"]
    head += [*(f"property float {name}" for name in names), "end_header", ""]
    return "\n".join(head).encode() + np.column_stack([scan.points, late]).astype("<f4").tobytes()


def point_cloud(topic: str, frame: DepthFrame, log_ns: int) -> bytes:
    """A foxglove.PointCloud of the frame, in metres in the camera's frame (x right, y down, z forward), thinned."""
    z = frame.depth[::_THIN, ::_THIN].astype(np.float32) * np.float32(frame.depth_unit_m)
    seen = z > 0
    xy = rays(frame.intrinsics)[::_THIN, ::_THIN][seen] * z[seen][:, None]
    points = np.column_stack([xy, z[seen]]).astype("<f4")
    cloud = PointCloud(
        timestamp=Timestamp(seconds=log_ns // 10**9, nanos=log_ns % 10**9),
        frame_id=topic.rpartition("/")[2],
        point_stride=12,
        fields=[
            PackedElementField(name=name, offset=4 * k, type=PackedElementField.NumericType.FLOAT32)
            for k, name in enumerate("xyz")
        ],
        data=points.tobytes(),
    )
    cloud.pose.orientation.w = 1.0
    return bytes(cloud.SerializeToString())
