"""The other end of a serial encoder: a pty, reached through a link that can be taken away, and a wheel that somebody turns."""

from __future__ import annotations

import contextlib
import os
import threading
import tty
from collections.abc import Callable
from pathlib import Path

from tests.unit.drivers.encoder_contract import LiveRig

Reply = Callable[[bytes], bytes]


class Wire:
    """A pty whose port is ``port``, a link: gone when unplugged, at a new device when plugged in again."""

    def __init__(self, folder: Path) -> None:
        self.port = str(folder / "encoder")
        self._master = -1
        self.plug_in()

    def plug_in(self) -> None:
        """As udev does when the USB adapter comes."""
        self._master, port = os.openpty()
        tty.setraw(port)
        os.set_blocking(self._master, False)
        os.symlink(os.ttyname(port), self.port)
        os.close(port)

    def unplug(self) -> None:
        """The device vanishes, with its name."""
        master, self._master = self._master, -1
        if master >= 0:
            os.close(master)
        with contextlib.suppress(FileNotFoundError):
            os.unlink(self.port)

    def send(self, data: bytes) -> None:
        """What the encoder writes. Lost where nobody reads."""
        with contextlib.suppress(OSError):
            os.write(self._master, data)

    def receive(self) -> bytes:
        """What was written to the encoder since the last call."""
        try:
            return os.read(self._master, 4096)
        except OSError:
            return b""


class PtyRig(LiveRig):
    """``line`` is what the encoder says of a value by itself, again and again; ``reply`` what it answers to a question."""

    def __init__(self, folder: Path, line: Callable[[float], bytes] | None = None, period_s: float = 0.01) -> None:
        self.wire = Wire(folder)
        self.value = 0.0
        self._line = line
        self._period_s = period_s
        self._silent = threading.Event()
        self._stop = threading.Event()
        self._lock = threading.Lock()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def answer(self, asked: bytes) -> bytes:
        """What is sent back for what was written; overridden for encoders that are asked."""
        return b""

    def _run(self) -> None:
        while not self._stop.wait(self._period_s):
            with self._lock:
                asked = self.wire.receive()
                if self._silent.is_set():
                    continue
                if self._line is not None:
                    self.wire.send(self._line(self.value))
                if asked and (answer := self.answer(asked)):
                    self.wire.send(answer)

    def turn_to(self, value: float) -> None:
        self.value = value

    def fall_silent(self) -> None:
        self._silent.set()

    def unplug(self) -> None:
        with self._lock:
            self.wire.unplug()

    def plug_in(self) -> None:
        with self._lock:
            self.wire.plug_in()

    def close(self) -> None:
        self.encoder.close()
        self._stop.set()
        self._thread.join()
        self.wire.unplug()
