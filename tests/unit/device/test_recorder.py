"""What is written comes back, in its order and bit by bit; nothing that the disk does reaches the survey."""

from __future__ import annotations

import errno
import os
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from device.recorder import Recorder, Shelf
from device.recorder import recorder as recorder_module
from device.recorder.names import Name, name_of
from device.recorder.policy import MB, DiskPolicy
from device.recorder.reader import open_recording
from device.recorder.recovery import check
from device.recorder.samples import Words, as_recorded, decoded, picture
from drivers.depth.base import DepthFrame
from drivers.grabber.base import VideoFrame
from tests.unit.device.recorder_samples import CAMERA, cctv, depth_frame, reading, recording
from tests.waiting import wait_until

ROOMY = 10_000 * MB


def samples(folder: Path) -> list[tuple[str, Any]]:
    """All but the head."""
    found = open_recording(next(iter(sorted(folder.glob("*.mcap"))))).entries()
    return [(entry.topic, entry.sample) for entry in found][1:]


def test_everything_comes_back_in_its_order(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path, Name(3, 1, 1), {"kind": "diameter"}).open()
    written = [
        ("/camera/a", depth_frame(1)),
        ("/cctv", cctv(2)),
        ("/tether", reading(3)),
        ("/camera/a", depth_frame(4, color=False)),
        ("/survey/prompts", Words("aim", "Turn the box.")),
        ("/survey/steps", {"frame": 3, "chainage": 0.1, "none": None, "list": [1.5, "a"]}),
    ]
    for topic, sample in written:
        assert recorder.write(topic, sample)
    recorder.close()
    assert recorder.status().state == "finished"
    back = samples(tmp_path)
    assert [topic for topic, _ in back] == [topic for topic, _ in written]
    for (_, given), (_, got) in zip(written, back, strict=True):
        if isinstance(given, DepthFrame):
            assert np.array_equal(got.depth, given.depth)
            assert got.depth.dtype == np.uint16
            expected = as_recorded(given).color
            assert (got.color is None and expected is None) or np.array_equal(got.color, expected)
            assert replace(got, depth=given.depth, color=given.color) == given
        else:
            assert got == given
    assert open_recording(tmp_path / "survey-000003-01-001.mcap").head == {"kind": "diameter", "offset_ns": 0}


def test_what_is_judged_of_a_picture_is_what_is_recorded() -> None:
    image = np.random.default_rng(1).integers(0, 256, (48, 64, 3)).astype(np.uint8)
    recorded = picture(VideoFrame(image, 5, 6, 7.0, "x"))
    assert recorded.frame().media_s == 7.0
    assert np.array_equal(recorded.frame().image, decoded(recorded.jpeg))
    with pytest.raises(ValueError, match="no JPEG"):
        decoded(b"nonsense")


def test_foxglove_finds_its_own_schemas(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path, Name(3, 1, 1), {}, offset_ns=5).open()
    brown = replace(CAMERA, model="brown_conrady")
    recorder.write("/camera/a", depth_frame(1))
    recorder.write("/camera/a", replace(depth_frame(2), intrinsics=brown))
    recorder.close()
    with (tmp_path / "survey-000003-01-001.mcap").open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
        found = [
            (schema.name if schema else "", channel.topic, message, sample)
            for schema, channel, message, sample in reader.iter_decoded_messages(
                topics=["/camera/a/depth", "/camera/a/color", "/camera/a/calibration"]
            )
        ]
    assert {name for name, *_ in found} == {"foxglove.RawImage", "foxglove.CompressedImage", "foxglove.CameraCalibration"}
    raw = next(sample for name, _, _, sample in found if name == "foxglove.RawImage")
    assert (raw.encoding, raw.width, raw.height, raw.step, raw.frame_id) == ("16UC1", 64, 48, 128, "a")
    assert (raw.timestamp.seconds, raw.timestamp.nanos) == (1, 12)
    lenses: list[CameraCalibration] = [sample for name, _, _, sample in found if name == "foxglove.CameraCalibration"]
    assert len(lenses) == 2
    assert list(lenses[0].K) == [50.5, 0, 31.5, 0, 51.25, 23.5, 0, 0, 1]
    assert not lenses[0].distortion_model  # Foxglove has no word for it: better none than a wrong one
    assert not list(lenses[0].D)
    assert (lenses[1].distortion_model, list(lenses[1].D)) == ("plumb_bob", [0.1, -0.2, 0.001, 0.002, 0.03])


def test_it_is_on_the_disk_within_a_second_though_nothing_follows(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path, Name(3, 1, 1), {}).open()
    file = recorder._log.file  # type: ignore[union-attr]
    before = file.synced
    recorder.write("/tether", reading(1))
    wait_until(lambda: recorder.status().written == 2 and recorder.status().behind_s == 0)
    assert before < file.synced == file.size
    cut = tmp_path / "cut"
    cut.mkdir()
    (cut / "survey-000003-01-001.mcap").write_bytes((tmp_path / "survey-000003-01-001.mcap").read_bytes()[: file.synced])
    assert samples(cut) == [("/tether", reading(1))]
    recorder.close()


def test_a_slow_disk_costs_pictures_that_are_counted_and_no_notes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(recorder_module, "MOST_WAITING", 3 * 64 * 48 * 2)
    recorder = Recorder(tmp_path, Name(3, 1, 1), {}).open()
    with recorder._condition:  # the recorder's thread stands still
        taken = [recorder.write("/camera/a", depth_frame(number, color=False)) for number in range(5)]
        assert recorder.write("/tether", reading(1))
    recorder.close()
    assert taken.count(True) in (3, 4)  # it may have fetched the head, or one more
    assert recorder.status().dropped == taken.count(False)
    back = samples(tmp_path)
    assert [sample.number for _, sample in back if isinstance(sample, DepthFrame)] == [n for n, ok in enumerate(taken) if ok]
    sequences = [entry.sequence for entry in open_recording(tmp_path / "survey-000003-01-001.mcap").entries()]
    assert sequences[0] == 0


