"""Live streams: a server that can fall silent, die and return, over the FFmpeg of cv2."""

from __future__ import annotations

import contextlib
import socket
import threading
import time
from collections.abc import Iterator

import cv2
import numpy as np
import pytest

from drivers.base import DriverError, SensorLost, SensorMissing
from drivers.grabber.stream import StreamGrabber, without_secrets
from drivers.registry import open_grabber
from tests.unit.drivers.grabber_contract import READ_S, LiveGrabberContract, LiveRig
from tests.unit.drivers.sensor_contract import drain

WIDTH, HEIGHT = 160, 120
PERIOD_S = 0.03


def picture(count: int) -> bytes:
    """A JPEG whose grey level tells its number."""
    found, data = cv2.imencode(".jpg", np.full((HEIGHT, WIDTH, 3), 40 + 5 * (count % 40), np.uint8))
    assert found
    return data.tobytes()


class MjpegServer:
    """Motion JPEG over HTTP, as network cameras send it. One thread for each viewer."""

    def __init__(self, port: int = 0) -> None:
        self._listener = socket.create_server(("127.0.0.1", port))
        self.port = self._listener.getsockname()[1]
        self.silent = threading.Event()
        self.garbage = threading.Event()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._accept, daemon=True)
        self._thread.start()

    def _accept(self) -> None:
        while not self._stop.is_set():
            try:
                peer, _ = self._listener.accept()
            except OSError:
                return
            threading.Thread(target=self._serve, args=(peer,), daemon=True).start()

    def _serve(self, peer: socket.socket) -> None:
        with peer, contextlib.suppress(OSError):
            peer.recv(4096)
            peer.sendall(b"HTTP/1.0 200 OK\r\nContent-Type: multipart/x-mixed-replace; boundary=frame\r\n\r\n")
            count = 0
            while not self._stop.wait(PERIOD_S):
                if self.silent.is_set():
                    continue
                count += 1
                data = bytes(2000) if self.garbage.is_set() else picture(count)
                head = b"--frame\r\nContent-Type: image/jpeg\r\nContent-Length: %d\r\n\r\n" % len(data)
                peer.sendall(head + data + b"\r\n")

    def close(self) -> None:
        self._stop.set()
        # accept() in another thread keeps a closed socket listening until it is woken
        with contextlib.suppress(OSError):
            self._listener.shutdown(socket.SHUT_RDWR)
        self._listener.close()
        self._thread.join()


class StreamRig(LiveRig):
    width, height = WIDTH, HEIGHT

    def __init__(self) -> None:
        self.server: MjpegServer | None = MjpegServer()
        self.port = self.server.port
        self.grabber = StreamGrabber(f"http://user:secret@127.0.0.1:{self.port}/video.mjpg")

    def fall_silent(self) -> None:
        assert self.server is not None
        self.server.silent.set()

    def unplug(self) -> None:
        if self.server is not None:
            self.server.close()
        self.server = None

    def plug_in(self) -> None:
        self.server = MjpegServer(self.port)

    def close(self) -> None:
        self.grabber.close()
        self.unplug()


class TestStream(LiveGrabberContract):
    @pytest.fixture
    def rig(self) -> Iterator[StreamRig]:
        made = StreamRig()
        yield made
        made.close()

    def test_after_a_silence_it_is_lost_and_stays_so_until_it_is_opened_again(self, rig: StreamRig) -> None:
        rig.grabber.open()
        rig.grabber.read(READ_S)
        rig.fall_silent()
        started = time.monotonic()
        with pytest.raises(SensorLost, match="stopped sending"):
            drain(rig.grabber, READ_S)
        assert time.monotonic() - started < 6.0
        assert rig.server is not None
        rig.server.silent.clear()
        with pytest.raises(SensorLost):
            rig.grabber.read(1.0)
        rig.grabber.open()
        assert rig.grabber.read(READ_S).image.any()

    def test_a_server_that_accepts_and_never_answers_is_missing_in_time(self) -> None:
        with socket.create_server(("127.0.0.1", 0)) as mute:
            grabber = StreamGrabber(f"http://127.0.0.1:{mute.getsockname()[1]}/")
            started = time.monotonic()
            with pytest.raises(DriverError):
                grabber.open()
            assert time.monotonic() - started < 8.0

    def test_no_sentence_and_no_frame_tells_the_password(self, rig: StreamRig) -> None:
        rig.grabber.open()
        assert "secret" not in rig.grabber.name + rig.grabber.read(READ_S).source
        rig.unplug()
        with pytest.raises(SensorLost) as lost:
            drain(rig.grabber, 3.0)
        with pytest.raises(SensorMissing) as missing:
            rig.grabber.open()
        assert "secret" not in str(lost.value) + str(missing.value)

    def test_pictures_that_are_none_cost_time_and_nothing_else(self, rig: StreamRig) -> None:
        rig.grabber.open()
        rig.grabber.read(READ_S)
        assert rig.server is not None
        rig.server.garbage.set()
        with pytest.raises(DriverError):
            drain(rig.grabber, 0.5)
        rig.server.garbage.clear()
        rig.grabber.open()
        assert rig.grabber.read(READ_S).image.any()

    def test_the_newest_picture_is_the_newest(self, rig: StreamRig) -> None:
        """A reader that sleeps for a second gets what the camera sent last, not what waits in a buffer."""
        rig.grabber.open()
        rig.grabber.read(READ_S)
        time.sleep(1.0)
        frames = [rig.grabber.read(READ_S) for _ in range(8)]
        levels = [int(np.median(frame.image)) for frame in frames]
        # the server counts up by 5 grey levels a picture; the numbers tell the same gap
        assert (levels[-1] - levels[0]) % 200 == pytest.approx(5 * (frames[-1].number - frames[0].number) % 200, abs=6)
        assert time.monotonic_ns() - frames[-1].monotonic_ns < 0.3e9


@pytest.mark.parametrize("url", ["", "video.mp4", "/dev/video0", "http:/x"])
def test_what_is_no_address_is_refused(url: str) -> None:
    with pytest.raises(ValueError, match="not the address of a stream"):
        open_grabber("stream", url=url)


@pytest.mark.parametrize("url", ["rtsp://127.0.0.1:1/x", "http://127.0.0.1:1/", "nonsense://127.0.0.1/"])
def test_where_nobody_listens_it_is_missing(url: str) -> None:
    with pytest.raises(SensorMissing, match="stream"):
        StreamGrabber(url).open()


def test_secrets_are_cut_out_of_addresses() -> None:
    assert without_secrets("rtsp://a:b@c/d@e") == "rtsp://c/d@e"
    assert without_secrets("rtsp://c/d@e") == "rtsp://c/d@e"
