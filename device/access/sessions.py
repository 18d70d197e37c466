"""Sessions: who was let in, kept on the disk as digests, so that a power cut unpairs nobody and a stolen file lets nobody in.

They age by the running time of the box: it has no clock while it is off.
"""

from __future__ import annotations

import hashlib
import hmac
import json
import logging
import secrets
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from device.durable import write_whole

log = logging.getLogger(__name__)

FILE_NAME = "sessions.json"
IDLE_S = 12 * 3600.0
"""A session that is not used for so long ends."""
LIFE_S = 7 * 24 * 3600.0
"""No session lives longer."""
MOST = 32
_SAVE_EVERY_S = 600.0  # ages on the disk may lag so far: an SD card does not bear a write for each request


@dataclass(frozen=True)
class Session:
    """Somebody who knew the PIN. ``id`` is no secret; times are seconds of the box's monotonic clock."""

    id: str
    digest: str
    name: str
    address: str
    made_s: float
    seen_s: float


class Sessions:
    """The sessions, and who of them was in control. ``folder`` None keeps them in memory. Not safe for threads."""

    def __init__(self, folder: Path | None, now: float) -> None:
        self._file = None if folder is None else folder / FILE_NAME
        self._known: dict[str, Session] = {}
        self._saved_s = now
        self.controller: str | None = None
        self._load(now)

    def __iter__(self) -> Iterator[Session]:
        return iter(list(self._known.values()))

    def __len__(self) -> int:
        return len(self._known)

    def begin(self, name: str, address: str, now: float) -> tuple[str, Session]:
        """A new session and its token, which is nowhere kept."""
        self.expire(now)
        while len(self._known) >= MOST:
            others = [session for session in self._known.values() if session.id != self.controller]
            self.end(min(others, key=lambda session: session.seen_s).id)
        token = secrets.token_urlsafe(32)
        session = Session(secrets.token_hex(4), _digest(token), name, address, now, now)
        self._known[session.id] = session
        return token, session

    def find(self, token: str, now: float) -> Session | None:
        """The session of that token, which has now been seen; None where there is none or it has expired."""
        if not token or len(token) > 100:
            return None
        digest = _digest(token)
        # Digests of secrets of 256 bits: what a comparison's time tells of one helps nobody to the token.
        session = next((known for known in self._known.values() if known.digest == digest), None)
        if session is None:
            return None
        if _expired(session, now):
            self.end(session.id)
            self.save(now)
            return None
        session = self._known[session.id] = replace(session, seen_s=now)
        if now - self._saved_s > _SAVE_EVERY_S:
            self.save(now)
        return session

    def get(self, number: str) -> Session | None:
        """The session with that id."""
        return self._known.get(number)

    def end(self, number: str) -> bool:
        """Forget a session; whether there was one."""
        return self._known.pop(number, None) is not None

    def expire(self, now: float) -> None:
        """Forget those whose time is over."""
        for session in self:
            if _expired(session, now):
                self.end(session.id)

    def silent_s(self, number: str, now: float) -> float | None:
        """For how long a session has not been seen; None for one that is gone."""
        session = self._known.get(number)
        return None if session is None or _expired(session, now) else now - session.seen_s

    def save(self, now: float) -> None:
        """Onto the disk. What cannot be written is logged: the sessions still hold until the box stops."""
        self._saved_s = now
        if self._file is None:
            return
        rows = [
            {
                "id": session.id,
                "digest": session.digest,
                "name": session.name,
                "address": session.address,
                "age_s": round(now - session.made_s, 1),
                "idle_s": round(now - session.seen_s, 1),
            }
            for session in self
        ]
        try:
            write_whole(self._file, json.dumps({"sessions": rows, "controller": self.controller}).encode(), 0o600)
        except OSError as error:
            log.error("the sessions cannot be kept in %s: %s", self._file, error)

    def _load(self, now: float) -> None:
        if self._file is None:
            return
        try:
            kept = json.loads(self._file.read_bytes())
            for row in kept["sessions"][:MOST]:
                number, digest, name, address = (row[key] for key in ("id", "digest", "name", "address"))
                if not all(isinstance(text, str) for text in (number, digest, name, address)):
                    raise ValueError("not a session")
                session = Session(number, digest, name, address, now - float(row["age_s"]), now - float(row["idle_s"]))
                self._known[session.id] = session
            self.controller = kept["controller"] if kept["controller"] in self._known else None
        except FileNotFoundError:
            return
        except (OSError, ValueError, TypeError, KeyError) as error:
            self._known.clear()
            log.warning("the sessions in %s cannot be read (%s): everybody has to pair again", self._file, error)


def csrf_of(token: str) -> str:
    """The token that each change must carry: only who holds the session's token can tell it."""
    return hmac.new(token.encode(), b"borescout csrf", hashlib.sha256).hexdigest()


def _digest(token: str) -> str:
    return hashlib.sha256(token.encode("utf-8", "replace")).hexdigest()


def _expired(session: Session, now: float) -> bool:
    return now - session.seen_s > IDLE_S or now - session.made_s > LIFE_S
