"""The door: the PIN and its pace, sessions over restarts, and who controls, by the rules alone and with a clock in hand."""

from __future__ import annotations

import contextlib
import json
import stat
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from device.access import Access, pin_of
from device.access.control import ABSENT_S, CONSENT_S, PAUSE_AFTER_REFUSAL_S
from device.access.pace import COMMON_DELAY_S, COMMON_FREE_GUESSES, FORGIVEN_AFTER_S, LONGEST_DELAY_S, Pace
from device.access.pin import new_pin
from device.access.sessions import IDLE_S, LIFE_S, MOST
from device.errors import Busy, Forbidden, NotFound, StoreUnusable, TooSoon, WrongPin

PIN = "004213"


class Hand:
    """A clock that a test turns."""

    now = 1000.0

    def __call__(self) -> float:
        return self.now


@pytest.fixture
def hand() -> Hand:
    return Hand()


def door(hand: Hand, folder: Path | None = None, told: list[dict[str, Any]] | None = None) -> Access:
    return Access(PIN, folder=folder, publish=(told if told is not None else []).append, clock=hand)


# --- PIN ---


def test_a_pin_is_drawn_once_and_for_its_owner_alone(tmp_path: Path) -> None:
    pin = pin_of(tmp_path / "new")
    assert len(pin) == 6
    assert pin.isdecimal()
    assert pin_of(tmp_path / "new") == pin
    assert stat.S_IMODE((tmp_path / "new" / "pin").stat().st_mode) == 0o600
    assert {new_pin(tmp_path / "new") for _ in range(8)} != {pin}, "drawn anew"


@pytest.mark.parametrize("text", ["", "12345", "1234567", "12345a", "١٢٣٤٥٦"])
def test_a_broken_pin_file_is_said_and_no_default_taken(tmp_path: Path, text: str) -> None:
    (tmp_path / "pin").write_text(text)
    with pytest.raises(StoreUnusable, match="no PIN"):
        pin_of(tmp_path)


# --- Pace ---


def test_the_delay_doubles_up_to_its_limit() -> None:
    pace, now, waits = Pace(), 0.0, []
    for _ in range(14):
        pace.wrong("10.0.0.9", now)
        waits.append(pace.wait_s("10.0.0.9", now))
        now += waits[-1]
    assert waits == [0, 0, 2, 4, 8, 16, 32, 64, 128, 256, 512, LONGEST_DELAY_S, LONGEST_DELAY_S, LONGEST_DELAY_S]
    assert pace.wait_s("10.0.0.10", now) == 0, "a neighbour is not held up"
    assert pace.wait_s("10.0.0.9", now + FORGIVEN_AFTER_S + 1) == 0


def test_many_guessers_share_one_pace_that_does_not_hold_up_the_innocent() -> None:
    pace = Pace()
    for k in range(COMMON_FREE_GUESSES):
        assert pace.wait_s(f"10.0.0.{k}", float(k)) == 0
        pace.wrong(f"10.0.0.{k}", float(k))
    now = float(COMMON_FREE_GUESSES - 1)
    assert pace.wait_s("10.0.0.0", now) == COMMON_DELAY_S
    assert pace.wait_s("10.0.1.0", now) == 0
    assert pace.wait_s("10.0.0.0", now + COMMON_DELAY_S) == 0


def test_one_machine_cannot_hide_in_its_own_ipv6_network() -> None:
    pace = Pace()
    for k in range(3):
        pace.wrong(f"2001:db8::{k:x}", 0.0)
    assert pace.wait_s("2001:db8::ffff", 0.0) == 2.0
    assert pace.wait_s("2001:db8:0:1::1", 0.0) == 0
    for _ in range(3):
        pace.wrong("::ffff:10.0.0.1", 0.0)
    assert pace.wait_s("10.0.0.1", 0.0) == 2.0


@given(st.lists(st.tuples(st.integers(0, 3), st.floats(0, 700)), max_size=60))
def test_no_order_of_guesses_beats_the_pace(guesses: list[tuple[int, float]]) -> None:
    """However the guesses are spread, an address gets no more of them looked at in a day than its delays leave room for."""
    pace, now, looked = Pace(), 0.0, {k: [] for k in range(4)}
    for who, later in guesses:
        now += later
        if pace.wait_s(f"10.0.0.{who}", now) == 0:
            pace.wrong(f"10.0.0.{who}", now)
            looked[who].append(now)
    for times in looked.values():
        for k in range(2, len(times) - 1):
            assert times[k + 1] - times[k] >= min(LONGEST_DELAY_S, 2.0 ** (k - 1))


