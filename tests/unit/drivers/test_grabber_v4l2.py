"""Frame grabbers: the driver over a capture and ioctls that behave like a grabber's, and over a real one with --hardware."""

from __future__ import annotations

import errno
import os
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.base import FrameTimeout, SensorLost, SensorMissing
from drivers.grabber import v4l2
from drivers.grabber.base import NoSignal
from drivers.grabber.v4l2 import FrameCount, V4l2Grabber, says_no_signal
from drivers.registry import open_grabber
from tests.unit.drivers.grabber_contract import READ_S, GrabberContract, LiveGrabberContract, LiveRig, Rig
from tests.unit.drivers.sensor_contract import drain

SIZE = (64, 48)
PERIOD_S = 0.02
SELECT_S = 1.5
"""How long cv2 waits for a picture before its read is False, here in place of 2 s."""


class Grabber:
    """What the grabber in the computer is doing. ``device`` is a file that stands in for its device node."""

    def __init__(self, device: Path) -> None:
        self.device = device
        self.status = 0
        self.silent = threading.Event()
        self.gone = threading.Event()
        self.skip = 0
        self.ioctls: list[tuple[int, bytes]] = []
        device.touch()

    def ioctl(self, descriptor: int, request: int, argument: bytes) -> bytes:
        """As the kernel answers."""
        if self.gone.is_set():
            raise OSError(errno.ENODEV, "No such device")
        self.ioctls.append((request, argument))
        if request == v4l2.G_INPUT:
            return struct.pack("=i", 1)
        if request == v4l2.ENUMINPUT:
            assert struct.unpack_from("=I", argument)[0] == 1
            return argument[: v4l2.STATUS_OFFSET] + struct.pack("=I", self.status) + argument[v4l2.STATUS_OFFSET + 4 :]
        return argument


class FakeCapture:
    """cv2.VideoCapture over V4L2: blocks until there is a picture, in one buffer that is used again."""

    def __init__(self, grabber: Grabber, device: str) -> None:
        self._grabber = grabber
        self._opened = Path(device).exists() and not grabber.gone.is_set()
        self._buffer = np.zeros((SIZE[1], SIZE[0], 3), np.uint8)
        self._stamp_s = time.monotonic()

    def grab(self) -> bool:
        waited_until = time.monotonic() + SELECT_S
        while time.monotonic() < waited_until:
            if not self._opened or self._grabber.gone.is_set():
                return False
            time.sleep(PERIOD_S / 2)
            if not self._grabber.silent.is_set() and time.monotonic() >= self._stamp_s + PERIOD_S:
                self._stamp_s += PERIOD_S * (1 + self._grabber.skip)
                self._grabber.skip = 0
                self._buffer[:] = 1 + (int(self._buffer[0, 0, 0]) + 1) % 250
                return True
        return False

    def retrieve(self) -> tuple[bool, Any]:
        return True, self._buffer

    def get(self, prop: int) -> float:
        return {cv2.CAP_PROP_POS_MSEC: 1000 * self._stamp_s, cv2.CAP_PROP_FPS: 1 / PERIOD_S}.get(prop, 0.0)

    def set(self, prop: int, value: float) -> bool:
        return True

    def isOpened(self) -> bool:
        return self._opened

    def release(self) -> None:
        self._opened = False


class V4l2Rig(LiveRig):
    width, height = SIZE

    def __init__(self, folder: Path, monkeypatch: pytest.MonkeyPatch, **arguments: Any) -> None:
        self.inside = Grabber(folder / "video0")
        monkeypatch.setattr(v4l2.fcntl, "ioctl", self.inside.ioctl)
        monkeypatch.setattr(v4l2.cv2, "VideoCapture", lambda device, *_: FakeCapture(self.inside, device))
        self.grabber = V4l2Grabber(str(self.inside.device), **arguments)

    def fall_silent(self) -> None:
        self.inside.silent.set()

    def unplug(self) -> None:
        self.inside.gone.set()
        self.inside.device.unlink(missing_ok=True)

    def plug_in(self) -> None:
        self.inside.gone.clear()
        self.inside.device.touch()

    def close(self) -> None:
        self.grabber.close()
        self.inside.gone.set()


