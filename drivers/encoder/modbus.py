"""A Modbus RTU encoder (Briter and others): its position in two holding registers, read with function 03.

9600 baud 8N1 and register 0 are the makers' defaults: the question is ``01 03 00 00 00 02 C4 0B``. Frames are pymodbus's; its
client is not used, for it waits by the wall clock, which a browser may set back by hours while the box runs.
"""

from __future__ import annotations

import logging
import struct
import threading
import time
from collections.abc import Sequence
from typing import Literal

from pymodbus.exceptions import ModbusException
from pymodbus.framer import FramerRTU
from pymodbus.pdu import DecodePDU, ExceptionResponse
from pymodbus.pdu.register_message import ReadHoldingRegistersRequest, ReadHoldingRegistersResponse

from drivers.base import BadFrame, FrameTimeout
from drivers.encoder.base import Encoder, Reading
from drivers.encoder.serial_line import SerialLine
from drivers.encoder.unwrap import Unwrapper

WordOrder = Literal["big", "little"]
ANSWER_S = 0.2
"""An answer takes 9 characters at 9600 baud, some 10 ms, and the encoder's own time."""

# every fault is an exception or a count here already: pymodbus would write each torn frame into the log as well
logging.getLogger("pymodbus").setLevel(logging.CRITICAL)


class Refused(BadFrame):
    """The encoder answered that it will not."""


def question(device_id: int, address: int) -> bytes:
    """The frame that asks for two holding registers from ``address`` on."""
    return FramerRTU(DecodePDU(True)).buildFrame(ReadHoldingRegistersRequest(address=address, count=2, dev_id=device_id))


def registers_of(data: bytes, asked: bytes) -> tuple[int, int] | None:
    """The two registers in what came back for the question ``asked``, None where no whole answer is there.

    What comes ahead of the answer is passed over, such as the echo of the question on a two-wire line. Raises Refused.
    """
    device_id = asked[0]
    data = data.removeprefix(asked)
    framer = FramerRTU(DecodePDU(False))
    for start in range(max(0, len(data) - 4)):
        if data[start] != device_id:
            continue
        try:
            _, answer = framer.handleFrame(data[start:], device_id, 0)
        except (ModbusException, struct.error, IndexError, ValueError):
            continue
        if isinstance(answer, ExceptionResponse) and answer.function_code & 0x7F == asked[1]:
            raise Refused(f"The Modbus encoder refused the question for its position (exception {answer.exception_code}).")
        if isinstance(answer, ReadHoldingRegistersResponse) and len(answer.registers) == 2:
            first, second = answer.registers
            return first, second
    return None


def position(registers: Sequence[int], word_order: WordOrder) -> int:
    """The unsigned 32 bits of two registers; "big" has the high word first."""
    first, second = registers
    return first << 16 | second if word_order == "big" else second << 16 | first


class ModbusEncoder(Encoder):
    """A Modbus encoder, read ``rate_hz`` times a second. ``bits`` is the width of its position, which wraps.

    The count lives through ``close`` and ``open``.
    """

    def __init__(
        self,
        port: str,
        baud: int = 9600,
        *,
        device_id: int = 1,
        address: int = 0,
        word_order: WordOrder = "big",
        bits: int = 32,
        rate_hz: float = 20.0,
    ) -> None:
        if not rate_hz > 0:
            raise ValueError(f"the rate must be a positive number of readings a second, got {rate_hz}")
        if word_order not in ("big", "little"):
            raise ValueError(f"the word order is big or little, got {word_order}")
        if not 1 <= device_id <= 247 or not 0 <= address <= 0xFFFE:
            raise ValueError(f"device ids are 1 to 247, addresses 0 to 65534, got {device_id} and {address}")
        self.name = "Modbus encoder"
        self._line = SerialLine(self.name, port, baud)
        self._question = question(device_id, address)
        self._word_order: WordOrder = word_order
        self._period_s = 1.0 / rate_hz
        self._due_s = 0.0
        self._closed = threading.Event()
        self._unwrapper = Unwrapper(bits)

    def _open(self) -> None:
        self._line.open()
        self._closed.clear()
        self._due_s = 0.0

    def _read(self, timeout_s: float) -> Reading:
        deadline = time.monotonic() + timeout_s
        while True:
            wait_s = min(self._due_s, deadline) - time.monotonic()
            if wait_s > 0:
                self._closed.wait(wait_s)
            asked_ns = time.monotonic_ns()
            self._due_s = asked_ns / 1e9 + self._period_s
            registers = self._ask(min(asked_ns / 1e9 + ANSWER_S, deadline))
            if registers is not None:
                return Reading(
                    value=float(self._unwrapper.add(position(registers, self._word_order))),
                    monotonic_ns=(asked_ns + self._line.newest_ns) // 2,
                )
            if time.monotonic() >= deadline:
                raise FrameTimeout(f"The {self.name} sent no reading for {timeout_s:.3g} s.")

    def _ask(self, deadline: float) -> tuple[int, int] | None:
        """One question; None where no whole answer came before ``deadline``. Raises Refused, SensorLost."""
        self._line.discard()  # a late answer to the last question
        self._line.write(self._question)
        data = b""
        while True:
            data += self._line.some(max(0.0, deadline - time.monotonic()))
            registers = registers_of(data, self._question)
            if registers is not None:
                return registers
            if time.monotonic() >= deadline:
                self.rejected += bool(data.removeprefix(self._question))
                return None

    def close(self) -> None:
        """Stop and release. Never raises, may be called twice."""
        self._closed.set()
        self._line.close()
