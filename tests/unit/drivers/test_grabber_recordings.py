"""Recordings in place of a CCTV camera: video files and folders of stills."""

from __future__ import annotations

import shutil
import time
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.base import DriverError, EndOfRecording, FrameTimeout, RecordingBroken, SensorMissing
from drivers.grabber.base import FrameGrabber, VideoFrame
from drivers.grabber.paced import PacedGrabber
from drivers.grabber.stills import StillsFolder, named_time_s
from drivers.grabber.video import VideoFile, next_media_s
from drivers.registry import GRABBERS, open_grabber
from tests.unit.drivers.grabber_contract import READ_S, RecordingContract, Rig

SIZE = (96, 64)
CODES = {".avi": "MJPG", ".mp4": "mp4v", ".mkv": "FFV1"}


def write_video(path: Path, frames: int, rate: float = 25.0) -> Path:
    """A video whose grey level counts up by 8 a picture from 20."""
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*CODES[path.suffix]), rate, SIZE)
    assert writer.isOpened()
    for index in range(frames):
        writer.write(np.full((SIZE[1], SIZE[0], 3), 20 + 8 * index, np.uint8))
    writer.release()
    return path


def _read_all(grabber: FrameGrabber) -> tuple[list[VideoFrame], DriverError]:
    """Every picture up to the first fault, and the fault."""
    frames: list[VideoFrame] = []
    while len(frames) < 100:
        try:
            frames.append(grabber.read())
        except DriverError as fault:
            return frames, fault
    raise AssertionError("it does not end")


def write_still(folder: Path, name: str, level: int = 90) -> None:
    folder.mkdir(exist_ok=True)
    assert cv2.imwrite(str(folder / name), np.full((SIZE[1], SIZE[0], 3), level, np.uint8))


class RecordingRig(Rig):
    width, height = SIZE

    def __init__(self, grabber: FrameGrabber) -> None:
        self.grabber = grabber

    def close(self) -> None:
        self.grabber.close()


@pytest.mark.parametrize("suffix", CODES, scope="class")
class TestVideo(RecordingContract):
    frames_in_recording = 12

    @pytest.fixture
    def rig(self, tmp_path: Path, suffix: str) -> Iterator[Rig]:
        made = RecordingRig(VideoFile(write_video(tmp_path / f"run{suffix}", 12)))
        yield made
        made.close()

    def test_every_picture_has_its_time_in_the_video(self, rig: Rig) -> None:
        rig.grabber.open()
        frames = [rig.grabber.read(READ_S) for _ in range(12)]
        assert [frame.media_s for frame in frames] == pytest.approx([index / 25.0 for index in range(12)], abs=1e-3)
        assert [int(np.median(frame.image)) for frame in frames] == pytest.approx([20 + 8 * i for i in range(12)], abs=4)
        assert rig.grabber.frame_rate == pytest.approx(25.0)
        assert frames[0].time_s == frames[0].media_s

    def test_a_slow_reader_loses_nothing(self, rig: Rig) -> None:
        rig.grabber.open()
        numbers = []
        for _ in range(6):
            numbers.append(rig.grabber.read(READ_S).number)
            time.sleep(0.05)
        assert numbers == [1, 2, 3, 4, 5, 6]


class TestStills(RecordingContract):
    frames_in_recording = 5

    @pytest.fixture
    def rig(self, tmp_path: Path) -> Iterator[Rig]:
        for index, name in enumerate(("9000.jpg", "10000.png", "11000.5.bmp", "12000.JPG", "100000.jpeg")):
            write_still(tmp_path / "run", name, 30 + 20 * index)
        made = RecordingRig(StillsFolder(tmp_path / "run"))
        yield made
        made.close()

    def test_their_order_and_time_is_that_of_their_names(self, rig: Rig) -> None:
        rig.grabber.open()
        frames = [rig.grabber.read() for _ in range(5)]
        assert [frame.media_s for frame in frames] == [9.0, 10.0, 11.0005, 12.0, 100.0]
        assert [int(np.median(frame.image)) for frame in frames] == pytest.approx([30, 50, 70, 90, 110], abs=2)
        assert [frame.source for frame in frames] == ["9000.jpg", "10000.png", "11000.5.bmp", "12000.JPG", "100000.jpeg"]
        assert rig.grabber.frame_rate == pytest.approx(1.0, rel=0.01)


