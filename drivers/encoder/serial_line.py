"""A serial port that hands out whole lines, and the encoder that speaks in them.

``port`` is a device such as /dev/ttyUSB0 or an address for ``serial.serial_for_url`` such as socket://host:port.
"""

from __future__ import annotations

import contextlib
import errno
import termios
import threading
import time
from abc import abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, TypeVar

import serial

from drivers.base import BadFrame, FrameTimeout, SensorLost, SensorMissing
from drivers.encoder.base import Encoder, Reading, Unit

Result = TypeVar("Result")

SLICE_S = 0.1
"""How often a read that waits looks whether it has been closed."""
WRITE_S = 1.0
LINE_LIMIT = 256
"""Bytes without an end of line beyond which there is no line: no counter writes as much."""

# pyserial raises SerialException (an OSError) where it looks itself and lets everything else through: a bare OSError or a
# termios.error, which is none, when the other end is gone; a TypeError from select() when another thread closes the port.
PORT_FAULTS = (OSError, termios.error, TypeError, ValueError, AttributeError)


class SerialLine:
    """One port. Every fault of it is SensorMissing (``open``) or SensorLost (the rest).

    ``dtr`` and ``rts`` are set after opening where they are not None; ports without such lines do not mind.
    """

    def __init__(self, name: str, port: str, baud: int, *, dtr: bool | None = None, rts: bool | None = None) -> None:
        self._name = name
        self._port = port
        self._baud = baud
        self._dtr = dtr
        self._rts = rts
        self._serial: Any = None
        self._lock = threading.Lock()
        self._buffer = bytearray()
        self.newest_ns = 0
        """When the last bytes came, on the host's monotonic clock."""

    def open(self) -> None:
        """Open the port anew. Raises SensorMissing, SensorLost."""
        self.close()
        try:
            port = serial.serial_for_url(self._port, do_not_open=True, timeout=SLICE_S, write_timeout=WRITE_S)
            port.baudrate = self._baud
            if not _is_address(self._port):
                port.exclusive = True
            # before it opens, so that the lines never pass through the wrong level
            for line, level in (("dtr", self._dtr), ("rts", self._rts)):
                if level is not None:
                    setattr(port, line, level)
            port.open()
        except PORT_FAULTS as error:
            raise SensorMissing(why_not(self._name, self._port, error)) from error
        self._buffer.clear()
        with self._lock:
            self._serial = port

    def some(self, timeout_s: float) -> bytes:
        """Whatever comes, as soon as something comes; empty after ``timeout_s`` of silence. Raises SensorLost."""
        deadline = time.monotonic() + timeout_s
        while True:
            wait_s = min(SLICE_S, max(0.0, deadline - time.monotonic()))
            data = self._call(partial(_available, wait_s=wait_s))
            if data:
                self.newest_ns = time.monotonic_ns()
            if data or time.monotonic() >= deadline:
                return data

    def lines(self, timeout_s: float) -> list[bytes]:
        """All whole lines that have come, without their ends, oldest first; empty after ``timeout_s`` without one.

        The rest of an unfinished line waits for its end. Raises SensorLost.
        """
        deadline = time.monotonic() + timeout_s
        while True:
            self._buffer += self.some(max(0.0, deadline - time.monotonic()))
            *whole, rest = bytes(self._buffer).replace(b"\r", b"\n").split(b"\n")
            self._buffer[:] = b"" if len(rest) > LINE_LIMIT else rest
            found = [line for line in whole if line]
            if found or time.monotonic() >= deadline:
                return found

    def write(self, data: bytes) -> None:
        """Send. Raises SensorLost."""
        self._call(lambda port: port.write(data))

    def discard(self) -> None:
        """Forget what has come so far. Raises SensorLost."""
        self._call(lambda port: port.reset_input_buffer())
        self._buffer.clear()

    def close(self) -> None:
        """Never raises, may be called twice, from any thread."""
        with self._lock:
            port, self._serial = self._serial, None
        if port is None:
            return
        with contextlib.suppress(*PORT_FAULTS):  # it may be gone already, which is what is asked for
            port.close()

    def _call(self, call: Callable[[Any], Result]) -> Result:
        port = self._serial
        if port is None:
            raise SensorLost(f"The {self._name} is not open.")
        try:
            return call(port)
        except PORT_FAULTS as error:
            if self._serial is None:
                raise SensorLost(f"The {self._name} has been closed.") from error
            raise SensorLost(f"The {self._name} at {self._port} is gone: check its plug.") from error


@dataclass(frozen=True)
class LineValue:
    """What one line says. ``value`` in ``unit`` with the step ``quantum`` that its digits resolve."""

    value: float
    unit: Unit = "counts"
    quantum: float = 1.0
    speed: float | None = None
    tension: float | None = None


class LineEncoder(Encoder):
    """An encoder that sends a line for each reading by itself. A driver says what a line means: ``parse``.

    The newest line wins: where several have piled up, the older ones are passed over, since nobody knows when they came.
    """

    def __init__(self, port: str, baud: int, name: str) -> None:
        self.name = name
        self._line = SerialLine(name, port, baud)

    @abstractmethod
    def parse(self, line: bytes) -> LineValue | None:
        """What one line without its end says, None where it is no reading."""

    def unwrapped(self, value: LineValue) -> float:
        """The value of a line that counts; overridden where the counter wraps. Called once for each line, in their order."""
        return value.value

    def _open(self) -> None:
        self._line.open()

    def _read(self, timeout_s: float) -> Reading:
        deadline = time.monotonic() + timeout_s
        refused = b""
        while True:
            reading: Reading | None = None
            for line in self._line.lines(max(0.0, deadline - time.monotonic())):
                value = self.parse(line)
                if value is None:
                    self.rejected += 1
                    refused = line
                    continue
                reading = Reading(
                    value=self.unwrapped(value),
                    monotonic_ns=self._line.newest_ns,
                    unit=value.unit,
                    quantum=value.quantum,
                    speed=value.speed,
                    tension=value.tension,
                )
            if reading is not None:
                return reading
            if time.monotonic() >= deadline:
                break
        if refused:
            raise BadFrame(f"The {self.name} sends lines that are no readings, {shown(refused)}: check its baud rate.")
        raise FrameTimeout(f"The {self.name} sent no reading for {timeout_s:.3g} s.")

    def close(self) -> None:
        """Stop and release. Never raises, may be called twice."""
        self._line.close()


def _available(port: Any, wait_s: float) -> bytes:
    """All the bytes that are there; where there are none, those that come first within ``wait_s``."""
    port.timeout = wait_s
    first: bytes = port.read(1)
    if not first:
        return b""
    port.timeout = 0
    rest: bytes = port.read(4096)
    return first + rest


def shown(line: bytes) -> str:
    """The beginning of a line, fit for a sentence."""
    text = "".join(chr(byte) if 32 <= byte < 127 else "?" for byte in line[:24])
    return f'"{text}{"..." if len(line) > 24 else ""}"'


def why_not(name: str, port: str, error: Exception) -> str:
    """The sentence for a port that does not open."""
    number = getattr(error, "errno", None)
    if number == errno.EACCES:
        return f"The port {port} of the {name} may not be opened: this user is not in its group (mostly dialout)."
    if number in (errno.EBUSY, errno.EAGAIN, errno.EWOULDBLOCK):
        return f"The port {port} of the {name} is used by another program."
    if _is_address(port):
        return f"Nothing answers at {port}, where the {name} should be."
    return f"There is no {name} at {port}: check its plug and the name of the port."


def _is_address(port: str) -> bool:
    return "://" in port