def test_a_long_recording_is_many_files_and_read_as_one(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path, Name(3, 1, 1), {"kind": "x"}, part_bytes=20_000).open()
    for number in range(6):
        recorder.write("/cctv", cctv(number, (120, 160)))
        wait_until(lambda number=number: recorder.status().written == number + 2)
        wait_until(lambda: recorder.status().behind_s == 0)
    recorder.close()
    files = sorted(tmp_path.glob("*.mcap"))
    assert len(files) > 2
    assert recorder.status().bytes == sum(file.stat().st_size for file in files)
    assert all(check(file).ok for file in files)
    assert [sample.number for _, sample in samples(tmp_path)] == list(range(6))
    assert open_recording(files[1]).files == tuple(files)


class FullDisk:
    """``os.write`` on a disk that takes so many bytes more; the last write is cut short, as the kernel does it."""

    def __init__(self, left: int, number: int = errno.ENOSPC) -> None:
        self.left = left
        self._number = number

    def __call__(self, descriptor: int, data: memoryview) -> int:
        if self.left <= 0:
            raise OSError(self._number, os.strerror(self._number))
        taken = min(len(data), self.left)
        self.left -= taken
        return _write(descriptor, data[:taken])


_write = os.write


@pytest.mark.parametrize("left", [0, 5, 60, 5_000, 40_000, 120_000])
def test_a_full_disk_ends_the_recording_and_keeps_what_was_safe(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, left: int
) -> None:
    monkeypatch.setattr("device.recorder.writer.os.write", FullDisk(left))
    changes: list[int] = []
    recorder = Recorder(tmp_path, Name(3, 1, 1), {}, on_change=lambda: changes.append(1)).open()
    for number in range(8):
        recorder.write("/cctv", cctv(number, (120, 160)))
    recorder.close()
    monkeypatch.undo()
    status = recorder.status()
    assert status.state in ("off", "stopped")
    assert "disk is full" in status.message
    assert changes
    assert not recorder.recording
    assert not recorder.write("/tether", reading(1))
    for file in tmp_path.glob("*.mcap"):
        assert not check(file).ok
        assert check(file).recovered
        assert check(file).damaged == 0  # cut back to the last whole chunk


def test_a_broken_disk_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("device.recorder.writer.os.write", FullDisk(1000, errno.EIO))
    recorder = Recorder(tmp_path, Name(3, 1, 1), {}).open()
    recorder.write("/cctv", cctv(1))
    recorder.close()
    assert (
        recorder.status().message == "Recording has ended: the disk does not take it (Input/output error). The survey goes on."
    )


def test_what_nobody_wants_leaves_no_file(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path, Name(3, 1, 1), {}).open()
    recorder.write("/cctv", cctv(1))
    recorder.close(discard=True)
    assert not list(tmp_path.iterdir())


def test_nor_where_its_recording_had_ended_before(tmp_path: Path) -> None:
    may_go_on = [True]
    recorder = Recorder(tmp_path, Name(3, 1, 1), {}, may_go_on=lambda: may_go_on[0]).open()
    may_go_on[0] = False
    recorder.write("/cctv", cctv(1))
    wait_until(lambda: not recorder.recording)
    assert recorder.lost
    recorder.close(discard=True)
    assert not list(tmp_path.iterdir())


def test_the_oldest_go_first_and_then_recording_stops(tmp_path: Path) -> None:
    free = [ROOMY]
    old = [recording(tmp_path, 2, survey=number) for number in (1, 2, 3)]
    size = old[0].stat().st_size
    policy = DiskPolicy(keep_free=100 * MB, stop_free=50 * MB, findings_free=10 * MB)
    shelf = Shelf(tmp_path, policy, free=lambda folder: free[0] - sum(path.stat().st_size for path in old if path.exists()))
    now = shelf.begin(4, {"kind": "x"})
    now.write("/cctv", cctv(1))
    free[0] = 100 * MB + 3 * size - 1  # room for two old ones
    wait_until(lambda: not old[0].exists())
    assert old[1].exists()
    assert now.recording
    free[0] = 40 * MB  # something else fills the disk: they could not make room enough
    wait_until(lambda: not now.recording)
    assert (now.status().state, now.status().message[:16]) == ("stopped", "Recording is off")
    assert check(shelf.files(4)[0]).ok  # ended cleanly
    assert old[1].exists()
    refused = shelf.begin(5, {}).status()
    assert (refused.state, refused.message) == ("off", now.status().message)
    assert shelf.files(5) == []
    free[0] = 5 * MB  # findings are in danger
    assert not shelf.make_room()
    assert [path.exists() for path in old] == [False, False, False]
    assert shelf.status()["pruned"] == 4


def test_each_take_of_a_survey_has_its_own_file(tmp_path: Path) -> None:
    shelf = Shelf(tmp_path, free=lambda folder: ROOMY)
    for _ in range(2):
        shelf.begin(9, {}).close()
    assert [name_of(path) for path in shelf.files(9)] == [Name(9, 1, 1), Name(9, 2, 1)]
    shelf.remove(9)
    assert shelf.files(9) == []


def test_turned_off(tmp_path: Path) -> None:
    recorder = Shelf(tmp_path, enabled=False).begin(1, {})
    assert not recorder.write("/tether", reading(1))
    assert recorder.status().message == "Recording is turned off in the settings."
    recorder.close()
    assert not list(tmp_path.glob("*.mcap"))
