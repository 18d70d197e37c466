"""How long who guessed a wrong PIN has to wait: twice as long each time, and longer for everybody when many guess.

One address reaches ten minutes for each guess after a dozen. Somebody who owns every address of the hotspot is held by the
common pace: half of a million PINs then takes two months beside the box. An address that never guessed wrong is not held up
by those who did, so nobody can lock the operator out.
"""

from __future__ import annotations

import ipaddress
from collections import deque
from dataclasses import dataclass

FREE_GUESSES = 2
"""Slips of a finger that cost nothing."""
FIRST_DELAY_S = 2.0
LONGEST_DELAY_S = 600.0
FORGIVEN_AFTER_S = 24 * 3600.0
COMMON_FREE_GUESSES = 30
"""Wrong guesses of all together within COMMON_WINDOW_S before the common pace holds."""
COMMON_WINDOW_S = 3600.0
COMMON_DELAY_S = 10.0
_MOST_ADDRESSES = 1024


@dataclass
class _Guesser:
    wrong: int = 0
    last_s: float = 0.0


class Pace:
    """Counts wrong guesses by address. Times are seconds of any clock that only goes forward."""

    def __init__(self) -> None:
        self._guessers: dict[str, _Guesser] = {}
        self._recent: deque[float] = deque(maxlen=COMMON_FREE_GUESSES)

    def wait_s(self, address: str, now: float) -> float:
        """Seconds until ``address`` may guess again; 0 where it may now."""
        guesser = self._guessers.get(_household(address))
        if guesser is None:
            return 0.0
        if now - guesser.last_s > FORGIVEN_AFTER_S:
            del self._guessers[_household(address)]
            return 0.0
        until = guesser.last_s + _delay_s(guesser.wrong)
        if len(self._recent) == self._recent.maxlen and now - self._recent[0] < COMMON_WINDOW_S:
            until = max(until, self._recent[-1] + COMMON_DELAY_S)
        return max(0.0, until - now)

    def wrong(self, address: str, now: float) -> None:
        """``address`` guessed wrong."""
        key = _household(address)
        guesser = self._guessers.pop(key, None) or _Guesser()  # moves to the end: the first one is the longest silent
        guesser.wrong += 1
        guesser.last_s = now
        self._guessers[key] = guesser
        self._recent.append(now)
        while len(self._guessers) > _MOST_ADDRESSES:
            del self._guessers[next(iter(self._guessers))]

    def right(self, address: str) -> None:
        """``address`` knew the PIN: its slips are forgotten."""
        self._guessers.pop(_household(address), None)


def _delay_s(wrong: int) -> float:
    over = wrong - FREE_GUESSES
    return 0.0 if over <= 0 else float(min(LONGEST_DELAY_S, FIRST_DELAY_S * 2.0 ** min(over - 1, 20)))


def _household(address: str) -> str:
    """What counts as one guesser: an IPv4 address, or the /64 in which a machine may pick any IPv6 address it likes."""
    try:
        ip = ipaddress.ip_address(address.split("%")[0])
    except ValueError:
        return address
    if isinstance(ip, ipaddress.IPv6Address):
        if ip.ipv4_mapped is not None:
            return str(ip.ipv4_mapped)
        return str(ipaddress.ip_network((ip, 64), strict=False))
    return str(ip)
