"""The filter on texts as an OCR misreads them: slips, lost signs and points, texts laid over the counter, resets."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.encoder.osd import Filtered, FilterSettings, OsdFilter
from tests.unit.drivers.osd_pictures import as_read


def counter(metres: float) -> str:
    """As the counter of the recording writes it: -0001.2."""
    return f"{'-' if metres < 0 else ''}{abs(metres):06.1f}"


def run(texts: list[str], step_s: float = 1.0, max_speed: float = 1.5) -> tuple[list[Filtered], OsdFilter]:
    """What is told live, and the filter."""
    sieve = OsdFilter(FilterSettings(max_speed))
    return [sieve.add(number * step_s, as_read(text)) for number, text in enumerate(texts)], sieve


DRIVE = [counter(7 + 0.6 * number) for number in range(12)]
"""7.0, 7.6 .. 13.6"""


@pytest.mark.parametrize(
    ("slipped", "distance", "status"),
    [
        ("8010.6", 10.6, "repaired"),  # 8 for 0
        ("0070.6", 10.6, "repaired"),  # 7 for 1
        ("0050.6", None, "rejected"),  # 5 is taken for 6 or 8, not for 1
        ("0086.6", None, "rejected"),  # two digits
        ("-0010.6", 10.6, "repaired"),
        ("00106", 10.6, "repaired"),  # the point lost
        ("0010.", None, "missing"),
        ("WATER", None, "missing"),
    ],
)
def test_a_slip_is_repaired_or_rejected(slipped: str, distance: float | None, status: str) -> None:
    texts = [*DRIVE]
    texts[6] = slipped
    live, sieve = run(texts)
    whole = sieve.smoothed()
    for told in (live[6], whole[6]):
        assert told.status == status
        assert told.distance == (None if distance is None else pytest.approx(distance))
    assert [one.distance for one in whole[:6] + whole[7:]] == pytest.approx([float(text) for text in DRIVE[:6] + DRIVE[7:]])
    assert sieve.resets() == []


def test_a_slip_in_the_first_picture_does_not_mislead() -> None:
    _, sieve = run(["8007.0", *DRIVE[1:]])
    whole = sieve.smoothed()
    assert whole[0].distance in (None, 7.0)
    assert [one.distance for one in whole[1:]] == pytest.approx([float(text) for text in DRIVE[1:]])
    assert sieve.resets() == []


def test_a_minus_that_is_missed_for_one_picture_is_put_back() -> None:
    live, sieve = run(["-0003.2", "-0003.1", "-0003.0", "0003.0", "-0002.9", "-0002.8"])
    assert live[3].distance == pytest.approx(-3.0)
    assert live[3].status == "repaired"
    assert sieve.resets() == []


def test_standing_still_is_no_fault() -> None:
    live, sieve = run(["0043.9"] * 30)
    assert {(one.distance, one.status) for one in live} == {(43.9, "read")}
    assert sieve.resets() == []


def test_driving_back_is_no_fault() -> None:
    texts = [counter(20 - 0.8 * number) for number in range(20)]
    live, sieve = run(texts)
    assert [one.distance for one in live] == pytest.approx([float(text) for text in texts])
    assert sieve.resets() == []


def test_a_reset_is_told_and_believed_three_seconds_later() -> None:
    texts = [*DRIVE, *(counter(0.2 * number) for number in range(12))]
    live, sieve = run(texts)
    (reset,) = sieve.resets()
    assert (reset.time_s, reset.before, reset.after) == (12.0, pytest.approx(13.6), 0.0)
    assert [one.distance for one in live[12:15]] == [None, None, None]
    assert live[15].distance == pytest.approx(0.6)
    assert live[15].segment == 1
    # afterwards the whole segment is known
    assert [one.distance for one in sieve.smoothed()] == pytest.approx([float(text) for text in texts])
    assert [one.segment for one in sieve.smoothed()] == [0] * 12 + [1] * 12


def test_text_laid_over_the_counter_for_some_seconds_is_not_believed() -> None:
    texts = [*DRIVE[:6], "0000.0", "0000.0", "0000.0", *DRIVE[6:]]
    _, sieve = run(texts)
    assert [one.distance for one in sieve.smoothed()[6:9]] == [None, None, None]
    assert sieve.resets() == []


def test_evidence_is_time_not_pictures() -> None:
    texts = [counter(round(21 + 0.01 * number, 1)) for number in range(200)]
    for number in range(100, 125):  # a second of laid-over text at 25 pictures a second
        texts[number] = "0000.0"
    _, sieve = run(texts, step_s=0.04)
    whole = sieve.smoothed()
    assert all(one.distance is None for one in whole[100:125])
    assert all(one.distance is not None for one in whole[:100] + whole[125:])
    assert sieve.resets() == []


def test_missing_pictures_leave_room_for_the_way_driven_meanwhile() -> None:
    sieve = OsdFilter(FilterSettings(max_speed=0.5))
    assert sieve.add(0.0, as_read("0010.0")).distance == pytest.approx(10.0)
    assert sieve.add(1.0, as_read("0012.0")).distance is None
    assert sieve.add(20.0, as_read("0018.0")).distance == pytest.approx(18.0)
    assert sieve.resets() == []


@pytest.mark.parametrize(("text", "quantum"), [("0013.8", 0.1), ("12.30 m", 0.01), ("100.5 ft", 0.03048), ("Dist 12 m", 1.0)])
def test_the_step_of_the_counter_is_found_in_the_text(text: str, quantum: float) -> None:
    _, sieve = run([text] * 3)
    assert sieve.quantum == pytest.approx(quantum)


def test_one_odd_reading_does_not_change_the_step() -> None:
    _, sieve = run(["0013.8", "0013.8", "0013.85", "0013.9"])
    assert sieve.quantum == pytest.approx(0.1)


def test_a_unit_that_is_misread_once_is_that_of_the_others() -> None:
    live, _ = run(["43.3 ft", "43.4 ft", "43.5 BT", "43.6 ft"])
    assert live[2].distance == pytest.approx(43.5 * 0.3048)


def test_readings_come_in_the_order_of_their_times() -> None:
    sieve = OsdFilter()
    sieve.add(2.0, as_read("0001.0"))
    with pytest.raises(ValueError, match="order of their times"):
        sieve.add(2.0, as_read("0001.0"))


@pytest.mark.parametrize("speed", [0.0, -1.0, float("nan"), 1e9])
def test_a_speed_that_no_crawler_has_is_refused(speed: float) -> None:
    with pytest.raises(ValueError, match="greatest speed"):
        FilterSettings(speed)


steps = st.lists(st.integers(-9, 9), min_size=10, max_size=40)
"""Tenths of a metre between pictures, a second apart."""


def positions(tenths: list[int], start: int) -> list[float]:
    values = [start]
    for step in tenths:
        values.append(values[-1] + step)
    return [value / 10 for value in values]


@settings(max_examples=60, deadline=None)
@given(steps, st.integers(-100, 4000))
def test_a_clean_drive_passes_untouched(tenths: list[int], start: int) -> None:
    values = positions(tenths, start)
    live, sieve = run([counter(value) for value in values])
    for told in (live, sieve.smoothed()):
        assert [one.distance for one in told] == pytest.approx(values)
        assert {one.status for one in told} == {"read"}
    assert sieve.resets() == []


@settings(max_examples=60, deadline=None)
@given(steps, st.integers(0, 4000), st.data())
def test_single_slips_never_mislead_by_more_than_a_crawler_could_have_driven(
    tenths: list[int], start: int, data: st.DataObject
) -> None:
    values = positions(tenths, start)
    texts = [counter(value) for value in values]
    for place in range(3, len(texts), 4):
        text = texts[place]
        digit, other = data.draw(st.integers(0, len(text) - 1)), data.draw(st.sampled_from("0123456789"))
        slips = ["", "-" + text, text.replace(".", ""), text[:digit] + other + text[digit + 1 :]]
        texts[place] = data.draw(st.sampled_from(slips))
    _, sieve = run(texts)
    for told, value in zip(sieve.smoothed(), values, strict=True):
        # 1.5 m/s from both neighbours, and two steps of the counter
        assert told.distance is None or abs(told.distance - value) <= 1.5 + 0.9 + 0.2 + 1e-9
    assert sieve.resets() == []


@settings(max_examples=40, deadline=None)
@given(steps, steps, st.integers(500, 4000))
def test_every_reset_of_the_operator_is_told(before: list[int], after: list[int], start: int) -> None:
    first, second = positions(before, start), positions(after, 0)
    _, sieve = run([counter(value) for value in first + second])
    leapt_m = abs(second[0] - first[-1])
    if leapt_m > 1.7 + 1e-6:
        (reset,) = sieve.resets()
        assert reset.before == pytest.approx(first[-1])
        assert reset.after == pytest.approx(second[0])
        assert [one.segment for one in sieve.smoothed()] == [0] * len(first) + [1] * len(second)
