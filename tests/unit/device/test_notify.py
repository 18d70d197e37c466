"""What systemd is told, heard at a socket that a test opens in its place."""

from __future__ import annotations

import os
import socket
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from device.notify import Keeper, Notifier, Turns, Watchdog
from tests.unit.device.device_doubles import eventually


class Manager:
    """The service manager's end: everything it was told, one message after the other."""

    def __init__(self, address: str) -> None:
        self.socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self.socket.bind("\0" + address[1:] if address.startswith("@") else address)
        self.socket.settimeout(0.05)
        self.messages: list[str] = []
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._listen, daemon=True)
        self._thread.start()

    def _listen(self) -> None:
        while not self._stop.is_set():
            try:
                self.messages.append(self.socket.recv(4096).decode())
            except TimeoutError:
                continue

    def heard(self, line: str) -> int:
        return sum(line in message.splitlines() for message in list(self.messages))

    def close(self) -> None:
        self._stop.set()
        self._thread.join()
        self.socket.close()


@pytest.fixture(params=["path", "abstract"])
def manager(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[tuple[Manager, str]]:
    address = str(tmp_path / "notify") if request.param == "path" else f"@borescout-test-{os.getpid()}"
    listening = Manager(address)
    yield listening, address
    listening.close()


def keeper(address: str, turns: Turns, ready: threading.Event, period_s: float = 0.06) -> Keeper:
    return Keeper(Notifier(address), Watchdog(period_s), turns, ready.is_set, lambda: "1 camera up", start_poll_s=0.01)


def test_ready_only_when_the_box_can_be_used(manager: tuple[Manager, str]) -> None:
    listening, address = manager
    ready = threading.Event()
    kept = keeper(address, Turns(), ready)
    kept.start()
    assert eventually(lambda: len(listening.messages) >= 3)
    assert not listening.heard("READY=1")
    assert all(message.startswith("STATUS=starting: ") for message in listening.messages)
    ready.set()
    assert eventually(lambda: listening.heard("READY=1") == 1)
    assert eventually(lambda: listening.heard("WATCHDOG=1") >= 2)
    assert listening.heard("STATUS=1 camera up") >= 2
    kept.close()
    assert eventually(lambda: listening.heard("STOPPING=1") == 1)
    assert listening.heard("READY=1") == 1


def test_the_watchdog_starves_while_a_loop_stands_still(manager: tuple[Manager, str]) -> None:
    listening, address = manager
    now = 0.0
    turns = Turns(lambda: now)
    camera, drive = turns.loop("camera", 15.0), turns.loop("drive", 30.0)
    ready = threading.Event()
    ready.set()
    kept = keeper(address, turns, ready)
    camera()
    drive()
    kept.start()
    assert eventually(lambda: listening.heard("WATCHDOG=1") >= 1)
    now = 20.0  # the drive may take longer over a turn than the camera
    assert eventually(lambda: listening.heard("STATUS=stuck: camera") >= 1)
    fed = listening.heard("WATCHDOG=1")
    assert eventually(lambda: listening.heard("STATUS=stuck: camera") >= 4)
    assert listening.heard("WATCHDOG=1") == fed
    camera()
    assert eventually(lambda: listening.heard("WATCHDOG=1") > fed)
    kept.close()


def test_a_loop_that_has_not_begun_or_has_ended_is_not_late() -> None:
    now = 0.0
    turns = Turns(lambda: now)
    turn = turns.loop("drive", 5.0)
    now = 100.0
    assert turns.late() == []
    turn()
    now = 105.0
    assert turns.late() == []
    now = 105.1
    assert turns.late() == ["drive"]
    turns.over("drive")
    turns.over("drive")
    assert turns.late() == []


def test_without_systemd_nothing_is_told_and_nothing_fails(tmp_path: Path) -> None:
    for address in (None, "", str(tmp_path / "nobody listens here")):
        notifier = Notifier(address)
        assert notifier.tell("READY=1") is False
        notifier.close()
        assert notifier.tell("WATCHDOG=1") is False


@pytest.mark.parametrize(
    ("environment", "period_s"),
    [
        ({}, None),
        ({"WATCHDOG_USEC": "30000000"}, 30.0),
        ({"WATCHDOG_USEC": "30000000", "WATCHDOG_PID": str(os.getpid())}, 30.0),
        ({"WATCHDOG_USEC": "30000000", "WATCHDOG_PID": "1"}, None),
        ({"WATCHDOG_USEC": "soon"}, None),
        ({"WATCHDOG_USEC": "0"}, None),
    ],
)
def test_the_watchdog_is_for_this_process_only(environment: dict[str, str], period_s: float | None) -> None:
    assert Watchdog.of(environment).period_s == period_s
