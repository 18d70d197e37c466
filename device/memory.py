"""Keeping the daemon small."""

from __future__ import annotations

import ctypes
import logging

log = logging.getLogger(__name__)

_M_ARENA_MAX = -8  # malloc.h
_ARENAS = 2


def share_heaps() -> None:
    """Let all threads share two heaps, where the C library can.

    glibc gives threads heaps of their own, and each keeps what numpy's temporaries left behind in it: in the virtual sewer
    90 MB of 310. To be called before threads are started.
    """
    try:
        mallopt = ctypes.CDLL(None).mallopt
    except (OSError, AttributeError):  # another C library has other habits
        log.debug("this C library has no mallopt")
        return
    mallopt(_M_ARENA_MAX, _ARENAS)


def give_back() -> None:
    """Return to the system what lies free in the heaps, where the C library can; to be called now and then.

    glibc keeps pages that are free but not at the end of a heap. With pictures of several MB, made and dropped by threads that
    come and go with the faults of a sensor, a third of the daemon's memory was such.
    """
    try:
        trim = ctypes.CDLL(None).malloc_trim
    except (OSError, AttributeError):
        log.debug("this C library has no malloc_trim")
        return
    trim(0)
