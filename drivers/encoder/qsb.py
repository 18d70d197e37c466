"""US Digital QSB quadrature encoder adapter (command list v1.28).

Commands are ``{R|W|S}{register, 2 hex}[data]`` and a line end, answers ``{r|w|s|e|x}{register}{data, 8 hex}[time, 8 hex]!``:
"e" is an error, "x" unsupported. There is no checksum, so an answer counts only whole and for the register that was asked.
The count is asked for each reading: so it is fresh, and its moment is known to half the time that the answer took.
"""

from __future__ import annotations

import re
import threading
import time
from dataclasses import dataclass

from drivers.base import BadFrame, FrameTimeout, SensorLost
from drivers.encoder.base import Encoder, Reading
from drivers.encoder.serial_line import SerialLine, shown
from drivers.encoder.unwrap import Unwrapper

BAUD = 230400
COUNT = 0x0E
STATUS = 0x06
POWER_LOSS = 0x02
"""Bit of the status register: the adapter lost its power since the status was last cleared, and its count with it."""
SETUP = ((0x00, "0"), (0x03, "3"), (0x15, "F"))
"""Quadrature; x4, free running (the factory setting counts modulo 500); full replies. Never W092, which clears the count."""
ANSWER_S = 0.3

_ANSWER = re.compile(rb"([rwsex])\s*([0-9A-Fa-f]{2})\s*([0-9A-Fa-f]{8})\s*(?:([0-9A-Fa-f]{8})\s*)?!\s*")


@dataclass(frozen=True)
class Answer:
    """One answer: its letter, the register, the 32 bits as they are, and the time stamp (1/512 s) where there is one."""

    letter: str
    register: int
    data: int
    stamp: int | None


def parse_answer(line: bytes) -> Answer | None:
    """What a line answers, None where it is no whole answer."""
    match = _ANSWER.fullmatch(line)
    if match is None:
        return None
    letter, register, data, stamp = match.groups()
    return Answer(letter.decode(), int(register, 16), int(data, 16), None if stamp is None else int(stamp, 16))


class QsbEncoder(Encoder):
    """A QSB on its USB port, read ``rate_hz`` times a second. The count lives through ``close`` and ``open``."""

    def __init__(self, port: str, baud: int = BAUD, rate_hz: float = 50.0) -> None:
        if not rate_hz > 0:
            raise ValueError(f"the rate must be a positive number of readings a second, got {rate_hz}")
        self.name = "QSB encoder"
        # DTR going high, low, high would reset it
        self._line = SerialLine(self.name, port, baud, dtr=True, rts=False)
        self._period_s = 1.0 / rate_hz
        self._due_s = 0.0
        self._closed = threading.Event()
        self._unwrapper = Unwrapper()

    def _open(self) -> None:
        self._line.open()
        self._closed.clear()
        self._due_s = 0.0
        try:
            for register, data in SETUP:
                self._ask(f"W{register:02X}{data}", "w", register, ANSWER_S)
            status = self._ask(f"R{STATUS:02X}", "r", STATUS, ANSWER_S)
        except (FrameTimeout, BadFrame) as fault:
            self.close()
            raise SensorLost(f"What is plugged in as {self.name} does not answer like one: {fault}") from fault
        except SensorLost:
            self.close()
            raise
        self.notice = "The encoder lost its power: its count began again at zero." if status.data & POWER_LOSS else ""

    def _read(self, timeout_s: float) -> Reading:
        deadline = time.monotonic() + timeout_s
        wait_s = min(self._due_s, deadline) - time.monotonic()
        if wait_s > 0:
            self._closed.wait(wait_s)
        asked_ns = time.monotonic_ns()
        answer = self._ask(f"R{COUNT:02X}", "r", COUNT, max(0.0, deadline - time.monotonic()))
        self._due_s = asked_ns / 1e9 + self._period_s
        return Reading(
            value=float(self._unwrapper.add(answer.data)),
            monotonic_ns=(asked_ns + self._line.newest_ns) // 2,
        )

    def _ask(self, command: str, letter: str, register: int, timeout_s: float) -> Answer:
        """Raises FrameTimeout, BadFrame (it refused), SensorLost."""
        self._line.discard()  # a late answer to the last question
        self._line.write(command.encode("ascii") + b"\r\n")
        deadline = time.monotonic() + timeout_s
        while True:
            for line in self._line.lines(max(0.0, deadline - time.monotonic())):
                answer = parse_answer(line)
                if answer is None:
                    self.rejected += 1
                elif answer.register == register and answer.letter == letter:
                    return answer
                elif answer.register == register and answer.letter in "ex":
                    raise BadFrame(f"The {self.name} refused {command}: it answered {shown(line)}.")
            if time.monotonic() >= deadline:
                raise FrameTimeout(f"The {self.name} sent no reading for {timeout_s:.3g} s.")

    def close(self) -> None:
        """Stop and release. Never raises, may be called twice."""
        self._closed.set()
        self._line.close()
