"""A distance CSV in place of an encoder."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from drivers.base import RecordingBroken
from drivers.encoder.recorded import RecordedEncoder, read_distances
from drivers.registry import open_encoder
from tests.unit.drivers.encoder_contract import RecordingContract, Rig


class FileRig(Rig):
    def __init__(self, file: Path) -> None:
        self.encoder = RecordedEncoder(file)

    def turn_to(self, value: float) -> None: ...

    def close(self) -> None:
        self.encoder.close()


class TestRecorded(RecordingContract):
    readings_in_recording = 4

    @pytest.fixture
    def rig(self, tmp_path: Path) -> Iterator[Rig]:
        made = FileRig(written(tmp_path, "time_s,distance_m\n0.0,0.0\n0.5,0.1\n1.0,0.1\n1.5,0.3\n"))
        yield made
        made.close()


def written(folder: Path, text: str) -> Path:
    path = folder / "distance.csv"
    path.write_text(text, encoding="utf-8")
    return path


def test_times_and_distances(tmp_path: Path) -> None:
    series = read_distances(written(tmp_path, "time_s,distance_m\n0,0\n0.25,0.10\n1e0,-0.20\n"))
    assert series.times_s == (0.0, 0.25, 1.0)
    assert series.distances == (0.0, 0.1, -0.2)
    assert series.quantum == pytest.approx(0.01)
    assert series.at_rate(99.0) == series.times_s


@pytest.mark.parametrize(("first", "expected"), [(1, (0, 1, 2)), (0, (0, 1, 2)), (2500, (2499, 2500, 2501))])
def test_frames_count_from_one_or_from_nought(tmp_path: Path, first: int, expected: tuple[int, ...]) -> None:
    rows = "".join(f"{first + index},{index / 10}\n" for index in range(3))
    series = read_distances(written(tmp_path, f"Frame,Distance\n{rows}"))
    assert series.frames == expected
    assert series.at_rate(25.0) == tuple(frame / 25.0 for frame in expected)


def test_the_habits_of_spreadsheets(tmp_path: Path) -> None:
    text = '\ufeff note ; Distance ;TIME_S\r\n"a;b";0,5;0\r\n;;\r\n\r\nx; ;0,5\r\n;0,6;1\r\n'
    series = read_distances(written(tmp_path, text))
    assert (series.times_s, series.distances) == ((0.0, 1.0), (0.5, 0.6))


def test_frames_need_a_rate(tmp_path: Path) -> None:
    path = written(tmp_path, "frame,distance\n1,0\n2,0.1\n")
    with pytest.raises(RecordingBroken, match="how many frames a second"):
        RecordedEncoder(path).open()
    encoder = open_encoder("csv", file=path, frame_rate=25.0)
    encoder.open()
    readings = [encoder.read(), encoder.read()]
    assert [(reading.media_s, reading.value, reading.unit) for reading in readings] == [(0.0, 0.0, "m"), (0.04, 0.1, "m")]
    assert readings[1].quantum == pytest.approx(0.1)


@pytest.mark.parametrize("rate", [0.0, -25.0, float("nan")])
def test_an_impossible_rate_is_refused(tmp_path: Path, rate: float) -> None:
    with pytest.raises(ValueError, match="rate"):
        RecordedEncoder(tmp_path / "x.csv", rate)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "its first row has nothing"),
        ("a,b\n1,2\n", "its first row has a, b"),
        ("time_s,b\n1,2\n", "distance_m or distance"),
        ("distance_m\n1\n", "time_s or frame"),
        ("time_s,distance_m\n", "no row with a distance"),
        ("time_s,distance_m\n0,\n1,\n", "no row with a distance"),
        ("time_s,distance_m\n0,0\n1,x\n", 'line 3: the distance_m "x" is no number'),
        ("time_s,distance_m\n0,0\n1,nan\n", '"nan" is no number'),
        ("time_s,distance_m\n0,0\n1,1e999\n", "is no number"),
        ("time_s,distance_m\n0,0\n,1\n", 'the time_s "" is no number'),
        ("distance_m,time_s\n0,0\n1\n", 'the time_s "" is no number'),
        ("time_s,distance_m\n0,0\n1,1\n1,2\n", "line 4: time_s goes from 1 to 1"),
        ("frame,distance_m\n5,0\n4,1\n", "frame goes from 5 to 4"),
        ("frame,distance_m\n1.5,0\n", "no whole number"),
        ("frame,distance_m\n-1,0\n", "no whole number"),
    ],
)
def test_a_broken_file_is_one_sentence_that_names_the_place(tmp_path: Path, text: str, said: str) -> None:
    path = written(tmp_path, text)
    with pytest.raises(RecordingBroken) as caught:
        read_distances(path)
    assert said in str(caught.value)
    assert str(path) in str(caught.value)
    assert str(caught.value).endswith(".")


def test_what_is_no_text_file_is_broken(tmp_path: Path) -> None:
    path = tmp_path / "x.csv"
    with pytest.raises(RecordingBroken, match="There is no file"):
        read_distances(path)
    with pytest.raises(RecordingBroken, match="cannot be read"):
        read_distances(tmp_path)
    path.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(RecordingBroken, match="cannot be read"):
        read_distances(path)
    path.write_bytes(b"time_s,distance\n" + b"a" * 200_000 + b",\0\n")
    with pytest.raises(RecordingBroken):
        read_distances(path)


def test_the_odometry_of_the_paper(data_dir: Path) -> None:
    series = read_distances(data_dir / "cctv_pipe1" / "sewerPipe_groundTruthAnomaly.csv")
    assert len(series.frames) == 6200
    assert (series.frames[0], series.distances[-1]) == (0, 83.0)
    assert series.quantum == pytest.approx(0.1)
    assert np.all(np.diff(series.distances) >= 0)
