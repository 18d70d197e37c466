"""The distance read from pictures: its format among other numbers, its place, the fields of an interlaced picture."""

from __future__ import annotations

import pytest

from drivers.encoder.osd.text import Layout, find_distance

FORMATS = {
    "0013.8": (13.8, Layout(4, 1, "m")),
    "-0000.2": (-0.2, Layout(4, 1, "m")),
    "+012.3 m": (12.3, Layout(3, 1, "m")),
    "12.30M": (12.3, Layout(0, 2, "m")),
    "Dist: 0007.5": (7.5, Layout(4, 1, "m")),
    "Dist:0007.5M": (7.5, Layout(4, 1, "m")),
    "12,30 m": (12.3, Layout(0, 2, "m")),
    "Entf. 7,4m": (7.4, Layout(0, 1, "m")),
    "-1.2 m": (-1.2, Layout(0, 1, "m")),
    "− 0001.2": (-1.2, Layout(4, 1, "m")),
    "100.0 ft": (30.48, Layout(0, 1, "ft")),
    "0033.5'": (10.2108, Layout(4, 1, "ft")),
    "DISTANCE 52 FT": (15.8496, Layout(0, 0, "ft")),
    "OO13.B": (13.8, Layout(4, 1, "m")),
    "DIST 0007.5  DN 300": (7.5, Layout(4, 1, "m")),
    "0.0": (0.0, Layout(0, 1, "m")),
}


@pytest.mark.parametrize("text", FORMATS)
def test_a_distance_is_read_in_the_formats_of_the_trade(text: str) -> None:
    metres, layout = FORMATS[text]
    found = find_distance(text)
    assert found is not None
    assert found.metres == pytest.approx(metres, abs=1e-9)
    assert found.layout == layout


@pytest.mark.parametrize(
    "text",
    [
        "228",
        "12 TO 12",
        "12.03.2015",
        "10:34:12",
        "1.2 bar",
        "-0.5 %",
        "21.3°C",
        "DN 300",
        "1:100",
        "2.5 mm",
        "WATER LEVEL",
        "",
    ],
)
def test_other_numbers_on_the_screen_are_no_distance(text: str) -> None:
    assert find_distance(text) is None


def test_the_quantum_comes_from_the_decimals_and_the_unit() -> None:
    assert Layout(0, 2, "m").quantum == pytest.approx(0.01)
    assert Layout(4, 1, "ft").quantum == pytest.approx(0.03048)


def test_a_line_that_says_it_is_a_distance_beats_a_bare_number() -> None:
    bare, labelled = find_distance("3.25"), find_distance("Dist: 0003.2 m")
    assert bare is not None
    assert labelled is not None
    assert labelled.likeness > bare.likeness


def test_a_number_without_unit_is_in_the_unit_that_is_meant() -> None:
    found = find_distance("0010.0", unit="ft")
    assert found is not None
    assert found.metres == pytest.approx(3.048)
