"""What an uninvited client can send to `borescout serve --virtual`: how many requests were tried, how many let through.

    python -m tests.bench.intrusion

Every route of the box and every method, taken from its own document: without a session; with forged cookies; with a right
session, but a foreign Host, Origin or CSRF token; as somebody who only watches; with a session that has ended; and paths that
climb out of their folder. Let through is what is answered with a success, or holds what only those may see who are let in.
"""

from __future__ import annotations

import argparse
import http.client
import json
import re
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tests.bench.daemon import running
from tests.bench.table import print_table
from tests.pairing import COOKIE, CSRF, PIN, Pass, pair

METHODS = ("GET", "HEAD", "POST", "PUT", "PATCH", "DELETE", "OPTIONS", "TRACE", "PROPFIND")
CHANGES = ("POST", "PUT", "PATCH", "DELETE")
FILES = (b"root:", b"SQLite format", b'"digest"', b"import ")
"""What no answer may hold: a system file, the database, the sessions, a source file."""
SESSION = b"csrf-token"
"""What no answer to somebody without a session may hold: a page of somebody's session."""


@dataclass(frozen=True)
class Route:
    """A route of the box: an address that it matches, and which methods it takes from whom."""

    path: str
    public: frozenset[str]
    private: frozenset[str]


def routes(document: dict[str, Any]) -> list[Route]:
    """Every route that the document tells of, parameters filled in."""
    found = []
    for template, operations in document["paths"].items():
        some = next(iter(operations.values()))
        path = template
        for parameter in some.get("parameters", []):
            path = path.replace(f"{{{parameter['name']}}}", _value(parameter["schema"]))
        public = {method.upper() for method, operation in operations.items() if operation["security"] == []}
        private = {method.upper() for method in operations} - public
        found.append(Route(path, frozenset(public | ({"HEAD", "OPTIONS"} if "GET" in public else set())), frozenset(private)))
    return found


def _value(schema: dict[str, Any]) -> str:
    if "enum" in schema:
        return str(schema["enum"][0])
    return str(max(1, schema.get("minimum", 1))) if schema["type"] == "integer" else "0" * schema.get("minLength", 1)


class Box:
    """The box as an uninvited client reaches it: one connection after the other, nothing tidied up on the way."""

    def __init__(self, port: int) -> None:
        self.port = port
        self._connection: http.client.HTTPConnection | None = None
        self._asked = 0

    def ask(self, method: str, path: str, headers: dict[str, str] | None = None, body: bytes = b"{}") -> tuple[int, bytes]:
        """Status and the beginning of the answer. Comes from ever new addresses: it is the door that is tried, not the pace."""
        self._asked += 1
        if self._asked % 60 == 0:
            self.close()
        for again in (False, True):
            if self._connection is None:
                source = f"127.0.{4 + self._asked // 15000}.{self._asked // 60 % 250 + 1}"
                self._connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=30, source_address=(source, 0))
            sent = {"Host": f"127.0.0.1:{self.port}", "Content-Type": "application/json", **(headers or {})}
            try:
                self._connection.putrequest(method, path, skip_host=True, skip_accept_encoding=True)
                for name, value in sent.items():
                    self._connection.putheader(name, value)
                self._connection.putheader("Content-Length", str(len(body)))
                self._connection.endheaders(body)
                answer = self._connection.getresponse()
                start = answer.read(4096)
                place = answer.getheader("Location", "")
                if answer.status == 308 and place.startswith(f"http://{sent['Host']}/"):
                    return self.ask(method, place.removeprefix(f"http://{sent['Host']}"), headers, body)  # slashes made one
                if not answer.isclosed() or answer.will_close:
                    self.close()
                return answer.status, start
            except (OSError, http.client.HTTPException):
                self.close()
                if again:
                    return 0, b""  # cut off: nothing was let through
        raise AssertionError("unreachable")

    def close(self) -> None:
        """Begin a new connection with the next request."""
        if self._connection is not None:
            self._connection.close()
            self._connection = None


