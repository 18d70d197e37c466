"""From samples to messages and back. What Foxglove has a schema for is written in it, the rest as JSON with its own schema.

Pictures are protobuf: JSON would make them a third larger and cost a copy through base64. Depth is a RawImage inside a chunk
compressed by zstd: as small as a PNG for a fifth of its time (``python -m tests.bench.replay``).
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from foxglove_schemas_protobuf.RawImage_pb2 import RawImage
from google.protobuf.timestamp_pb2 import Timestamp
from mcap_protobuf.schema import build_file_descriptor_set

from device.json_text import dumps
from device.recorder.chamber import cloud_bytes, reading_from, reading_json, scan_from, scan_text
from device.recorder.samples import Picture, Sample, Words, decoded, encoded
from drivers.depth.base import DepthFrame
from drivers.encoder.base import Reading
from drivers.navigation.readings import Attitude, Depth, Velocity
from drivers.navigation.scans import Scan
from estimators.pinhole import Intrinsics

DEPTH, COLOR, CALIBRATION, FRAME, IMAGE, POINTS = "depth", "color", "calibration", "frame", "image", "points"
_DISTORTION = {"none": "", "brown_conrady": "plumb_bob", "modified_brown_conrady": "plumb_bob"}


@dataclass(frozen=True)
class Schema:
    """One way to write a message: its name, its encoding and its definition as MCAP wants them."""

    name: str
    encoding: str
    definition: bytes

    @property
    def message_encoding(self) -> str:
        """As the channel states it."""
        return "protobuf" if self.encoding == "protobuf" else "json"


def foxglove_schema(message: Any) -> Schema:
    """The schema of one of Foxglove's own messages."""
    return Schema(message.DESCRIPTOR.full_name, "protobuf", build_file_descriptor_set(message).SerializeToString())


def _json(name: str, **properties: str) -> Schema:
    told = {key: {"type": kind} for key, kind in properties.items()}
    return Schema(f"borescout.{name}", "jsonschema", json.dumps({"type": "object", "properties": told}).encode())


RAW_IMAGE = foxglove_schema(RawImage)
COMPRESSED_IMAGE = foxglove_schema(CompressedImage)
CAMERA_CALIBRATION = foxglove_schema(CameraCalibration)
LOG = foxglove_schema(Log)
DEPTH_FRAME = _json(
    "DepthFrame",
    number="integer",
    monotonic_ns="integer",
    depth_unit_m="number",
    scale_std="number",
    source="string",
    color="boolean",
    intrinsics="object",
)
VIDEO_FRAME = _json("VideoFrame", number="integer", monotonic_ns="integer", media_s="number", source="string")
READING = _json(
    "Reading",
    value="number",
    unit="string",
    quantum="number",
    monotonic_ns="integer",
    media_s="number",
    speed="number",
    tension="number",
)
POINT_CLOUD = foxglove_schema(PointCloud)
SCAN_FRAME = _json("ScanFrame", time_s="number", swept="boolean")
NAVIGATION = _json("Navigation", sensor="string", time_s="number", sigma="number")
NOTE = _json("Note")


@dataclass(frozen=True)
class Message:
    """One message of one topic."""

    topic: str
    schema: Schema
    data: bytes


def topic_name(*parts: str) -> str:
    """A topic from names of things: ``/camera/virtual_stereo``."""
    return "".join("/" + (re.sub(r"\W+", "_", part).strip("_") or "_") for part in parts)


def messages(topic: str, sample: Sample, stamp_ns: int, calibrated: set[str]) -> Iterator[Message]:
    """The messages of a sample. ``stamp_ns`` is its moment as Foxglove shows it; ``calibrated`` are the topics whose camera is
    described in this file already. The one that tells what belongs together comes last."""
    if isinstance(sample, DepthFrame):
        yield from _depth(topic, sample, stamp_ns, calibrated)
    elif isinstance(sample, Picture):
        yield Message(f"{topic}/{IMAGE}", COMPRESSED_IMAGE, _compressed(topic, sample.jpeg, stamp_ns, sample.format))
        told = {key: getattr(sample, key) for key in ("number", "monotonic_ns", "media_s", "source")}
        yield Message(f"{topic}/{FRAME}", VIDEO_FRAME, _text(told))
    elif isinstance(sample, Reading):
        yield Message(topic, READING, _text(vars(sample)))
    elif isinstance(sample, Scan):
        yield Message(f"{topic}/{POINTS}", POINT_CLOUD, cloud_bytes(topic.rpartition("/")[2], sample, stamp_ns))
        yield Message(f"{topic}/{FRAME}", SCAN_FRAME, scan_text(sample))
    elif isinstance(sample, Velocity | Depth | Attitude):
        yield Message(topic, NAVIGATION, _text(reading_json(sample)))
    elif isinstance(sample, Words):
        line = Log(timestamp=_time(stamp_ns), level=Log.Level.WARNING, message=sample.text, name=sample.code)
        yield Message(topic, LOG, line.SerializeToString())
    else:
        yield Message(topic, NOTE, dumps(sample).encode())


