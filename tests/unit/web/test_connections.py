"""The share of an address and the patience with a connection, by their rules alone."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from web_ui.connections import BURST, REQUESTS_S, _Share


def test_a_share_is_spent_by_a_burst_and_comes_back_with_time() -> None:
    share = _Share(BURST, 0.0)
    share.take(0.0, int(BURST))
    assert not share.spent(0.0)
    share.take(0.0, 1)
    assert share.spent(0.0)
    assert not share.spent(2 / REQUESTS_S)
    share.take(0.0, 10**9)
    assert share.spent(BURST / REQUESTS_S - 0.01)
    assert not share.spent(BURST / REQUESTS_S + 0.01), "whatever somebody did, the wait is short"


@given(st.lists(st.tuples(st.floats(0, 1), st.integers(1, 50)), min_size=1, max_size=200))
def test_nobody_is_heard_more_often_than_the_share(asked: list[tuple[float, int]]) -> None:
    share, now, heard = _Share(BURST, 0.0), 0.0, 0
    for later, count in asked:
        now += later
        if not share.spent(now):
            share.take(now, count)
            heard += count
    assert heard <= BURST + now * REQUESTS_S + 50  # the last one heard may overdraw


def test_ten_phones_behind_one_address_are_heard() -> None:
    share, now = _Share(BURST, 0.0), 0.0
    for _ in range(3000):
        now += 1 / 120  # 10 phones, 12 requests a second each: two pictures and the status
        assert not share.spent(now)
        share.take(now, 1)
    assert share.left == pytest.approx(BURST, abs=2)
