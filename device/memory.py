"""Keeping the daemon small."""

from __future__ import annotations

import ctypes
import logging

log = logging.getLogger(__name__)

_M_MMAP_THRESHOLD, _M_ARENA_MAX = -3, -8  # malloc.h
_ARENAS = 2
_OWN_PAGES_FROM = 256 * 1024  # bytes


def keep_heaps_small() -> None:
    """Let all threads share two heaps, and keep pictures out of them, where the C library can.

    glibc gives threads heaps of their own, and each keeps what numpy's temporaries left behind in it: in the virtual sewer
    90 MB of 310. And as soon as one large block was freed it puts large blocks into the heaps as well, where pictures that live
    on lie scattered between holes: 120 MB more after a quarter of an hour, and growing by some 70 MB an hour. With a limit that
    stands, a picture has pages of its own, which the system has back at once; the pipeline of a drive is no slower for it, only
    drawing the virtual sewer is. To be called before threads are started.
    """
    try:
        mallopt = ctypes.CDLL(None).mallopt
    except (OSError, AttributeError):  # another C library has other habits
        log.debug("this C library has no mallopt")
        return
    mallopt(_M_ARENA_MAX, _ARENAS)
    mallopt(_M_MMAP_THRESHOLD, _OWN_PAGES_FROM)


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
