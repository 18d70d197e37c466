"""Pictures lie outside of the heaps, so that what they leave behind is the system's at once."""

from __future__ import annotations

import subprocess
import sys

import pytest

LOOK = """
import ctypes, sys
import numpy as np
from device.memory import keep_heaps_small

class Heaps(ctypes.Structure):
    _fields_ = [(name, ctypes.c_size_t) for name in
                "arena ordblks smblks hblks hblkhd usmblks fsmblks uordblks fordblks keepcost".split()]

library = ctypes.CDLL(None)
if not hasattr(library, "mallinfo2"):
    sys.exit(77)
library.mallinfo2.restype = Heaps
if sys.argv[1] == "small":
    keep_heaps_small()
np.ones(10_000_000, np.uint8)  # made and dropped: from here on glibc would keep blocks up to this size in its heaps
pictures = [np.ones((576, 720, 3), np.uint8) for _ in range(20)]
print(sum(one.nbytes for one in pictures), library.mallinfo2().hblkhd)
"""


def outside(how: str) -> tuple[int, int]:
    """Bytes of twenty pictures, and bytes that lie outside of the heaps, in a process of its own."""
    done = subprocess.run([sys.executable, "-c", LOOK, how], capture_output=True, text=True, check=False)
    if done.returncode == 77:
        pytest.skip("another C library")
    assert done.returncode == 0, done.stderr
    pictures, own = map(int, done.stdout.split())
    return pictures, own


def test_pictures_have_pages_of_their_own() -> None:
    pictures, own = outside("small")
    assert own >= pictures
    pictures, own = outside("as it is")
    assert own < pictures / 2, "the C library does so by itself: device.memory can go"
