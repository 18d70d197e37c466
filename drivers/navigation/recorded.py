"""Recorded navigation and scans: a CSV log, and a folder of PLY or PCD files named by their times (s).

A scanner sweeps: where a PLY file has a property ``late_s``, each point was seen so long after the file's time.

The log has a line for each reading, ``time_s,sensor`` and then numbers:

    0,mount,10,0.5,0,0.1          scanner: degrees tilted down, metres forward, right, down of the vehicle's centre
    0,start,3.2,1.1               where it begins: north, east (m); 0, 0 where the line is missing
    0.2,dvl,0.01,-0.07,0.0,0.01,y velocity forward, right, down (m/s), its sigma, valid (y or n)
    0.25,depth,3.81,0.02          metres below the surface, sigma
    0.3,ahrs,0.4,-0.2,181.5,0,0,1.2,0.3    roll, pitch, yaw (degrees), their rates (degrees/s), sigma (degrees)
"""

from __future__ import annotations

import csv
import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.base import RecordingBroken
from drivers.navigation.readings import Attitude, Depth, NavReading, Velocity
from drivers.navigation.scans import Scan

KINDS = (".ply", ".pcd")
_NUMBERS = {"mount": 4, "start": 2, "dvl": 5, "depth": 2, "ahrs": 7}


@dataclass(frozen=True)
class LogHeader:
    """``tilt`` (rad) and ``offset`` (m) of the scanner on the vehicle; ``start``: north and east (m) at the first reading."""

    tilt: float = 0.0
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)
    start: tuple[float, float] = (0.0, 0.0)


def read_log(path: Path) -> tuple[LogHeader, list[NavReading]]:
    """The log in order of time. Raises RecordingBroken with one sentence."""
    header = LogHeader()
    readings: list[NavReading] = []
    try:
        with path.open(encoding="utf-8", newline="") as file:
            for number, row in enumerate(csv.reader(file), 1):
                if not row or row[0].startswith("#") or row[0] == "time_s":
                    continue
                try:
                    header = _read_row(row, header, readings)
                except ValueError as error:
                    raise RecordingBroken(f"Line {number} of the log {path} cannot be read: {error}.") from error
    except (OSError, UnicodeDecodeError) as error:
        raise RecordingBroken(f"The log {path} cannot be read: {error}.") from error
    if not any(isinstance(reading, Attitude) for reading in readings):
        raise RecordingBroken(f"The log {path} has no attitude (ahrs), without which nothing can be mapped.")
    return header, sorted(readings, key=lambda reading: reading.time_s)


def _read_row(row: list[str], header: LogHeader, readings: list[NavReading]) -> LogHeader:
    sensor = row[1].strip() if len(row) > 1 else ""
    if sensor not in _NUMBERS:
        raise ValueError(f"there is no sensor {sensor!r}, known are {', '.join(_NUMBERS)}")
    time_s = float(row[0])
    texts = [text.strip() for text in row[2:]]
    if len(texts) != _NUMBERS[sensor]:
        raise ValueError(f"{sensor} has {_NUMBERS[sensor]} values, not {len(texts)}")
    if sensor == "dvl":
        valid = texts.pop()
        if valid not in ("y", "n"):
            raise ValueError(f"a velocity is valid (y) or not (n), not {valid!r}")
    values = [float(text) for text in texts]
    if not all(map(math.isfinite, (time_s, *values))):
        raise ValueError("a number is not finite")
    if sensor == "mount":
        return LogHeader(math.radians(values[0]), (values[1], values[2], values[3]), header.start)
    if sensor == "start":
        return LogHeader(header.tilt, header.offset, (values[0], values[1]))
    if values[-1 if sensor != "dvl" else 3] <= 0:
        raise ValueError("a sigma must be positive")
    if sensor == "dvl":
        readings.append(Velocity(time_s, (values[0], values[1], values[2]), values[3], valid == "y"))
    elif sensor == "depth":
        readings.append(Depth(time_s, values[0], values[1]))
    else:
        roll, pitch, yaw, *rates, sigma = (math.radians(value) for value in values)
        readings.append(Attitude(time_s, (roll, pitch, yaw), (rates[0], rates[1], rates[2]), sigma))
    return header


def log_rows(header: LogHeader, readings: list[NavReading]) -> Iterator[list[str]]:
    """The rows of a log that says this."""
    yield ["0", "mount", *_texts([math.degrees(header.tilt), *header.offset])]
    yield ["0", "start", *_texts(list(header.start))]
    for reading in readings:
        begin = [f"{reading.time_s:.4f}"]
        if isinstance(reading, Velocity):
            yield [*begin, "dvl", *_texts([*reading.velocity, reading.sigma]), "y" if reading.valid else "n"]
        elif isinstance(reading, Depth):
            yield [*begin, "depth", *_texts([reading.depth, reading.sigma])]
        else:
            rates = reading.rates or (0.0, 0.0, 0.0)
            yield [*begin, "ahrs", *_texts([math.degrees(v) for v in (*reading.angles, *rates, reading.sigma)])]