class Tally:
    """What was tried and what came through, by kind of attack."""

    def __init__(self) -> None:
        self.tried: Counter[str] = Counter()
        self.through: list[tuple[str, str, int]] = []
        self.kinds: dict[str, Counter[int]] = {}

    def note(self, kind: str, request: str, status: int, start: bytes) -> None:
        """Count one answer."""
        self.tried[kind] += 1
        self.kinds.setdefault(kind, Counter())[status] += 1
        secrets = FILES if kind == "path traversal" else (*FILES, SESSION)
        if 100 <= status < 400 or status >= 500 or any(secret in start for secret in secrets):
            self.through.append((kind, request, status))


def try_everything(port: int, tally: Tally) -> None:
    """All attacks, against a box to which nobody is paired yet."""
    box = Box(port)
    _, text = _whole(port, "/api/v1/openapi.json")
    every = routes(json.loads(text))
    _without_session(box, every, tally)
    controller = pair(port, name="Controller")
    watcher = pair(port, name="Watcher")
    before = _state(port, controller)
    _forged(box, every, tally, controller)
    _watching(box, every, tally, watcher)
    _climbing(box, tally, controller)
    _replayed(box, every, tally, port)
    _guessed(box, tally)
    if _state(port, controller) != before:
        tally.through.append(("all", "the pipes, nodes or surveys of the box were changed", 0))


def _private(every: Iterable[Route]) -> Iterator[tuple[str, str]]:
    for route in every:
        for method in METHODS:
            if method not in route.public:
                yield method, route.path


def _changes(every: Iterable[Route]) -> Iterator[tuple[str, str]]:
    for route in every:
        for method in CHANGES:
            if method in route.private:
                yield method, route.path


def _without_session(box: Box, every: list[Route], tally: Tally) -> None:
    for method, path in _private(every):
        tally.note("no session", f"{method} {path}", *box.ask(method, path))
    cookies = (
        f"{COOKIE}=",
        f"{COOKIE}=0",
        f"{COOKIE}={'A' * 43}",
        f"{COOKIE}={'A' * 5000}",
        f"{COOKIE}=../../sessions.json",
        f"{COOKIE}=' OR 1=1 --",
        f"{COOKIE}=%00; session=admin; role=controller",
        f"{COOKIE}=null; {COOKIE}=undefined",
    )
    for cookie in cookies:
        for method, path in _private(every):
            if method in ("GET", *CHANGES):
                headers = {"Cookie": cookie, CSRF: "0" * 64}
                tally.note("forged cookie", f"{method} {path} {cookie[:40]}", *box.ask(method, path, headers))


def _forged(box: Box, every: list[Route], tally: Tally, paired: Pass) -> None:
    port = box.port
    hosts = (
        "evil.example",
        f"evil.example:{port}",
        f"127.0.0.1.evil.example:{port}",
        "8.8.8.8",
        "evil.local",
        "",
        "a b",
        "[::ffff:8.8.8.8]",
    )
    origins = (
        "http://evil.example",
        "null",
        f"https://127.0.0.1:{port}",
        "http://127.0.0.1:1",
        f"http://127.0.0.1.evil.example:{port}",
        "file://",
    )
    for route in every:
        for method in sorted(route.private):
            for host in hosts:
                status = box.ask(method, route.path, {**paired.headers, "Host": host})
                tally.note("forged Host", f"{method} {route.path} {host}", *status)
            for origin in origins:
                status = box.ask(method, route.path, {**paired.headers, "Origin": origin})
                tally.note("forged Origin", f"{method} {route.path} {origin}", *status)
    cookie = {"Cookie": paired.headers["Cookie"]}
    stranger = pair(port, name="Somebody else").csrf
    for method, path in _changes(every):
        for token in (None, "", "0" * 64, paired.csrf[:-1], paired.csrf.upper(), stranger, paired.cookie):
            headers = cookie if token is None else {**cookie, CSRF: token}
            tally.note("forged CSRF", f"{method} {path} {token}", *box.ask(method, path, headers))
        form = {**paired.headers, "Content-Type": "application/x-www-form-urlencoded"}
        tally.note("a form's change", f"{method} {path}", *box.ask(method, path, form, b"a=1"))
        plain = {**paired.headers, "Content-Type": "text/plain"}
        tally.note("a form's change", f"{method} {path} text", *box.ask(method, path, plain))


