"""The RD line of an MTNW LCI-90 line counter: ``RD,tension,speed,payout,checksum``.

The checksum is the decimal sum of the ASCII codes before it, commas included. A logger may have put an address before RD and a
time ahead of the numbers; both count in the sum: a logged
``03RD,2022-05-14T16:17:36.502,-0000168,00000000,-00004.8,2839`` has tension -168, speed 0 and payout -4.8.
"""

from __future__ import annotations

import re

from drivers.encoder.numerals import number_and_step
from drivers.encoder.serial_line import LineEncoder, LineValue

# a line that was torn and went on with the next one has two heads: the search for the head is anchored at the start
_HEAD = re.compile(rb"[0-9A-Za-z]{0,4}?RD", re.ASCII)


def parse_rd(line: bytes, metres_per_unit: float = 1.0) -> LineValue | None:
    """What an RD line says, None where it is none or its sum is wrong. Its lengths are in the unit the counter is set to."""
    body, comma, said = line.strip().rpartition(b",")
    fields = body.split(b",")
    if not comma or not said.isdigit() or len(fields) not in (4, 5) or not _HEAD.fullmatch(fields[0]):
        return None
    if int(said) != sum(body) + ord(","):
        return None
    numbers = [number_and_step(field.decode("latin-1")) for field in fields[-3:]]
    tension, speed, payout = numbers
    if tension is None or speed is None or payout is None:
        return None
    return LineValue(
        value=payout[0] * metres_per_unit,
        unit="m",
        quantum=payout[1] * metres_per_unit,
        speed=speed[0] * metres_per_unit,
        tension=tension[0],
    )


class Lci90Encoder(LineEncoder):
    """An LCI-90. ``baud`` is a setting of the counter, and so is its unit: ``metres_per_unit`` is 0.3048 where it shows feet.

    ``Reading.speed`` is in metres per the counter's own unit of time.
    """

    def __init__(self, port: str, baud: int = 9600, metres_per_unit: float = 1.0) -> None:
        super().__init__(port, baud, "LCI-90 line counter")
        self._metres_per_unit = metres_per_unit

    def parse(self, line: bytes) -> LineValue | None:
        """See ``parse_rd``."""
        return parse_rd(line, self._metres_per_unit)