def _depth(topic: str, frame: DepthFrame, stamp_ns: int, calibrated: set[str]) -> Iterator[Message]:
    camera, name = frame.intrinsics, topic.rpartition("/")[2]
    lens = dumps(vars(camera))
    if (key := topic + lens) not in calibrated:
        calibrated.add(key)
        yield Message(f"{topic}/{CALIBRATION}", CAMERA_CALIBRATION, _calibration(name, camera, stamp_ns))
    image = RawImage(
        timestamp=_time(stamp_ns),
        frame_id=name,
        width=camera.width,
        height=camera.height,
        encoding="16UC1",
        step=2 * camera.width,
        data=np.ascontiguousarray(frame.depth).astype("<u2", copy=False).tobytes(),
    )
    yield Message(f"{topic}/{DEPTH}", RAW_IMAGE, image.SerializeToString())
    if frame.color is not None:
        yield Message(f"{topic}/{COLOR}", COMPRESSED_IMAGE, _compressed(topic, encoded(frame.color), stamp_ns))
    told = {key: getattr(frame, key) for key in ("number", "monotonic_ns", "depth_unit_m", "scale_std", "source")}
    told |= {"color": frame.color is not None, "intrinsics": vars(camera)}
    yield Message(f"{topic}/{FRAME}", DEPTH_FRAME, _text(told))


def _compressed(topic: str, data: bytes, stamp_ns: int, kind: str = "jpeg") -> bytes:
    image = CompressedImage(timestamp=_time(stamp_ns), frame_id=topic.rpartition("/")[2], data=data, format=kind)
    return bytes(image.SerializeToString())


def _calibration(name: str, camera: Intrinsics, stamp_ns: int) -> bytes:
    """Foxglove knows no inverse Brown-Conrady: of such a camera the lens is left out, the frames' own words have it."""
    matrix = [camera.fx, 0.0, camera.ppx, 0.0, camera.fy, camera.ppy, 0.0, 0.0, 1.0]
    model = _DISTORTION.get(camera.model, "")
    calibration = CameraCalibration(
        timestamp=_time(stamp_ns),
        frame_id=name,
        width=camera.width,
        height=camera.height,
        distortion_model=model,
        D=list(camera.coeffs) if model else [],
        K=matrix,
        R=[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        P=[*matrix[:3], 0.0, *matrix[3:6], 0.0, *matrix[6:], 0.0],
    )
    return bytes(calibration.SerializeToString())


def _time(stamp_ns: int) -> Timestamp:
    return Timestamp(seconds=stamp_ns // 1_000_000_000, nanos=stamp_ns % 1_000_000_000)


def _text(told: dict[str, Any]) -> bytes:
    return dumps(told).encode()


class Gathering:
    """Samples from messages in the order in which they were written: the parts of one wait for the message that ends it."""

    def __init__(self) -> None:
        self._parts: dict[str, tuple[int, bytes]] = {}
        self._makers: dict[str, Callable[[str, int, bytes], Sample | None]] = {
            DEPTH_FRAME.name: self._depth_frame,
            VIDEO_FRAME.name: self._picture,
            SCAN_FRAME.name: self._scan,
            NAVIGATION.name: lambda topic, sequence, data: reading_from(data),
            READING.name: lambda topic, sequence, data: Reading(**json.loads(data)),
            LOG.name: _words,
            NOTE.name: lambda topic, sequence, data: json.loads(data),
        }

    def add(self, topic: str, schema: str, sequence: int, data: bytes) -> tuple[str, Sample] | None:
        """The topic and the sample that this message completes, if it does. All messages of a sample share a ``sequence``."""
        maker = self._makers.get(schema)
        if maker is None:
            self._parts[topic] = sequence, data
            return None
        framed = schema in (DEPTH_FRAME.name, VIDEO_FRAME.name, SCAN_FRAME.name)
        whole = topic.removesuffix(f"/{FRAME}") if framed else topic
        sample = maker(whole, sequence, data)
        return None if sample is None else (whole, sample)

    def _part(self, topic: str, sequence: int) -> bytes | None:
        found, data = self._parts.pop(topic, (-1, b""))
        return data if found == sequence else None

    def _depth_frame(self, topic: str, sequence: int, data: bytes) -> DepthFrame | None:
        told = json.loads(data)
        raw, jpeg = self._part(f"{topic}/{DEPTH}", sequence), self._part(f"{topic}/{COLOR}", sequence)
        if raw is None or (told["color"] and jpeg is None):
            return None  # a damaged chunk held it
        lens = told["intrinsics"]
        camera = Intrinsics(**{**lens, "coeffs": tuple(lens["coeffs"])})
        depth = np.frombuffer(RawImage.FromString(raw).data, "<u2").reshape(camera.height, camera.width)
        return DepthFrame(
            depth=depth.astype(np.uint16),
            intrinsics=camera,
            depth_unit_m=told["depth_unit_m"],
            monotonic_ns=told["monotonic_ns"],
            number=told["number"],
            color=None if jpeg is None else decoded(CompressedImage.FromString(jpeg).data),
            source=told["source"],
            scale_std=told["scale_std"],
        )

    def _picture(self, topic: str, sequence: int, data: bytes) -> Picture | None:
        image = self._part(f"{topic}/{IMAGE}", sequence)
        return None if image is None else Picture(CompressedImage.FromString(image).data, **json.loads(data))

    def _scan(self, topic: str, sequence: int, data: bytes) -> Scan | None:
        cloud = self._part(f"{topic}/{POINTS}", sequence)
        return None if cloud is None else scan_from(cloud, data)


def _words(topic: str, sequence: int, data: bytes) -> Words:
    line = Log.FromString(data)
    return Words(line.name, line.message)