class TestV4l2(LiveGrabberContract):
    @pytest.fixture
    def rig(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[V4l2Rig]:
        made = V4l2Rig(tmp_path, monkeypatch)
        yield made
        made.close()

    def test_a_lost_signal_is_no_picture_though_pictures_come(self, rig: V4l2Rig) -> None:
        rig.grabber.open()
        rig.grabber.read(READ_S)
        rig.inside.status = 0x2 | 0x100
        with pytest.raises(NoSignal, match="cable"):
            drain(rig.grabber, 0.7)
        rig.inside.status = 0
        assert rig.grabber.read(READ_S).image.any()

    def test_a_grabber_that_knows_no_status_is_believed(self, rig: V4l2Rig, monkeypatch: pytest.MonkeyPatch) -> None:
        def unknown(*_: Any) -> bytes:
            raise OSError(errno.ENOTTY, "Inappropriate ioctl")

        monkeypatch.setattr(v4l2.fcntl, "ioctl", unknown)
        rig.grabber.open()
        started = time.monotonic()
        while time.monotonic() - started < 0.7:
            rig.grabber.read(READ_S)

    def test_pictures_lost_on_the_bus_show_as_a_gap(self, rig: V4l2Rig) -> None:
        rig.grabber.open()
        for _ in range(10):
            last = rig.grabber.read(READ_S).number
        rig.inside.skip = 4
        numbers = [rig.grabber.read(READ_S).number for _ in range(12)]
        assert numbers[-1] - last == 12 + 4

    def test_an_unplugged_device_leaves_no_descriptor_behind(self, rig: V4l2Rig) -> None:
        before = len(os.listdir("/proc/self/fd"))
        for _ in range(3):
            rig.grabber.open()
            rig.grabber.read(READ_S)
            rig.unplug()
            with pytest.raises(SensorLost):
                drain(rig.grabber, 3.0)
            with pytest.raises(SensorMissing):
                rig.grabber.open()
            rig.plug_in()
        rig.grabber.close()
        assert len(os.listdir("/proc/self/fd")) <= before

    def test_a_reader_is_not_held_up_by_a_grabber_that_is_stuck(self, rig: V4l2Rig, monkeypatch: pytest.MonkeyPatch) -> None:
        stuck = threading.Event()
        grab = FakeCapture.grab
        monkeypatch.setattr(FakeCapture, "grab", lambda self: _hang(stuck) if stuck.is_set() else grab(self))
        rig.grabber.open()
        rig.grabber.read(READ_S)
        stuck.set()
        with pytest.raises(FrameTimeout):
            drain(rig.grabber, 0.3)
        started = time.monotonic()
        rig.grabber.close()
        assert time.monotonic() - started < 3.0
        stuck.clear()


def _hang(stuck: threading.Event) -> bool:
    while stuck.is_set():
        time.sleep(0.01)
    return False


def test_input_and_standard_are_chosen_before_it_starts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    rig = V4l2Rig(tmp_path, monkeypatch, input_index=1, standard="PAL")
    try:
        rig.grabber.open()
        # linux/videodev2.h: V4L2_STD_PAL is 0xFF
        assert rig.inside.ioctls[:2] == [(0xC0045627, b"\1\0\0\0"), (0x40085618, b"\xff" + bytes(7))]
    finally:
        rig.close()


def test_a_device_without_permission_names_the_group(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    rig = V4l2Rig(tmp_path, monkeypatch)

    def refuse(*_: Any, **__: Any) -> int:
        raise PermissionError(errno.EACCES, "Permission denied")

    monkeypatch.setattr(v4l2.os, "open", refuse)
    with pytest.raises(SensorMissing, match="group video"):
        rig.grabber.open()
    monkeypatch.undo()


def test_a_refused_setting_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    rig = V4l2Rig(tmp_path, monkeypatch, input_index=7)

    def refuse(*_: Any) -> bytes:
        raise OSError(errno.EINVAL, "Invalid argument")

    monkeypatch.setattr(v4l2.fcntl, "ioctl", refuse)
    with pytest.raises(SensorLost, match="Invalid argument"):
        rig.grabber.open()


def test_a_device_that_vanishes_while_it_is_opened_is_missing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    rig = V4l2Rig(tmp_path, monkeypatch)

    def vanished(*_: Any, **__: Any) -> int:
        raise OSError(errno.ENODEV, "No such device")

    monkeypatch.setattr(v4l2.os, "open", vanished)
    with pytest.raises(SensorMissing, match="plug it in"):
        rig.grabber.open()


def test_what_is_no_grabber_is_missing(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    for device in (tmp_path / "none", tmp_path / "file", Path("/dev/null")):
        with pytest.raises(SensorMissing) as caught:
            V4l2Grabber(str(device)).open()
        assert str(caught.value).endswith(".")


def test_devices_may_be_numbers() -> None:
    assert V4l2Grabber(2).name == open_grabber("v4l2", device="2").name == "frame grabber /dev/video2"
    with pytest.raises(ValueError, match="PAL or NTSC"):
        open_grabber("v4l2", device=0, standard="SECAM")


@pytest.mark.parametrize(("status", "lost"), [(0, False), (1, True), (2, True), (4, False), (0x30, False), (0x100, True)])
def test_what_the_status_of_an_input_means(status: int, lost: bool) -> None:
    assert says_no_signal(status) is lost


class TestFrameCount:
    def counted(self, stamps: list[float]) -> list[int]:
        count = FrameCount()
        return [count.add(stamp) for stamp in stamps]

    def test_even_pictures_count_one_each(self) -> None:
        assert self.counted([0.04 * index for index in range(50)]) == [1] * 50

    def test_a_gap_counts_what_is_missing(self) -> None:
        stamps = [0.04 * index for index in range(30) if index not in (10, 11, 20)]
        assert sum(self.counted(stamps)) == 30

    def test_a_camera_that_slows_down_in_the_dark_loses_nothing_for_ever(self) -> None:
        stamps = [index / 30 for index in range(60)]
        stamps += [stamps[-1] + index / 15 for index in range(1, 60)]
        assert self.counted(stamps)[-20:] == [1] * 20

    def test_sources_without_stamps(self) -> None:
        assert self.counted([0.0] * 10) == [1] * 10

    @given(st.lists(st.floats(allow_nan=False, allow_infinity=False, min_value=-1e9, max_value=1e9), max_size=40))
    def test_whatever_the_stamps_are_it_counts_on(self, stamps: list[float]) -> None:
        assert all(count >= 1 for count in self.counted(stamps))


def test_cv2_is_told_not_to_wait_ten_seconds() -> None:
    """It reads the variable once, when it is imported: the drivers set it first."""
    code = "import drivers.base, os; print(os.environ['OPENCV_VIDEOIO_V4L_SELECT_TIMEOUT'])"
    bare = {key: value for key, value in os.environ.items() if "V4L" not in key}
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, env=bare, timeout=60)
    assert found.stdout.strip() == "2"


class RealRig(Rig):
    def __init__(self) -> None:
        self.grabber = V4l2Grabber(os.environ.get("BORESCOUT_GRABBER", "/dev/video0"), size=(640, 480))
        self.width, self.height = 640, 480

    def close(self) -> None:
        self.grabber.close()


@pytest.mark.hardware
class TestRealGrabber(GrabberContract):
    """The device is $BORESCOUT_GRABBER, /dev/video0 where that is not set."""

    @pytest.fixture
    def rig(self) -> Iterator[Rig]:
        made = RealRig()
        yield made
        made.close()