def _watching(box: Box, every: list[Route], tally: Tally, paired: Pass) -> None:
    """Changes by somebody who may only look; what concerns the own session and the clock is allowed."""
    allowed = re.compile(r"/api/v1/(session|control/\w+|clock)$")
    for method, path in _changes(every):
        if not allowed.match(path):
            tally.note("a watcher's change", f"{method} {path}", *box.ask(method, path, paired.headers))


def _climbing(box: Box, tally: Tally, paired: Pass) -> None:
    up = ("../", "..%2f", "%2e%2e/", "%2e%2e%2f", "..%252f", "..\\", "..%5c", "....//", "..;/", "%c0%ae%c0%ae/")
    ends = ("etc/passwd", "pin", "sessions.json", "borescout.db", "web_ui/app.py", "app.py")
    starts = ("/static/", "/static/js/", "/", "/api/v1/picture/", "/api/v1/surveys/1/recordings/", "/api/v1/surveys/1/picture/")
    for headers in ({}, paired.headers):
        for start in starts:
            for step in up:
                for end in ends:
                    for depth in (1, 3, 8):
                        path = start + step * depth + end
                        tally.note("path traversal", path, *box.ask("GET", path, headers, b""))
            for end in ("/etc/passwd", "//etc/passwd", "%2fetc%2fpasswd", "file:///etc/passwd", "C:%5Cboot.ini", "x%00.css"):
                tally.note("path traversal", start + end, *box.ask("GET", start + end, headers, b""))


def _replayed(box: Box, every: list[Route], tally: Tally, port: int) -> None:
    """Sessions that have ended: by leaving, by pairing again, by being sent away."""
    left = pair(port, name="Left")
    assert box.ask("DELETE", "/api/v1/session", left.headers)[0] == 204
    rotated = pair(port, name="Rotated")
    body = json.dumps({"pin": PIN}).encode()
    assert box.ask("POST", "/api/v1/session", rotated.headers, body)[0] == 200
    for kind, paired in (("replayed after leaving", left), ("replayed after pairing again", rotated)):
        for route in every:
            for method in sorted(route.private):
                tally.note(kind, f"{method} {route.path}", *box.ask(method, route.path, paired.headers))


def _guessed(box: Box, tally: Tally) -> None:
    """PINs from one address: most are not even looked at."""
    source = http.client.HTTPConnection("127.0.0.1", box.port, timeout=30, source_address=("127.0.9.9", 0))
    for pin in ("000000", "111111", "123457", "654321", "999999", "12345", "1234567", PIN, PIN, PIN):
        source.request("POST", "/api/v1/session", json.dumps({"pin": pin}), {"Content-Type": "application/json"})
        answer = source.getresponse()
        tally.note("guessed PIN", pin, answer.status, answer.read())
    source.close()


def _whole(port: int, path: str, headers: dict[str, str] | None = None) -> tuple[int, bytes]:
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=30)
    connection.request("GET", path, headers=headers or {})
    answer = connection.getresponse()
    text = answer.read()
    connection.close()
    return answer.status, text


def _state(port: int, paired: Pass) -> list[bytes]:
    return [_whole(port, f"/api/v1/{what}", paired.headers)[1] for what in ("nodes", "pipes", "surveys")]


def main() -> None:
    argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0]).parse_args()
    tally = Tally()
    begun = time.monotonic()
    with (
        tempfile.TemporaryDirectory(prefix="borescout-intrusion-") as folder,
        running(Path(folder), ["--virtual"]) as (_, port),
    ):
        try_everything(port, tally)
    through = Counter(kind for kind, _, _ in tally.through)
    rows = [
        (kind, count, through[kind], " ".join(f"{status}:{n}" for status, n in sorted(tally.kinds[kind].items())))
        for kind, count in tally.tried.items()
    ]
    rows.append(("all", sum(tally.tried.values()), len(tally.through), f"{time.monotonic() - begun:.0f} s"))
    print_table("Uninvited requests", ("kind", "tried", "let through", "answered with"), rows)
    for kind, request, status in tally.through[:20]:
        print(f"  let through: {kind}: {request} ({status})")
    sys.exit(1 if tally.through else 0)


if __name__ == "__main__":
    main()
