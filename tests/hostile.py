"""Clients that mean harm, each in a process of its own so that they cost the box's process nothing but what they ask of it.

python -m tests.hostile PORT SECONDS SOURCE ATTACK    prints one JSON line of what it did
"""

from __future__ import annotations

import contextlib
import json
import signal
import socket
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager

SOURCE = "127.0.0.66"
"""Where they come from: another address than the honest clients of a test, as on a hotspot."""


LONGEST_S = 300.0
"""An attack whose test was killed ends by itself."""


class Crowd:
    """Sockets to the box, kept at a number."""

    def __init__(self, port: int, source: str, size: int, receive_bytes: int | None = None) -> None:
        self._place, self._source, self._size, self._receive = ("127.0.0.1", port), source, size, receive_bytes
        self.sockets: list[socket.socket] = []
        self.count: Counter[str] = Counter()

    def fill(self) -> list[socket.socket]:
        """Open what is missing; the new ones."""
        new = []
        while len(self.sockets) < self._size:
            one = socket.socket()
            if self._receive is not None:
                one.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, self._receive)
            one.settimeout(0.5)
            try:
                one.bind((self._source, 0))
                one.connect(self._place)
            except OSError:
                self.count["not connected"] += 1
                one.close()
                break
            self.count["connections"] += 1
            one.setblocking(False)
            self.sockets.append(one)
            new.append(one)
        return new

    def send(self, one: socket.socket, data: bytes) -> None:
        """As much as it takes just now; one that was closed goes."""
        try:
            self.count["bytes"] += one.send(data)
        except BlockingIOError:
            self.count["would block"] += 1
        except OSError:
            self.drop(one)

    def alive(self, one: socket.socket) -> bool:
        """Read what is there; whether the box still holds the connection."""
        try:
            data = one.recv(65536)
        except BlockingIOError:
            return True
        except OSError:
            data = b""
        if data:
            self.count["answers"] += data.count(b"HTTP/1.1 ")
            return True
        self.drop(one)
        return False

    def drop(self, one: socket.socket) -> None:
        """Forget a connection that the box closed."""
        self.count["closed by the box"] += 1
        one.close()
        with contextlib.suppress(ValueError):
            self.sockets.remove(one)


