"""The door of the box: pairing, sessions and control behind one lock, with an event whenever the control changes."""

from __future__ import annotations

import hmac
import logging
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from device.access.control import CONSENT_S, Control
from device.access.pace import Pace
from device.access.sessions import Session, Sessions, csrf_of
from device.errors import Forbidden, NotFound, TooSoon, WrongPin

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Paired:
    """A session just begun: its secret token, and what each of its changes must carry."""

    token: str
    csrf: str
    session: Session


class Access:
    """``pin`` lets in; ``folder`` keeps the sessions over a restart (None: nowhere); ``publish`` is told of each change."""

    def __init__(
        self,
        pin: str,
        *,
        folder: Path | None = None,
        publish: Callable[[dict[str, Any]], None] = lambda state: None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.pin = pin
        self._publish = publish
        self._clock = clock
        self._lock = threading.RLock()
        self._pace = Pace()
        self._sessions = Sessions(folder, clock())
        self._control = Control(self._sessions.silent_s, self._sessions.controller)

    # Coming and going

    def pair(self, pin: str, address: str, name: str, old_token: str = "") -> Paired:
        """Let somebody in who knows the PIN. The session of ``old_token`` ends and its control goes on with the new one.

        Raises WrongPin, and TooSoon (without looking at the PIN) while ``address`` has to wait.
        """
        with self._lock:
            now = self._clock()
            wait_s = self._pace.wait_s(address, now)
            if wait_s > 0:
                raise TooSoon(wait_s)
            if not hmac.compare_digest(pin.encode(), self.pin.encode()):
                self._pace.wrong(address, now)
                log.warning("a wrong PIN from %s", address)
                raise WrongPin(self._pace.wait_s(address, now))
            self._pace.right(address)
            old = self._sessions.find(old_token, now)
            token, session = self._sessions.begin(name, address, now)
            if old is not None:
                self._control.rename(old.id, session.id)
                self._sessions.end(old.id)
            self._control.take_if_free(session.id, now)
            log.info("%s paired from %s", name, address)
            self._changed(now)
            return Paired(token, csrf_of(token), session)

    def session(self, token: str) -> Session | None:
        """The session of a token, or None. Being asked for is what keeps a session alive."""
        with self._lock:
            now = self._clock()
            session = self._sessions.find(token, now)
            if self._control.settle(now):
                self._changed(now)
            return session

    def csrf_fits(self, token: str, csrf: str) -> bool:
        """Whether ``csrf`` belongs to the session with that token."""
        return hmac.compare_digest(csrf_of(token).encode(), csrf.encode())

    def csrf(self, token: str) -> str:
        """What each change of the session with that token must carry."""
        return csrf_of(token)

    def end(self, number: str) -> None:
        """End a session: at its own wish, or because it is sent away. Raises NotFound."""
        with self._lock:
            now = self._clock()
            if not self._sessions.end(number):
                raise NotFound("That phone is not paired.")
            self._control.settle(now)
            self._changed(now)

    def devices(self) -> list[dict[str, Any]]:
        """Who is paired: {"id", "name", "address", "controls", "silent_s"}."""
        with self._lock:
            now = self._clock()
            self._sessions.expire(now)
            return [
                {
                    "id": session.id,
                    "name": session.name,
                    "address": session.address,
                    "controls": session.id == self._control.holder,
                    "silent_s": round(now - session.seen_s, 1),
                }
                for session in self._sessions
            ]

    # Control

    def may_change(self, session: Session) -> None:
        """Nothing where ``session`` controls the box, or nobody does, and then it does from now on. Raises Forbidden."""
        with self._lock:
            now = self._clock()
            before = (self._control.holder, self._control.request)
            self._control.take_if_free(session.id, now)
            if (self._control.holder, self._control.request) != before:
                self._changed(now)
            if self._control.holder != session.id:
                raise Forbidden(f"{self._name(self._control.holder)} controls the box: ask for the control first.")

    def ask(self, session: Session) -> dict[str, Any]:
        """``session`` wants the control; the state. Raises Busy."""
        return self._do(self._control.ask, session)

    def grant(self, session: Session) -> dict[str, Any]:
        """``session`` gives the control to who asked; the state. Raises Forbidden."""
        return self._do(self._control.grant, session)

    def refuse(self, session: Session) -> dict[str, Any]:
        """``session`` keeps the control; the state. Raises Forbidden."""
        return self._do(self._control.refuse, session)

    def release(self, session: Session) -> dict[str, Any]:
        """``session`` gives the control up, or its request; the state."""
        return self._do(self._control.release, session)

    def state(self) -> dict[str, Any]:
        """Who controls and who asks: {"controller": {"id", "name"} or None, "request": {"id", "name", "left_s"} or None}."""
        with self._lock:
            return self._state(self._clock())

    def _do(self, action: Callable[[str, float], None], session: Session) -> dict[str, Any]:
        with self._lock:
            now = self._clock()
            action(session.id, now)
            self._changed(now)
            return self._state(now)

    def _state(self, now: float) -> dict[str, Any]:
        holder, request = self._control.holder, self._control.request
        return {
            "controller": None if holder is None else {"id": holder, "name": self._name(holder)},
            "request": None
            if request is None
            else {
                "id": request.by,
                "name": self._name(request.by),
                "left_s": round(max(0.0, request.since_s + CONSENT_S - now), 1),
            },
        }

    def _name(self, number: str | None) -> str:
        session = None if number is None else self._sessions.get(number)
        return "Nobody" if session is None else session.name

    def _changed(self, now: float) -> None:
        self._sessions.controller = self._control.holder
        self._sessions.save(now)
        self._publish(self._state(now))
