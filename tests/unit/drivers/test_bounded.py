"""Calls that may hang: an end to the waiting, what becomes of a call that comes back late, and threads that are used again."""

from __future__ import annotations

import threading

import pytest

from drivers.base import SensorLost
from drivers.bounded import call_within
from tests.waiting import wait_until

SOON_S = 0.05


def test_the_value_or_what_was_raised_comes_back() -> None:
    assert call_within(5.0, lambda: 7, "late") == 7
    assert call_within(5.0, lambda: None, "late") is None

    def fail() -> None:
        raise RuntimeError("no frame")

    with pytest.raises(RuntimeError, match="no frame"):
        call_within(5.0, fail, "late")


def test_a_hundred_calls_need_one_thread() -> None:
    assert len({call_within(5.0, threading.get_ident, "late") for _ in range(100)}) == 1


def test_a_call_that_hangs_is_left_behind_and_undone_when_it_comes_back() -> None:
    go, undone = threading.Event(), []

    def hang() -> int:
        go.wait(20)
        return threading.get_ident()

    with pytest.raises(SensorLost, match="The camera hangs"):
        call_within(SOON_S, hang, "The camera hangs.", undo=undone.append)
    others = {call_within(5.0, threading.get_ident, "late") for _ in range(3)}
    go.set()
    wait_until(lambda: bool(undone))
    assert undone[0] not in others, "the next calls did not wait behind it"


def test_what_fails_late_is_not_undone() -> None:
    go, over, undone = threading.Event(), threading.Event(), []

    def hang() -> None:
        go.wait(20)
        over.set()
        raise RuntimeError("gone")

    with pytest.raises(SensorLost):
        call_within(SOON_S, hang, "The camera hangs.", undo=undone.append)
    go.set()
    assert over.wait(20)
    assert call_within(5.0, lambda: 7, "late") == 7
    assert undone == []
