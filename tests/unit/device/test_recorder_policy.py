"""Findings first, then the newest raw data."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from device.recorder.policy import Decision, DiskPolicy, Stored, decide

POLICY = DiskPolicy(keep_free=100, stop_free=50, findings_free=20)
A, B, C = Path("a"), Path("b"), Path("c")


def stored(*sizes: int, in_use: int | None = None) -> list[Stored]:
    return [Stored(path, size, number == in_use) for number, (path, size) in enumerate(zip((A, B, C), sizes, strict=False))]


@pytest.mark.parametrize(
    ("free", "sizes", "in_use", "expected"),
    [
        (100, (30, 30, 30), None, Decision((), True)),
        (99, (30, 30, 30), None, Decision((A,), True)),
        (60, (30, 30, 30), None, Decision((A, B), True)),
        (60, (30, 30, 30), 0, Decision((B, C), True)),
        (60, (), None, Decision((), True)),
        (30, (25,), None, Decision((A,), True)),
        (30, (19,), None, Decision((), False)),
        (49, (), None, Decision((), False)),
        (19, (5, 5), None, Decision((A, B), False)),
        (19, (5, 50), 1, Decision((A,), False)),
    ],
)
def test_by_hand(free: int, sizes: tuple[int, ...], in_use: int | None, expected: Decision) -> None:
    assert decide(free, stored(*sizes, in_use=in_use), POLICY) == expected


def test_recordings_may_have_a_share_of_their_own() -> None:
    policy = DiskPolicy(100, 50, 20, most_raw=70)
    assert decide(10_000, stored(30, 30, 30), policy) == Decision((A,), True)
    assert decide(10_000, stored(30, 30, 10), policy) == Decision((), True)


@given(
    free=st.integers(0, 300),
    files=st.lists(st.tuples(st.integers(1, 60), st.booleans()), max_size=8),
)
def test_rules(free: int, files: list[tuple[int, bool]]) -> None:
    them = [Stored(Path(str(number)), size, in_use) for number, (size, in_use) in enumerate(files)]
    decision = decide(free, them, POLICY)
    gone = [one for one in them if one.path in decision.remove]
    after = free + sum(one.size for one in gone)
    assert not any(one.in_use for one in gone)
    assert gone == [one for one in them if not one.in_use][: len(gone)]  # oldest first
    assert decision.may_record == (after >= POLICY.stop_free)
    if gone:
        assert free < POLICY.keep_free
        assert after - gone[-1].size < POLICY.keep_free  # not one more than needed
        assert decision.may_record or free < POLICY.findings_free  # never for nothing


def test_thresholds_in_the_wrong_order_are_refused() -> None:
    with pytest.raises(ValueError, match="must grow"):
        DiskPolicy(100, 200, 20)
