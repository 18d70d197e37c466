"""Hostile clients beside a running measurement: it is saved whole, and honest clients are answered all the while."""

from __future__ import annotations

import socket
import time
from collections.abc import Iterator
from contextlib import ExitStack, suppress
from typing import Any

import pytest

from tests import pairing
from tests.browser.serving import served
from tests.hil.rig import Bench, PipeCamera
from tests.hostile import ATTACKS, under_attack
from tests.pairing import Pass, pair
from web_ui import connections
from web_ui.app import create_app

FRAMES = 20
PATIENCE_S = 8.0
"""For one answer, on two cores shared with whatever else runs; a client that is shut out waits for ever."""


@pytest.fixture(scope="module")
def box(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Bench]:
    bench = Bench(tmp_path_factory.mktemp("box"), PipeCamera("front"), frames=FRAMES).up()
    yield bench
    bench.close()


@pytest.fixture(scope="module")
def port(box: Bench) -> Iterator[int]:
    with served(create_app(box.device)) as port:
        yield port
        box.device.end_streams()


@pytest.fixture(scope="module")
def paired(port: int) -> Pass:
    return pair(port)


def ask(port: int, paired: Pass | None, method: str, path: str, body: Any = None) -> tuple[int, Any]:
    """The answer, which must come soon."""
    return pairing.ask(port, paired, method, path, body, patience_s=PATIENCE_S)


TOGETHER = (
    ("slow headers", "500 connections", "half closed"),
    ("endless body", "endless chunks", "huge headers"),
    ("broken multipart", "garbage", "guessing PINs"),
    ("pipelining", "never reading", "flood"),
)


def test_no_attack_is_left_out() -> None:
    assert sorted(attack for attacks in TOGETHER for attack in attacks) == sorted(ATTACKS)


@pytest.mark.parametrize("attacks", TOGETHER, ids=", ".join)
def test_hostile_clients_stop_neither_a_measurement_nor_the_page(
    box: Bench, port: int, paired: Pass, attacks: tuple[str, ...]
) -> None:
    with ExitStack() as stack:
        attackers = [stack.enter_context(under_attack(port, attack, f"127.0.0.{60 + k}")) for k, attack in enumerate(attacks)]
        status, begun = ask(port, paired, "POST", "/api/v1/measure", {"frames": FRAMES})
        assert status == 202
        for _ in range(4):
            assert ask(port, paired, "GET", "/api/v1/status")[0] == 200
            assert ask(port, None, "GET", "/pair")[0] == 200
            time.sleep(0.3)
        assert box.finish(begun["survey_id"])["state"] == "saved"
        for attack, attacker in zip(attacks, attackers, strict=True):
            assert attacker.end()["connections"] > 0, f"{attack} did not take place"
    assert box.device.survey(begun["survey_id"])["result"]["frames_used"] == FRAMES


def test_slow_and_silent_clients_are_cut_off(port: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(connections, "REQUEST_S", 0.5)
    monkeypatch.setattr(connections, "IDLE_S", 1.0)
    monkeypatch.setattr(connections, "MOST_OF_AN_ADDRESS", 1000)  # nobody is pushed out: who is gone took too long
    monkeypatch.setattr(connections, "MOST_CONNECTIONS", 1000)
    for request in (
        b"",
        b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nX: ",
        b"POST /api/v1/session HTTP/1.1\r\nContent-Length: 9\r\n\r\n",
    ):
        with socket.create_connection(("127.0.0.1", port), timeout=PATIENCE_S) as one:
            one.sendall(request)
            with suppress(ConnectionError):  # a byte now and then does not help
                for _ in range(8):
                    time.sleep(0.2)
                    one.sendall(b"a" if request else b"")
            assert one.recv(1) == b""


def test_a_crowd_is_bounded_and_the_newcomer_gets_in(port: int, paired: Pass) -> None:
    """Many addresses fill all places; the one that has been idle longest makes room."""
    held = []
    try:
        for k in range(connections.MOST_CONNECTIONS + 40):
            one = socket.socket()
            one.bind((f"127.0.1.{1 + k // 20}", 0))
            one.settimeout(5)
            one.connect(("127.0.0.1", port))
            held.append(one)
        assert ask(port, paired, "GET", "/api/v1/status")[0] == 200
        time.sleep(0.5)
        closed = 0
        for one in held:
            one.setblocking(False)
            with suppress(BlockingIOError):
                closed += one.recv(1) == b""
        assert 40 <= closed <= 60, "only as many were turned away as were too many"
    finally:
        for one in held:
            one.close()


def test_the_pin_is_not_guessed_by_speed(box: Bench, port: int) -> None:
    with under_attack(port, "guessing PINs", "127.0.0.77") as attacker:
        time.sleep(2.0)
        assert pair(port, name="Honest", source="127.0.0.78").csrf, "somebody else is let in at once"
        assert attacker.end()["guesses"] > 20
    assert not any("77" in row["name"] for row in box.device.access.devices())
    with pytest.raises(AssertionError, match="429"):
        pair(port, source="127.0.0.77")
