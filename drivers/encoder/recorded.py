"""A distance CSV in place of an encoder: one row a moment, ``time_s`` or ``frame``, and ``distance_m`` or ``distance``.

Columns may come in any order, among others; fields are parted by comma, semicolon or tab. A row without a distance is a moment
at which none was read. Frames count from 1, or from 0 where the first is 0.
"""

from __future__ import annotations

import csv
import math
import threading
import time
from dataclasses import dataclass
from pathlib import Path

from drivers.base import EndOfRecording, RecordingBroken, SensorLost
from drivers.encoder.base import Encoder, Reading
from drivers.encoder.numerals import number_and_step

TIME_COLUMNS = ("time_s",)
FRAME_COLUMNS = ("frame",)
DISTANCE_COLUMNS = ("distance_m", "distance")


@dataclass(frozen=True)
class DistanceSeries:
    """Distances (m) in the order of the file. Either ``times_s`` (s) or ``frames`` (from 0) says when, the other is empty.

    ``quantum`` is the step (m) in which the distances come.
    """

    distances: tuple[float, ...]
    times_s: tuple[float, ...]
    frames: tuple[int, ...]
    quantum: float

    def at_rate(self, frame_rate: float) -> tuple[float, ...]:
        """The times (s) of the distances, where need be from the frames a second."""
        return self.times_s or tuple(frame / frame_rate for frame in self.frames)


def read_distances(path: Path) -> DistanceSeries:
    """The series of a file. Raises RecordingBroken with a sentence that names the row."""
    try:
        text = path.read_text(encoding="utf-8-sig")
    except FileNotFoundError as error:
        raise RecordingBroken(f"There is no file {path}.") from error
    except (OSError, UnicodeDecodeError) as error:
        raise RecordingBroken(f"{path} cannot be read as text: {error}.") from error
    lines = text.splitlines()
    header = next((line for line in lines if line.strip()), "")
    parted = max(",;\t", key=header.count)
    rows = csv.reader(lines, delimiter=parted)
    try:
        names = [name.strip().lower() for name in next(rows, [])]
        when, is_time = _column(names, TIME_COLUMNS), True
        if when is None:
            when, is_time = _column(names, FRAME_COLUMNS), False
        far = _column(names, DISTANCE_COLUMNS)
        if when is None or far is None:
            raise RecordingBroken(
                f"{path} needs a column time_s or frame and a column distance_m or distance; "
                f"its first row has {', '.join(names) or 'nothing'}."
            )
        moments: list[float] = []
        distances: list[float] = []
        quantum = 1.0
        for row in rows:
            where = f"{path}, line {rows.line_num}"
            if not any(field.strip() for field in row) or (far < len(row) and not row[far].strip()):
                continue
            distance, step = _number(row, far, where, names[far])
            moment, _ = _number(row, when, where, names[when])
            if not is_time and not (moment >= 0 and moment == math.floor(moment)):
                raise RecordingBroken(f"{where}: frame {moment:g} is no whole number from 0 on.")
            if moments and not moment > moments[-1]:
                raise RecordingBroken(f"{where}: {names[when]} goes from {moments[-1]:g} to {moment:g}, it must grow.")
            moments.append(moment)
            distances.append(distance)
            quantum = min(quantum, step)
    except csv.Error as error:
        raise RecordingBroken(f"{path} is no CSV: {error}.") from error
    if not moments:
        raise RecordingBroken(f"{path} has no row with a distance.")
    if is_time:
        return DistanceSeries(tuple(distances), tuple(moments), (), quantum)
    base = 0 if moments[0] == 0 else 1
    return DistanceSeries(tuple(distances), (), tuple(int(moment) - base for moment in moments), quantum)


class RecordedEncoder(Encoder):
    """A distance CSV read as an encoder: each reading once, as fast as it is asked for, with its ``media_s``.

    ``frame_rate`` is that of the video where the file counts frames.
    """

    def __init__(self, file: Path | str, frame_rate: float | None = None) -> None:
        if frame_rate is not None and not (math.isfinite(frame_rate) and frame_rate > 0):
            raise ValueError(f"the frame rate must be a positive number of frames a second, got {frame_rate}")
        self._file = Path(file)
        self._frame_rate = frame_rate
        self._series: DistanceSeries | None = None
        self._times: tuple[float, ...] = ()
        self._next = 0
        self._lock = threading.Lock()
        self.name = f"distance record {self._file.name}"

    def _open(self) -> None:
        series = read_distances(self._file)
        if series.frames and self._frame_rate is None:
            raise RecordingBroken(f"{self._file} counts frames: say how many frames a second the video has.")
        with self._lock:
            self._times = series.at_rate(self._frame_rate or 1.0)
            self._series, self._next = series, 0

    def _read(self, timeout_s: float) -> Reading:
        with self._lock:
            if self._series is None:
                raise SensorLost(f"The {self.name} is not open.")
            if self._next >= len(self._times):
                raise EndOfRecording(f"The {self.name} has been read to its end.")
            index = self._next
            self._next += 1
            return Reading(
                value=self._series.distances[index],
                monotonic_ns=time.monotonic_ns(),
                unit="m",
                quantum=self._series.quantum,
                media_s=self._times[index],
            )

    def close(self) -> None:
        """Stop. Never raises, may be called twice."""
        with self._lock:
            self._series = None


def _column(names: list[str], wanted: tuple[str, ...]) -> int | None:
    return next((names.index(name) for name in wanted if name in names), None)


def _number(row: list[str], column: int, where: str, name: str) -> tuple[float, float]:
    text = row[column].strip() if column < len(row) else ""
    found = number_and_step(text)
    if found is None:
        try:
            value = float(text)  # an exponent, as programs write small numbers
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            raise RecordingBroken(f'{where}: the {name} "{text[:24]}" is no number.')
        return value, 1e-3
    return found
