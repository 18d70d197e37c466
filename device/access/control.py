"""One controls, the others watch: who is asked, who grants, and what happens when nobody answers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from device.errors import Busy, Forbidden

CONSENT_S = 30.0
"""A request that is neither granted nor refused in this time is granted."""
ABSENT_S = 20.0
"""Who has not been heard of for so long (a phone in a pocket) is not asked."""
PAUSE_AFTER_REFUSAL_S = 60.0


@dataclass(frozen=True)
class Request:
    """Who wants the control, since when (s)."""

    by: str
    since_s: float


class Control:
    """The rules, without a clock: every call is told the time (s) and knows sessions by their numbers only.

    ``silent_s(session)`` tells for how long a session has not been heard of; None for one that is gone.
    """

    def __init__(self, silent_s: Callable[[str, float], float | None], holder: str | None = None) -> None:
        self._silent_s = silent_s
        self.holder = holder
        self.request: Request | None = None
        self._refused: dict[str, float] = {}

    def settle(self, now: float) -> bool:
        """Bring everything up to ``now``: those who are gone, the request that was left unanswered. True where it changed."""
        before = (self.holder, self.request)
        if self.holder is not None and self._silent_s(self.holder, now) is None:
            self.holder = None
        if self.request is not None:
            if self._silent_s(self.request.by, now) is None:
                self.request = None
            elif self.holder is None or now - self.request.since_s >= CONSENT_S:
                self._hand_to(self.request.by)
        return (self.holder, self.request) != before

    def take_if_free(self, who: str, now: float) -> None:
        """``who`` has the control where nobody else has it."""
        self.settle(now)
        if self.holder is None:
            self._hand_to(who)

    def ask(self, who: str, now: float) -> None:
        """``who`` wants the control; has it at once where nobody holds it or the holder is absent. Raises Busy."""
        self.settle(now)
        if self.holder == who:
            return
        silent = None if self.holder is None else self._silent_s(self.holder, now)
        if silent is None or silent > ABSENT_S:
            self._hand_to(who)
            return
        if self.request is not None:
            if self.request.by != who:
                raise Busy("Somebody else has just asked for the control; wait for the answer.")
            return
        left = self._refused.get(who, now) - now
        if left > 0:
            raise Busy(f"You were refused the control a moment ago; ask again in {left:.0f} s.")
        self.request = Request(who, now)

    def grant(self, who: str, now: float) -> None:
        """The holder ``who`` gives the control to the one who asked. Raises Forbidden."""
        request = self._asked(who, now)
        if request is not None:
            self._hand_to(request.by)

    def refuse(self, who: str, now: float) -> None:
        """The holder ``who`` keeps the control; the one who asked may ask again after a while. Raises Forbidden."""
        request = self._asked(who, now)
        if request is not None:
            self._refused = {by: until for by, until in self._refused.items() if until > now}
            self._refused[request.by] = now + PAUSE_AFTER_REFUSAL_S
            self.request = None

    def release(self, who: str, now: float) -> None:
        """``who`` no longer wants the control, or no longer asks for it."""
        self.settle(now)
        if self.request is not None and self.request.by == who:
            self.request = None
        if self.holder == who:
            self.holder = None
            self.settle(now)

    def rename(self, old: str, new: str) -> None:
        """The session ``old`` goes on as ``new``."""
        if self.holder == old:
            self.holder = new
        if self.request is not None and self.request.by == old:
            self.request = Request(new, self.request.since_s)

    def _asked(self, who: str, now: float) -> Request | None:
        self.settle(now)
        if self.holder != who:
            raise Forbidden("Only who controls the box can answer that.")
        return self.request

    def _hand_to(self, who: str) -> None:
        self.holder = who
        self._refused.pop(who, None)
        if self.request is not None and self.request.by == who:
            self.request = None
