"""Logs and scans on the disk."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest

from drivers.base import RecordingBroken
from drivers.navigation.readings import Attitude, Depth, Velocity
from drivers.navigation.recorded import LogHeader, log_rows, merged_events, read_log, read_pcd, read_scan, scan_files

READINGS = [
    Attitude(0.0, (0.01, -0.02, 3.0), (0.001, 0.0, 0.02), 0.005),
    Velocity(0.2, (0.1, -0.07, 0.0), 0.01, True),
    Depth(0.25, 3.81, 0.02),
    Velocity(0.4, (0.0, 0.0, 0.0), 0.01, False),
]
HEADER = LogHeader(0.1745329, (0.5, 0.0, 0.1), (3.2, 1.1))


def _write(path: Path, rows: list[list[str]]) -> Path:
    with path.open("w", newline="", encoding="utf-8") as file:
        csv.writer(file).writerows(rows)
    return path


def test_a_log_comes_back(tmp_path: Path) -> None:
    header, readings = read_log(_write(tmp_path / "log.csv", list(log_rows(HEADER, READINGS))))
    assert header.tilt == pytest.approx(HEADER.tilt, rel=1e-5)
    assert (header.offset, header.start) == (HEADER.offset, HEADER.start)
    assert [type(reading) for reading in readings] == [type(reading) for reading in READINGS]
    attitude = readings[0]
    assert isinstance(attitude, Attitude)
    assert attitude.angles == pytest.approx(READINGS[0].angles, rel=1e-5)
    assert attitude.rates == pytest.approx(READINGS[0].rates, rel=1e-5)
    assert readings[1] == READINGS[1]
    assert readings[3] == READINGS[3]


@pytest.mark.parametrize(
    ("row", "why"),
    [
        (["0", "gps", "1"], "gps"),
        (["0", "depth", "1"], "2 values"),
        (["0", "depth", "deep", "1"], "deep"),
        (["0", "depth", "nan", "1"], "finite"),
        (["0", "depth", "3", "0"], "positive"),
        (["0", "dvl", "0", "0", "0", "0.1", "perhaps"], "perhaps"),
    ],
)
def test_a_bad_line_is_named(tmp_path: Path, row: list[str], why: str) -> None:
    rows = [*log_rows(HEADER, READINGS), row]
    with pytest.raises(RecordingBroken, match=why) as caught:
        read_log(_write(tmp_path / "log.csv", rows))
    assert f"Line {len(rows)} " in str(caught.value)


def test_a_log_without_attitude_and_no_log_at_all(tmp_path: Path) -> None:
    with pytest.raises(RecordingBroken, match="no attitude"):
        read_log(_write(tmp_path / "log.csv", [["0", "depth", "1", "0.1"]]))
    with pytest.raises(RecordingBroken, match="cannot be read"):
        read_log(tmp_path / "nothing.csv")


POINTS = np.array([[0.5, -0.25, 2.0], [1.0, 0.0, 3.0], [-1.0, 0.5, 2.5]])
PCD = "# .PCD v0.7\nFIELDS x y z rgb\nSIZE 4 4 4 4\nTYPE F F F U\nCOUNT 1 1 1 1\nWIDTH 3\nHEIGHT 1\nPOINTS 3\nDATA "


def test_pcd_as_text_and_binary(tmp_path: Path) -> None:
    text = tmp_path / "1.pcd"
    text.write_text(PCD + "ascii\n" + "\n".join(f"{x} {y} {z} 7" for x, y, z in POINTS) + "\n")
    np.testing.assert_allclose(read_pcd(text), POINTS)
    records = np.zeros(3, dtype=[("xyz", "<f4", (3,)), ("rgb", "<u4")])
    records["xyz"] = POINTS
    binary = tmp_path / "2.pcd"
    binary.write_bytes(PCD.encode() + b"binary\n" + records.tobytes())
    np.testing.assert_allclose(read_pcd(binary), POINTS)
    binary.write_bytes(PCD.encode() + b"binary_compressed\n")
    with pytest.raises(RecordingBroken, match="binary_compressed"):
        read_scan(2.0, binary)


def test_scans_are_read_in_order_with_the_log_between(tmp_path: Path) -> None:
    for time_s in (0.3, 0.1, 9.0):
        lines = "\n".join(f"{x} {y} {z}" for x, y, z in POINTS)
        (tmp_path / f"{time_s}.ply").write_text(
            "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\nend_header\n"
            + lines
            + "\n"
        )
    files = scan_files(tmp_path)
    assert [time_s for time_s, _ in files] == [0.1, 0.3, 9.0]
    events = list(merged_events(READINGS, files))
    assert [event.time_s for event in events] == [0.0, 0.1, 0.2, 0.25, 0.3]
    np.testing.assert_allclose(events[1].points, POINTS)  # type: ignore[union-attr]


def test_folders_and_names_that_cannot_be(tmp_path: Path) -> None:
    with pytest.raises(RecordingBroken, match="no folder"):
        scan_files(tmp_path / "nowhere")
    with pytest.raises(RecordingBroken, match="no scan"):
        scan_files(tmp_path)
    (tmp_path / "first.ply").write_text("ply")
    with pytest.raises(RecordingBroken, match="named by its time"):
        scan_files(tmp_path)
