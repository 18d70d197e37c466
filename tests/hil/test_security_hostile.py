"""Hostile clients beside a running measurement: it is saved whole, and honest clients are answered all the while."""

from __future__ import annotations

import http.client
import json
import socket
import time
from collections.abc import Iterator
from contextlib import ExitStack, suppress
from typing import Any

import pytest

from tests.browser.serving import served
from tests.hil.rig import Bench, PipeCamera
from tests.hostile import ATTACKS, under_attack
from tests.pairing import Pass, pair
from web_ui import connections
from web_ui.app import create_app

FRAMES = 20
SECONDS = 2.5
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
    """The answer on a connection of its own."""
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=PATIENCE_S)
    try:
        headers = {"Content-Type": "application/json", **({} if paired is None else paired.headers)}
        connection.request(method, path, None if body is None else json.dumps(body), headers)
        answer = connection.getresponse()
        text = answer.read()
        return answer.status, json.loads(text) if text.startswith((b"{", b"[")) else None
    finally:
        connection.close()


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
        attackers = [
            stack.enter_context(under_attack(port, attack, SECONDS, f"127.0.0.{60 + k}")) for k, attack in enumerate(attacks)
        ]
        time.sleep(0.5)  # they are at work
        status, begun = ask(port, paired, "POST", "/api/v1/measure", {"frames": FRAMES})
        assert status == 202
        answers = 0
        while any(attacker.poll() is None for attacker in attackers):
            assert ask(port, paired, "GET", "/api/v1/status")[0] == 200
            assert ask(port, None, "GET", "/pair")[0] == 200
            answers += 1
        for attacker in attackers:
            assert attacker.stdout is not None
            assert json.loads(attacker.stdout.read())["connections"] > 0, "the attack did not take place"
    assert answers >= 2
    assert box.finish(begun["survey_id"])["state"] == "saved"
    assert box.device.survey(begun["survey_id"])["result"]["frames_used"] == FRAMES


def test_slow_and_silent_clients_are_cut_off(port: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(connections, "REQUEST_S", 1.0)
    monkeypatch.setattr(connections, "IDLE_S", 2.0)
    for attack in ("slow headers", "500 connections"):
        with under_attack(port, attack, 4.0) as attacker:
            assert attacker.stdout is not None
            done = json.loads(attacker.stdout.read())
        # More were cut off than what the share of an address pushes out alone: those that were let in had to go, too.
        assert done["closed by the box"] > 0
        assert done["connections"] - done["closed by the box"] <= connections.MOST_OF_AN_ADDRESS


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
    with under_attack(port, "guessing PINs", 2.0, "127.0.0.77") as attacker:
        assert attacker.stdout is not None
        done = json.loads(attacker.stdout.read())
    assert done["guesses"] > 50
    assert pair(port, name="Honest", source="127.0.0.78").csrf, "somebody else is let in at once"
    names = {row["name"] for row in box.device.access.devices()}
    assert not any("77" in name for name in names)