# --- Pairing and sessions ---


def test_only_the_pin_lets_in_and_waiting_guesses_are_not_looked_at(hand: Hand) -> None:
    one = door(hand)
    for wrong in ("000000", "", "4213", PIN + "0", "９"):
        with pytest.raises((WrongPin, TooSoon)):
            one.pair(wrong, "10.0.0.2", "A")
        hand.now += 60
    for _ in range(6):
        with pytest.raises(WrongPin):
            one.pair("000000", "10.0.0.3", "A")
        hand.now += 32
    hand.now -= 31
    with pytest.raises(TooSoon) as soon:
        one.pair(PIN, "10.0.0.3", "A")
    assert soon.value.wait_s == 15
    assert "15 s" in str(soon.value)
    paired = one.pair(PIN, "10.0.0.4", "B")
    assert one.session(paired.token) is not None
    assert one.session("") is None
    assert one.session(paired.session.id) is None
    assert one.session("x" * 5000) is None


def test_a_session_ends_when_idle_and_by_age_and_when_sent_away(hand: Hand) -> None:
    one = door(hand)
    token = one.pair(PIN, "a", "A").token
    hand.now += IDLE_S - 1
    assert one.session(token) is not None
    hand.now += IDLE_S + 1
    assert one.session(token) is None
    hand.now -= IDLE_S
    assert one.session(token) is None, "gone for good"
    token = one.pair(PIN, "a", "A").token
    for _ in range(int(LIFE_S / IDLE_S) * 2):
        hand.now += IDLE_S / 2
        assert one.session(token) is not None
    hand.now += 1
    assert one.session(token) is None
    paired = one.pair(PIN, "a", "A")
    one.end(paired.session.id)
    assert one.session(paired.token) is None
    with pytest.raises(NotFound):
        one.end(paired.session.id)


def test_pairing_again_ends_the_old_session_and_keeps_the_control(hand: Hand) -> None:
    one = door(hand)
    old = one.pair(PIN, "a", "A")
    new = one.pair(PIN, "a", "A", old.token)
    assert one.session(old.token) is None
    assert one.state()["controller"]["id"] == new.session.id
    assert len({old.token, new.token, old.csrf, new.csrf}) == 4
    assert len(one.devices()) == 1


def test_sessions_and_control_live_on_over_a_restart_and_go_on_ageing(hand: Hand, tmp_path: Path) -> None:
    one = door(hand, tmp_path)
    first, second = one.pair(PIN, "a", "A"), one.pair(PIN, "b", "B")
    kept = (tmp_path / "sessions.json").read_text()
    assert first.token not in kept
    assert first.csrf not in kept
    assert stat.S_IMODE((tmp_path / "sessions.json").stat().st_mode) == 0o600
    hand.now += IDLE_S - 100
    one.end(second.session.id)
    later = Hand()
    later.now = 5.0  # a monotonic clock begins anew
    two = door(later, tmp_path)
    assert two.state()["controller"] == {"id": first.session.id, "name": "A"}
    assert two.session(second.token) is None, "sent away is sent away, power cut or not"
    later.now += 101
    assert two.session(first.token) is None, "the hours before the restart count"
    assert json.loads((tmp_path / "sessions.json").read_text())["sessions"] == []


@pytest.mark.parametrize("text", ["", "{}", "[]", '{"sessions": [{"id": 1}], "controller": null}', '{"sessions": [], "con'])
def test_a_damaged_file_of_sessions_lets_nobody_in_and_stops_nothing(hand: Hand, tmp_path: Path, text: str) -> None:
    (tmp_path / "sessions.json").write_text(text)
    one = door(hand, tmp_path)
    assert one.devices() == []
    assert one.session(one.pair(PIN, "a", "A").token) is not None