def _texts(values: list[float]) -> list[str]:
    return [f"{value:.6g}" for value in values]


def scan_files(folder: Path) -> list[tuple[float, Path]]:
    """Times (s) and files of a folder in order of time. Raises RecordingBroken."""
    if not folder.is_dir():
        raise RecordingBroken(f"There is no folder {folder} of scans.")
    found = []
    for path in folder.iterdir():
        if path.suffix.lower() in KINDS:
            try:
                found.append((float(path.stem), path))
            except ValueError as error:
                raise RecordingBroken(f"The scan {path} is not named by its time in seconds, such as 12.5.ply.") from error
    if not found:
        raise RecordingBroken(f"The folder {folder} has no scan: PLY or PCD files named by their times in seconds.")
    return sorted(found)


def read_scan(time_s: float, path: Path) -> Scan:
    """One file. Raises RecordingBroken."""
    late: NDArray[np.float64] | None = None
    try:
        if path.suffix.lower() == ".ply":
            points, late = _read_ply(path)
        else:
            points = read_pcd(path)
    except (OSError, ValueError, KeyError, IndexError, AttributeError) as error:
        raise RecordingBroken(f"The scan {path} cannot be read: {error}.") from error
    kept = np.isfinite(points).all(axis=1) & (np.abs(points).max(axis=1) > 0)
    return Scan(time_s, points[kept], None if late is None else late[kept])


def _read_ply(path: Path) -> tuple[NDArray[np.float64], NDArray[np.float64] | None]:
    """Points (N, 3) and, where the file has a property ``late_s``, when each was seen after the scan's time (N,)."""
    import trimesh  # a third of a second, and only recordings need it

    cloud: Any = trimesh.load(path, file_type="ply", process=False)
    points = np.asarray(cloud.vertices, dtype=np.float64).reshape(-1, 3)
    told = cloud.metadata.get("_ply_raw", {}).get("vertex", {}).get("data")
    names = () if told is None or getattr(told, "dtype", None) is None else (told.dtype.names or ())
    return points, np.asarray(told["late_s"], dtype=np.float64).reshape(-1) if "late_s" in names else None


_TYPES = {("F", 4): "<f4", ("F", 8): "<f8", ("U", 1): "u1", ("U", 2): "<u2", ("U", 4): "<u4", ("I", 4): "<i4", ("I", 2): "<i2"}


def read_pcd(path: Path) -> NDArray[np.float64]:
    """Points (N, 3) of a PCD file, ascii or binary. Raises OSError, ValueError, KeyError."""
    data = path.read_bytes()
    header: dict[str, list[str]] = {}
    position = 0
    while "DATA" not in header:
        end = data.index(b"\n", position)
        words = data[position:end].decode("latin-1").split()
        position = end + 1
        if words and not words[0].startswith("#"):
            header[words[0]] = words[1:]
    counts = [int(c) for c in header.get("COUNT", ["1"] * len(header["FIELDS"]))]
    columns = {name: sum(counts[:k]) for k, name in enumerate(header["FIELDS"])}
    number = int(header["POINTS"][0])
    if header["DATA"][0] == "ascii":
        table = np.array(data[position:].split(), dtype=np.float64).reshape(number, sum(counts))
        return np.ascontiguousarray(table[:, [columns[axis] for axis in "xyz"]])
    if header["DATA"][0] != "binary":
        raise ValueError(f"PCD data of kind {header['DATA'][0]} is not read; save it as binary")
    fields = [
        (name, _TYPES[kind, int(size)], (count,))
        for name, kind, size, count in zip(header["FIELDS"], header["TYPE"], header["SIZE"], counts, strict=True)
    ]
    records = np.frombuffer(data, np.dtype(fields), count=number, offset=position)
    return np.column_stack([records[axis][:, 0].astype(np.float64) for axis in "xyz"])


def merged_events(readings: list[NavReading], files: list[tuple[float, Path]]) -> Iterator[NavReading | Scan]:
    """Readings and scans in order of time; scans before the first reading or after the last are left out."""
    position = 0
    for time_s, path in files:
        if not readings[0].time_s <= time_s <= readings[-1].time_s:
            continue
        while position < len(readings) and readings[position].time_s <= time_s:
            yield readings[position]
            position += 1
        yield read_scan(time_s, path)