class TestVideoFaults:
    def test_missing_files_and_no_videos_are_named(self, tmp_path: Path) -> None:
        (tmp_path / "empty.mp4").touch()
        (tmp_path / "text.avi").write_text("not a video")
        for name in ("gone.mp4", "empty.mp4", "text.avi", ".", "-i.mp4", "http:"):
            with pytest.raises(RecordingBroken) as caught:
                VideoFile(tmp_path / name).open()
            assert str(caught.value).endswith(".")

    def test_a_name_like_an_option_or_an_address_is_a_file(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        write_video(tmp_path / "run.avi", 3)
        monkeypatch.chdir(tmp_path)
        for name in ("-y.avi", "concat:run.avi", "run%03d.avi"):
            shutil.copy(tmp_path / "run.avi", tmp_path / name)
            grabber = VideoFile(name)
            grabber.open()
            assert grabber.read().number == 1
            grabber.close()

    def test_a_video_that_breaks_off_says_so_once(self, tmp_path: Path) -> None:
        path = write_video(tmp_path / "run.avi", 30)
        whole = path.read_bytes()
        path.write_bytes(whole[: (whole.find(b"movi") + whole.find(b"idx1")) // 2])
        grabber = VideoFile(path)
        grabber.open()
        frames, fault = _read_all(grabber)
        assert 5 < len(frames) < 25
        assert isinstance(fault, RecordingBroken)
        assert f"{frames[-1].number} of its" in str(fault)
        with pytest.raises(EndOfRecording):
            grabber.read()
        grabber.close()

    def test_garbage_in_the_middle_is_survived(self, tmp_path: Path) -> None:
        path = write_video(tmp_path / "run.avi", 30)
        data = bytearray(path.read_bytes())
        fourth = data.find(b"\xff\xd8\xff", data.find(b"movi") + 700)
        data[fourth + 20 : fourth + 180] = bytes(160)
        path.write_bytes(data)
        grabber = VideoFile(path)
        grabber.open()
        frames, fault = _read_all(grabber)
        assert isinstance(fault, EndOfRecording)
        assert 27 <= len(frames) < 30
        assert frames[-1].number == 30  # the lost one shows as a gap
        assert frames[-1].time_s == pytest.approx(29 / 25)
        assert all(later.time_s > earlier.time_s for earlier, later in pairwise(frames))
        grabber.close()


@given(st.lists(st.floats(allow_nan=True, allow_infinity=True), max_size=30), st.floats(1.0, 120.0))
def test_times_in_a_video_grow_whatever_its_stamps_are(stamps: list[float], rate: float) -> None:
    last: float | None = None
    for stamp in stamps:
        media_s = next_media_s(min(stamp, 1e12), last, rate)
        assert media_s >= 0
        assert last is None or media_s > last
        last = media_s


def test_a_video_without_stamps_is_timed_by_its_rate() -> None:
    assert next_media_s(0.0, None, 25.0) == 0.0
    assert next_media_s(0.0, 0.0, 25.0) == pytest.approx(0.04)
    assert next_media_s(40.0, 0.0, 30.0) == pytest.approx(0.04)


class TestStillsFaults:
    def test_folders_without_stills_are_named(self, tmp_path: Path) -> None:
        with pytest.raises(RecordingBroken, match="There is no folder"):
            StillsFolder(tmp_path / "gone").open()
        write_still(tmp_path, "picture.png")
        with pytest.raises(RecordingBroken, match="no picture whose name is a number of milliseconds"):
            StillsFolder(tmp_path).open()

    def test_pictures_without_a_time_are_left_out_and_counted(self, tmp_path: Path) -> None:
        for name in ("1000.png", "overview.png", "x2000.png", "-5.png"):
            write_still(tmp_path, name)
        (tmp_path / "notes.txt").write_text("3000")
        grabber = StillsFolder(tmp_path)
        grabber.open()
        assert "3 pictures" in grabber.notice
        assert grabber.frame_count == 1
        assert grabber.frame_rate is None

    def test_two_pictures_of_one_moment_are_refused(self, tmp_path: Path) -> None:
        write_still(tmp_path, "1000.png")
        write_still(tmp_path, "1000.jpg")
        with pytest.raises(RecordingBroken, match="two pictures of one moment"):
            StillsFolder(tmp_path).open()

    def test_a_broken_still_is_named_and_left_behind_and_its_number_is_missing(self, tmp_path: Path) -> None:
        for name in ("0.png", "1.png", "2.png", "3.png"):
            write_still(tmp_path, name)
        (tmp_path / "1.png").write_bytes(b"no picture")
        (tmp_path / "2.png").unlink()
        (tmp_path / "2.png").mkdir()
        grabber = StillsFolder(tmp_path)
        grabber.open()
        assert grabber.read().number == 1
        for name in ("1", "2"):
            with pytest.raises(RecordingBroken, match=rf"{name}\.png"):
                grabber.read()
        assert grabber.read().number == 4

    @pytest.mark.parametrize(
        ("name", "said"),
        [("0.jpg", 0.0), ("129000.jpg", 129.0), ("1.5.png", 0.0015), ("1e3.png", None), ("٣.png", None), ("a1.png", None)],
    )
    def test_names(self, name: str, said: float | None) -> None:
        assert named_time_s(Path(name)) == said


def test_the_recorded_run(data_dir: Path) -> None:
    grabber = open_grabber("stills", folder=data_dir / "cctv_run")
    grabber.open()
    assert grabber.frame_count == 218
    assert grabber.frame_rate == pytest.approx(1.0)
    frame = grabber.read()
    assert frame.image.shape == (480, 720, 3)


def test_the_registry_knows_its_kinds(tmp_path: Path) -> None:
    with pytest.raises(SensorMissing, match="v4l2, stream, video, stills"):
        open_grabber("webcam")
    assert isinstance(open_grabber("video", file=tmp_path / "x.mp4"), VideoFile)
    assert {"v4l2", "stream", "video", "stills"} <= set(GRABBERS)


def test_a_paced_recording_takes_as_long_as_it_was_made_and_goes_on_when_played_again(tmp_path: Path) -> None:
    grabber = PacedGrabber(VideoFile(write_video(tmp_path / "run.avi", 5, rate=20.0)))
    begun = time.monotonic()
    grabber.open()
    first, fault = _read_all(grabber)
    assert isinstance(fault, EndOfRecording)
    assert 0.2 <= time.monotonic() - begun < 2.0
    assert [frame.time_s for frame in first] == pytest.approx([0.0, 0.05, 0.1, 0.15, 0.2], abs=1e-6)
    grabber.close()
    grabber.open()
    again, _ = _read_all(grabber)
    assert [frame.time_s for frame in again] == pytest.approx([0.25, 0.3, 0.35, 0.4, 0.45], abs=1e-6)
    grabber.close()


def test_a_paced_picture_that_is_not_due_is_waited_for_and_not_lost(tmp_path: Path) -> None:
    grabber = PacedGrabber(VideoFile(write_video(tmp_path / "run.avi", 3, rate=5.0)))
    grabber.open()
    numbers = [grabber.read().number]
    with pytest.raises(FrameTimeout, match="not due"):
        grabber.read(0.02)
    numbers += [grabber.read().number, grabber.read().number]
    assert np.diff(numbers).tolist() == [1, 1]
    grabber.close()