def test_the_number_of_sessions_is_bounded_and_the_controller_stays(hand: Hand) -> None:
    one = door(hand)
    controller = one.pair(PIN, "a", "A")
    for k in range(MOST + 5):
        hand.now += 1
        one.pair(PIN, "a", f"B{k}")
    assert len(one.devices()) == MOST
    assert one.session(controller.token) is not None


# --- Control ---


def test_the_first_controls_the_others_ask_and_are_granted_or_refused(hand: Hand) -> None:
    told: list[dict[str, Any]] = []
    one = door(hand, told=told)
    a, b, c = (one.pair(PIN, name, name).session for name in "ABC")
    one.may_change(a)
    with pytest.raises(Forbidden, match="A controls the box"):
        one.may_change(b)
    assert one.ask(b)["request"] == {"id": b.id, "name": "B", "left_s": CONSENT_S}
    with pytest.raises(Busy):
        one.ask(c)
    with pytest.raises(Forbidden):
        one.grant(b)
    with pytest.raises(Forbidden):
        one.refuse(c)
    assert one.refuse(a) == {"controller": {"id": a.id, "name": "A"}, "request": None}
    with pytest.raises(Busy, match="ask again in 60 s"):
        one.ask(b)
    hand.now += PAUSE_AFTER_REFUSAL_S
    one.session("")
    # A has been silent for a minute by now: a phone in a pocket is not asked
    assert one.ask(b)["controller"]["name"] == "B"
    with pytest.raises(Forbidden):
        one.may_change(a)
    assert told[-1]["controller"]["name"] == "B"


def test_a_request_without_an_answer_is_granted_in_time(hand: Hand) -> None:
    told: list[dict[str, Any]] = []
    one = door(hand, told=told)
    a, b = (one.pair(PIN, name, name) for name in "AB")
    one.ask(b.session)
    for _ in range(int(CONSENT_S) - 1):  # both pages stay open
        hand.now += 1
        one.session(a.token)
        one.session(b.token)
    assert one.state()["controller"]["name"] == "A"
    assert one.state()["request"]["left_s"] == 1
    hand.now += 1
    one.session(a.token)
    assert told[-1] == {"controller": {"id": b.session.id, "name": "B"}, "request": None}
    with pytest.raises(Forbidden):
        one.may_change(a.session)


def test_consent_is_asked_of_who_is_there_only(hand: Hand) -> None:
    one = door(hand)
    a, b = (one.pair(PIN, name, name) for name in "AB")
    hand.now += ABSENT_S - 1
    one.ask(b.session)
    assert one.state()["controller"]["name"] == "A"
    one.release(b.session)
    hand.now += 2
    assert one.ask(b.session)["controller"]["name"] == "B"
    one.end(b.session.id)
    assert one.state()["controller"] is None
    one.may_change(a.session)
    assert one.state()["controller"]["name"] == "A"


def test_who_asked_and_left_gets_nothing(hand: Hand) -> None:
    one = door(hand)
    a, b = (one.pair(PIN, name, name) for name in "AB")
    one.ask(b.session)
    one.end(b.session.id)
    assert one.state()["request"] is None
    assert one.grant(a.session)["controller"]["name"] == "A"
    assert one.release(a.session)["controller"] is None


@given(st.lists(st.tuples(st.sampled_from(["ask", "grant", "refuse", "release", "end", "wait", "change"]), st.integers(0, 2))))
def test_there_is_never_more_than_one_controller(steps: list[tuple[str, int]]) -> None:
    hand = Hand()
    one = door(hand)
    people = [one.pair(PIN, name, name) for name in "ABC"]
    for what, who in steps:
        session = one.session(people[who].token)
        if what == "wait":
            hand.now += 7
        elif session is None:
            people[who] = one.pair(PIN, "x", "ABC"[who])
        else:
            do = {
                "ask": one.ask,
                "grant": one.grant,
                "refuse": one.refuse,
                "release": one.release,
                "change": one.may_change,
                "end": lambda session: one.end(session.id),
            }
            with contextlib.suppress(Busy, Forbidden):
                do[what](session)
        controllers = [device for device in one.devices() if device["controls"]]
        assert len(controllers) <= 1
        state = one.state()
        assert (state["controller"] or {}).get("id") == (controllers[0]["id"] if controllers else None)
        assert state["request"] is None or state["request"]["id"] != (state["controller"] or {}).get("id")
