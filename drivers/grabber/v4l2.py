"""Frame grabbers on the USB bus: V4L2 through cv2, with the few ioctls that cv2 does not know.

A grabber whose camera is unplugged goes on sending noise or blue, so its input is asked for its status.
"""

from __future__ import annotations

import errno
import fcntl
import logging
import os
import struct
from collections import deque
from pathlib import Path
from statistics import median
from typing import Literal

import cv2

from drivers.base import SensorLost, SensorMissing
from drivers.grabber.live import Capture, LiveGrabber

log = logging.getLogger(__name__)

Standard = Literal["PAL", "NTSC"]

# linux/videodev2.h: _IOWR('V', 26, struct v4l2_input), _IOR('V', 38, int), _IOWR('V', 39, int), _IOW('V', 24, v4l2_std_id)
ENUMINPUT = 0xC050561A
G_INPUT = 0x80045626
S_INPUT = 0xC0045627
S_STD = 0x40085618
INPUT_BYTES = 80
STATUS_OFFSET = 56
NO_POWER, NO_SIGNAL, NO_H_LOCK, NO_SYNC = 0x1, 0x2, 0x100, 0x10000
STANDARDS: dict[Standard, int] = {"PAL": 0xFF, "NTSC": 0xB000}
RECENT = 25


def says_no_signal(status: int) -> bool:
    """Whether a V4L2 input status tells that no camera feeds the input."""
    return bool(status & (NO_POWER | NO_SIGNAL | NO_H_LOCK | NO_SYNC))


def input_status(descriptor: int) -> int | None:
    """The status bits of the input in use; None where the driver does not tell. Raises OSError when the device is gone."""
    try:
        current = fcntl.ioctl(descriptor, G_INPUT, bytes(4))
        filled = fcntl.ioctl(descriptor, ENUMINPUT, current + bytes(INPUT_BYTES - 4))
    except OSError as error:
        if error.errno in (errno.ENOTTY, errno.EINVAL):
            return None
        raise
    return int(struct.unpack_from("=I", filled, STATUS_OFFSET)[0])


class FrameCount:
    """How many pictures a source made between two that came, from their time stamps and the usual distance between them."""

    def __init__(self) -> None:
        self._last: float | None = None
        self._steps: deque[float] = deque(maxlen=RECENT)

    def add(self, stamp_s: float) -> int:
        """1, or more where pictures are missing before the one of ``stamp_s``."""
        last, self._last = self._last, stamp_s
        if last is None or not stamp_s > last:
            return 1
        step = stamp_s - last
        usual = median(self._steps) if len(self._steps) >= 5 else step
        self._steps.append(step)
        return max(1, round(step / usual))


def device_path(device: str | int) -> str:
    """The path of a V4L2 device that is named by its path or its number."""
    return f"/dev/video{device}" if isinstance(device, int) or device.isdigit() else device


class V4l2Grabber(LiveGrabber):
    """A V4L2 device such as /dev/video0.

    ``size`` and ``fps`` are asked for and not insisted on; ``input_index`` picks one of the grabber's sockets, ``standard`` the
    colour standard where the grabber does not find it by itself; ``codec`` four letters such as MJPG, where the bus is too slow
    for pictures as they are.
    """

    def __init__(
        self,
        device: str | int = "/dev/video0",
        size: tuple[int, int] = (720, 576),
        fps: float | None = None,
        input_index: int | None = None,
        standard: Standard | None = None,
        codec: str | None = None,
    ) -> None:
        self._device = device_path(device)
        if standard is not None and standard not in STANDARDS:
            raise ValueError(f"the standard is PAL or NTSC, got {standard}")
        if codec is not None and len(codec) != 4:
            raise ValueError(f"a codec has four letters, got {codec}")
        self._size = size
        self._codec = codec
        self._fps = fps
        self._input_index = input_index
        self._standard: Standard | None = standard
        self._status: int | None = None
        self._count = FrameCount()
        super().__init__(f"frame grabber {self._device}")

    def start(self) -> Capture:
        """See LiveGrabber."""
        if not Path(self._device).exists():
            raise SensorMissing(self.missing())
        self._close_status()
        try:
            # beside cv2's own: asking for the status does not disturb the stream
            self._status = os.open(self._device, os.O_RDWR | os.O_NONBLOCK | os.O_CLOEXEC)
            self._choose(self._status)
        except OSError as error:
            self._close_status()
            if error.errno == errno.EACCES:
                raise SensorMissing(f"The {self.name} may not be opened: this user is not in the group video.") from error
            if error.errno in (errno.ENODEV, errno.ENXIO, errno.ENOENT):
                raise SensorMissing(self.missing()) from error
            raise SensorLost(f"The {self.name} does not start: {os.strerror(error.errno or 0)}.") from error
        settings = [cv2.CAP_PROP_FRAME_WIDTH, self._size[0], cv2.CAP_PROP_FRAME_HEIGHT, self._size[1]]
        if self._codec is not None:
            settings = [cv2.CAP_PROP_FOURCC, cv2.VideoWriter.fourcc(*self._codec), *settings]
        capture = cv2.VideoCapture(self._device, cv2.CAP_V4L2, settings)
        if self._fps is not None:
            capture.set(cv2.CAP_PROP_FPS, self._fps)
        self._count = FrameCount()
        return capture

    def _choose(self, descriptor: int) -> None:
        if self._input_index is not None:
            fcntl.ioctl(descriptor, S_INPUT, struct.pack("=i", self._input_index))
        if self._standard is not None:
            fcntl.ioctl(descriptor, S_STD, struct.pack("=Q", STANDARDS[self._standard]))

    def missing(self) -> str:
        """See LiveGrabber."""
        return f"There is no {self.name}, or another program uses it: plug it in, or try another port."

    def has_signal(self) -> bool:
        """See LiveGrabber."""
        if self._status is None:
            return True
        try:
            status = input_status(self._status)
        except OSError as error:
            raise SensorLost(f"The {self.name} is gone: check its plug.") from error
        return status is None or not says_no_signal(status)

    def count_since_last(self, capture: Capture) -> int:
        """See LiveGrabber; the driver stamps each picture."""
        return self._count.add(capture.get(cv2.CAP_PROP_POS_MSEC) / 1000.0)

    def close(self) -> None:
        """See LiveGrabber."""
        super().close()
        self._close_status()

    def _close_status(self) -> None:
        descriptor, self._status = self._status, None
        if descriptor is not None:
            os.close(descriptor)
