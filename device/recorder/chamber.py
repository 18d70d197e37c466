"""Scans and navigation readings as messages and back: a Foxglove point cloud with the moment of each point, and plain JSON."""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from typing import Any

import numpy as np
from foxglove_schemas_protobuf.PackedElementField_pb2 import PackedElementField
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from google.protobuf.timestamp_pb2 import Timestamp

from device.json_text import dumps
from drivers.navigation.readings import Attitude, Depth, NavReading, Velocity
from drivers.navigation.scans import Scan

_KINDS: dict[str, type[Velocity] | type[Depth] | type[Attitude]] = {"dvl": Velocity, "depth": Depth, "ahrs": Attitude}
_FIELDS = ("x", "y", "z", "late_s")
_STRIDE = 4 * len(_FIELDS)


def scan_as_recorded(scan: Scan) -> Scan:
    """The scan as it comes back from a recording: what is mapped is this, so that a replay finds the same."""
    points = scan.points.astype(np.float32).astype(np.float64)
    late = None if scan.late_s is None else scan.late_s.astype(np.float32).astype(np.float64)
    return replace(scan, points=points, late_s=late)


def cloud_bytes(frame_id: str, scan: Scan, stamp_ns: int) -> bytes:
    """A foxglove.PointCloud, metres in the scanner's frame; ``late_s`` is each point's moment after the scan's."""
    late = np.zeros(len(scan.points)) if scan.late_s is None else scan.late_s
    cloud = PointCloud(
        timestamp=Timestamp(seconds=stamp_ns // 10**9, nanos=stamp_ns % 10**9),
        frame_id=frame_id,
        point_stride=_STRIDE,
        fields=[
            PackedElementField(name=name, offset=4 * k, type=PackedElementField.NumericType.FLOAT32)
            for k, name in enumerate(_FIELDS)
        ],
        data=np.column_stack([scan.points, late]).astype("<f4").tobytes(),
    )
    cloud.pose.orientation.w = 1.0
    return bytes(cloud.SerializeToString())


def scan_text(scan: Scan) -> bytes:
    """What a point cloud has no room for."""
    return dumps({"time_s": scan.time_s, "swept": scan.late_s is not None}).encode()


def scan_from(cloud: bytes, text: bytes) -> Scan:
    """The scan again."""
    told = json.loads(text)
    table = np.frombuffer(PointCloud.FromString(cloud).data, "<f4").reshape(-1, len(_FIELDS)).astype(np.float64)
    late = np.ascontiguousarray(table[:, 3]) if told["swept"] else None
    return Scan(told["time_s"], np.ascontiguousarray(table[:, :3]), late)


def reading_json(reading: NavReading) -> dict[str, Any]:
    """A reading with the name of its sensor."""
    sensor = next(name for name, kind in _KINDS.items() if isinstance(reading, kind))
    return {"sensor": sensor, **asdict(reading)}


def reading_from(text: bytes) -> NavReading:
    """The reading again."""
    told: dict[str, Any] = json.loads(text)
    kind: Any = _KINDS[told.pop("sensor")]
    reading: NavReading = kind(**{key: tuple(value) if isinstance(value, list) else value for key, value in told.items()})
    return reading