def slow_headers(crowd: Crowd, until: float) -> None:
    """A byte of a header now and then, on every connection."""
    while time.monotonic() < until:
        for one in crowd.fill():
            crowd.send(one, b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nX: ")
        for one in list(crowd.sockets):
            crowd.send(one, b"a")
        time.sleep(0.5)
        for one in list(crowd.sockets):
            crowd.alive(one)


def idle(crowd: Crowd, until: float) -> None:
    """Connections that say nothing."""
    while time.monotonic() < until:
        crowd.fill()
        for one in list(crowd.sockets):
            crowd.alive(one)
        time.sleep(0.2)


def _pour(crowd: Crowd, until: float, head: bytes, drop: bytes) -> None:
    while time.monotonic() < until:
        for one in crowd.fill():
            crowd.send(one, head)
        for one in list(crowd.sockets):
            if crowd.alive(one):
                crowd.send(one, drop)
        time.sleep(0.002)


def endless_body(crowd: Crowd, until: float) -> None:
    """A body of ten gigabytes."""
    head = b"POST /api/v1/session HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Type: application/json\r\n"
    _pour(crowd, until, head + b"Content-Length: 10000000000\r\n\r\n", b'"' * 65536)


def endless_chunks(crowd: Crowd, until: float) -> None:
    """A body whose chunks never end."""
    head = b"POST /api/v1/session HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Type: application/json\r\n"
    _pour(crowd, until, head + b"Transfer-Encoding: chunked\r\n\r\n", b"4000\r\n" + b"x" * 0x4000 + b"\r\n")


def huge_headers(crowd: Crowd, until: float) -> None:
    """Headers that never end."""
    _pour(crowd, until, b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\n", b"X-Y: " + b"z" * 8000 + b"\r\n")


def broken_multipart(crowd: Crowd, until: float) -> None:
    """Forms with boundaries that are missing, doubled, endless, or not text."""
    bodies = (
        b'--b\r\nContent-Disposition: form-data; name="a"\r\n\r\n',
        b"--b--b--b\r\n\r\n\r\n--b",
        b"--" + b"b" * 60000,
        bytes(range(256)) * 16,
        b'--b\r\nContent-Disposition: form-data; name="f"; filename="../../../../etc/passwd"\r\n\r\nx\r\n--b--\r\n',
    )
    kinds = (b"multipart/form-data; boundary=b", b"multipart/form-data", b"multipart/form-data; boundary=\xff\x00")
    turn = 0
    while time.monotonic() < until:
        crowd.fill()
        for one in list(crowd.sockets):
            if not crowd.alive(one):
                continue
            body, kind = bodies[turn % len(bodies)], kinds[turn % len(kinds)]
            turn += 1
            head = b"POST /api/v1/session HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Type: %s\r\nContent-Length: %d\r\n\r\n"
            crowd.send(one, head % (kind, len(body)) + body)
        time.sleep(0.02)


def pipelined(crowd: Crowd, until: float) -> None:
    """Hundreds of requests in one breath, no answer read."""
    breath = b"GET /static/style.css HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n" * 400
    while time.monotonic() < until:
        for one in crowd.fill():
            crowd.send(one, breath)
        for one in list(crowd.sockets):
            crowd.send(one, breath)
        time.sleep(0.02)


def half_closed(crowd: Crowd, until: float) -> None:
    """A request, an end of talking, and no hanging up."""
    while time.monotonic() < until:
        for one in crowd.fill():
            crowd.send(one, b"GET /pair HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n")
            with contextlib.suppress(OSError):
                one.shutdown(socket.SHUT_WR)
        time.sleep(0.2)
        for one in list(crowd.sockets):
            crowd.alive(one)


def never_reading(crowd: Crowd, until: float) -> None:
    """Requests one after the other for what is large, through the smallest window, hardly an answer read."""
    asked = b"GET /static/style.css HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n"
    while time.monotonic() < until:
        for one in crowd.fill():
            crowd.send(one, asked * 6)
        for one in list(crowd.sockets):
            try:
                if one.recv(1) == b"":
                    crowd.drop(one)
            except BlockingIOError:
                pass
            except OSError:
                crowd.drop(one)
        time.sleep(0.2)


def garbage(crowd: Crowd, until: float) -> None:
    """Bytes that are no HTTP."""
    lines = (
        b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03" + bytes(range(200)) + b"\r\n\r\n",
        b"\x00" * 500 + b"\r\n\r\n",
        b"GET / HTTP/9.9\r\n\r\n",
        b"GET /%00%ff%c0%af../.. HTTP/1.1\r\nHost: \xff\r\n\r\n",
        b"POST / HTTP/1.1\r\nContent-Length: -5\r\n\r\n",
        b"POST / HTTP/1.1\r\nContent-Length: 5\r\nTransfer-Encoding: chunked\r\n\r\nzz\r\n\r\n",
        b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n",
        b": : :\r\n\r\n",
    )
    turn = 0
    while time.monotonic() < until:
        crowd.fill()
        for one in list(crowd.sockets):
            crowd.send(one, lines[turn % len(lines)])
            turn += 1
        for one in list(crowd.sockets):
            crowd.alive(one)
        time.sleep(0.02)


def flood(crowd: Crowd, until: float) -> None:
    """Pages, as many and as fast as they come."""
    asked = b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n"
    while time.monotonic() < until:
        for one in crowd.fill():
            crowd.send(one, asked)
        for one in list(crowd.sockets):
            before = crowd.count["answers"]
            if crowd.alive(one) and crowd.count["answers"] > before:
                crowd.send(one, asked)
        time.sleep(0.001)


def guessing(crowd: Crowd, until: float) -> None:
    """PINs, one after the other."""
    pin = 0
    while time.monotonic() < until:
        new = crowd.fill()
        for one in list(crowd.sockets):
            before = crowd.count["answers"]
            if one in new or (crowd.alive(one) and crowd.count["answers"] > before):
                body = b'{"pin": "%06d"}' % pin
                pin += 1
                head = b"POST /api/v1/session HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Type: application/json\r\n"
                crowd.send(one, head + b"Content-Length: %d\r\n\r\n" % len(body) + body)
                crowd.count["guesses"] += 1
        time.sleep(0.002)


ATTACKS: dict[str, tuple[Callable[[Crowd, float], None], int, int | None]] = {
    "slow headers": (slow_headers, 200, None),
    "500 connections": (idle, 500, None),
    "endless body": (endless_body, 8, None),
    "endless chunks": (endless_chunks, 8, None),
    "huge headers": (huge_headers, 8, None),
    "broken multipart": (broken_multipart, 8, None),
    "pipelining": (pipelined, 16, None),
    "half closed": (half_closed, 100, None),
    "never reading": (never_reading, 40, 2048),
    "garbage": (garbage, 8, None),
    "flood": (flood, 16, None),
    "guessing PINs": (guessing, 8, None),
}
"""What each does, through how many connections, with which receive buffer (bytes)."""


class Attack:
    """One attack under way, in a process of its own."""

    def __init__(self, port: int, attack: str, source: str = SOURCE) -> None:
        command = [sys.executable, "-m", "tests.hostile", str(port), source, attack]
        self._process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        assert self._process.stdout is not None
        self._said = self._process.stdout
        assert self._said.readline() == "at work\n"

    def end(self) -> dict[str, int]:
        """Stop it; what it did: connections, answers, how many were closed by the box, ..."""
        self._process.terminate()
        done: dict[str, int] = json.loads(self._said.read() or "{}")
        self._process.wait(10)
        return done


@contextmanager
def under_attack(port: int, attack: str, source: str = SOURCE) -> Iterator[Attack]:
    """The attack beside what the block does."""
    one = Attack(port, attack, source)
    try:
        yield one
    finally:
        one.end()


def main() -> None:
    port, source, attack = sys.argv[1:]
    signal.signal(signal.SIGTERM, lambda number, frame: sys.exit(0))
    act, size, receive_bytes = ATTACKS[attack]
    crowd = Crowd(int(port), source, size, receive_bytes)
    print("at work", flush=True)
    try:
        act(crowd, time.monotonic() + LONGEST_S)
    finally:
        print(json.dumps(crowd.count))


if __name__ == "__main__":
    main()
