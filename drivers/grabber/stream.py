"""Network streams through the FFmpeg of cv2."""

from __future__ import annotations

import re

import cv2

from drivers.grabber.live import Capture, LiveGrabber

OPEN_MS = 3000
READ_MS = 1500
"""cv2's own time-outs are 30 s. After one every read is False while isOpened() stays true: the stream is opened anew."""

_SCHEME = re.compile(r"[A-Za-z][A-Za-z0-9+.-]*://")
_SECRET = re.compile(r"(?<=://)[^/@]*@")


def without_secrets(url: str) -> str:
    """The address without user name and password, to be shown and logged."""
    return _SECRET.sub("", url)


class StreamGrabber(LiveGrabber):
    """A live stream: rtsp://, http://, udp:// and what else FFmpeg speaks. Raises ValueError for what is no such address."""

    def __init__(self, url: str) -> None:
        if not _SCHEME.match(url):
            raise ValueError(f"{url} is not the address of a stream (rtsp://..., http://...); a file is opened as a video.")
        self._url = url
        super().__init__(f"stream {without_secrets(url)}")

    def start(self) -> Capture:
        """See LiveGrabber."""
        settings = [
            *(cv2.CAP_PROP_OPEN_TIMEOUT_MSEC, OPEN_MS),
            *(cv2.CAP_PROP_READ_TIMEOUT_MSEC, READ_MS),
            # several decoding threads hold back as many pictures
            *(cv2.CAP_PROP_N_THREADS, 1),
        ]
        return cv2.VideoCapture(self._url, cv2.CAP_FFMPEG, settings)

    def missing(self) -> str:
        """See LiveGrabber."""
        return f"There is no {self.name}, or it is no video: check that the camera is on and its address right."
