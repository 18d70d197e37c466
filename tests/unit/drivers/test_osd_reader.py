"""The distance read from pictures: its format among other numbers, its place, the fields of an interlaced picture."""

from __future__ import annotations

import socket
import sys
import time
from pathlib import Path

import cv2
import numpy as np
import pytest

from drivers.base import SensorMissing
from drivers.encoder.osd import OsdReader
from drivers.encoder.osd.text import Layout, find_distance
from tests.unit.drivers.osd_pictures import burn, wall

FORMATS = {
    "0013.8": (13.8, Layout(4, 1, "m")),
    "-0000.2": (-0.2, Layout(4, 1, "m")),
    "+012.3 m": (12.3, Layout(3, 1, "m")),
    "12.30M": (12.3, Layout(0, 2, "m")),
    "Dist: 0007.5": (7.5, Layout(4, 1, "m")),
    "Dist:0007.5M": (7.5, Layout(4, 1, "m")),
    "LC1:+0052.10m": (52.1, Layout(4, 2, "m")),
    "距离：14.21 m": (14.21, Layout(0, 2, "m")),
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


@pytest.fixture(scope="module")
def reader() -> OsdReader:
    """One reader for the tests that do not look at its memory: loading the models takes half a second."""
    return OsdReader(look_again=0)


@pytest.mark.parametrize(
    ("text", "metres"),
    [
        ("0013.8", 13.8),
        ("-0000.7", -0.7),
        ("+012.3 m", 12.3),
        ("12.30M", 12.3),
        ("Dist: 0007.5", 7.5),
        ("100.5 ft", 100.5 * 0.3048),
        ("DIST 4,25 m", 4.25),
    ],
)
@pytest.mark.parametrize("boxed", [True, False])
def test_it_finds_and_reads_the_distance_among_other_lines(reader: OsdReader, text: str, metres: float, boxed: bool) -> None:
    image = burn(wall(seed=len(text)), "MH 221 - MH 228", (20, 30), boxed=boxed)
    image = burn(burn(image, "12.03.2015  10:34", (150, 70), boxed=boxed), text, (30, 255), boxed=boxed)
    seen = reader.read(image)
    assert seen.distance == pytest.approx(metres, abs=1e-9)
    assert seen.box is not None
    x, y, width, height = seen.box
    assert y < 248 < y + height
    assert x < 60 < x + width


def test_a_picture_without_distance_has_none(reader: OsdReader) -> None:
    assert reader.read(wall()).distance is None
    assert reader.read(burn(wall(), "WATER LEVEL 25 %", (30, 200), boxed=True)).distance is None


def test_once_found_only_the_strip_is_read_until_the_line_moves() -> None:
    reader = OsdReader()
    for step in range(4):
        assert reader.read(burn(wall(), f"{7 + step / 10:06.1f}", (30, 255), boxed=True)).distance == pytest.approx(
            7 + step / 10
        )
    assert reader.searches == 1
    moved = burn(burn(wall(), "CRACK", (30, 255), boxed=True), "0007.4", (30, 220), boxed=True)
    assert reader.read(moved).distance == pytest.approx(7.4)
    assert reader.searches == 2
    # back at its old place: that one is still known
    assert reader.read(burn(wall(), "0007.5", (30, 255), boxed=True)).distance == pytest.approx(7.5)
    assert reader.read(moved).distance == pytest.approx(7.4)
    assert reader.searches == 2


def test_a_sign_that_appears_is_read_in_the_strip() -> None:
    reader = OsdReader()
    assert reader.read(burn(wall(), "0000.2", (60, 255), boxed=True)).distance == pytest.approx(0.2)
    assert reader.read(burn(wall(), "-0000.3", (60, 255), boxed=True)).distance == pytest.approx(-0.3)
    assert reader.searches == 1


def test_a_counter_written_from_the_right_keeps_the_digit_that_it_gains() -> None:
    reader = OsdReader()
    for text, at in (("9.8 m", 100), ("9.9 m", 100), ("10.0 m", 86), ("10.1 m", 86)):
        assert reader.read(burn(wall(), text, (at, 255), boxed=True)).distance == pytest.approx(float(text[:-2])), text


def test_a_minus_left_of_a_counter_written_from_the_right_is_seen() -> None:
    reader = OsdReader()
    for text, at in (("0.1 m", 100), ("0.0 m", 100), ("-0.1 m", 84), ("-0.2 m", 84)):
        assert reader.read(burn(wall(), text, (at, 255), boxed=True)).distance == pytest.approx(float(text[:-2])), text


def test_without_text_it_searches_less_and_less_often() -> None:
    reader = OsdReader()
    blank = wall(height=64, width=96)
    for _ in range(20):
        assert reader.read(blank).distance is None
    assert reader.searches == 5  # pictures 1, 3, 6, 11, 20
    assert reader.read(burn(wall(), "0001.0", (30, 255), boxed=True), patient=False).distance == pytest.approx(1.0)


def test_a_region_confines_the_search() -> None:
    image = burn(burn(wall(), "0013.8 m", (30, 40), boxed=True), "2.75", (200, 255), boxed=True)
    assert OsdReader().read(image).distance == pytest.approx(13.8)
    seen = OsdReader(region=(180, 220, 200, 60)).read(image)
    assert seen.distance == pytest.approx(2.75)
    assert seen.box is not None
    assert seen.box[0] >= 180
    assert seen.box[1] >= 220


def test_a_region_outside_the_picture_has_no_distance() -> None:
    assert OsdReader(region=(5000, 5000, 50, 20)).read(burn(wall(), "0013.8", (30, 40))).distance is None


@pytest.mark.parametrize("region", [(0, 0, 0, 20), (-1, 0, 50, 20), (0, 0, 50, 2)])
def test_a_region_is_a_rectangle_of_pixels(region: tuple[int, int, int, int]) -> None:
    with pytest.raises(ValueError, match="A region is x, y, width and height"):
        OsdReader(region=region)


def test_a_counter_that_turns_between_the_fields_is_read_in_each() -> None:
    reader = OsdReader()
    before, after = (burn(wall(), text, (30, 255), size=0.9, boxed=True) for text in ("0011.7", "0011.8"))
    assert reader.read(before).distance == pytest.approx(11.7)
    woven = before.copy()
    woven[1::2] = after[1::2]
    seen = reader.read(woven)
    assert seen.distance is not None
    assert {seen.distance, *seen.others} == {11.7, 11.8}


def test_reading_needs_no_network(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise AssertionError("somebody asked the network")

    monkeypatch.setattr(socket.socket, "connect", refuse)
    monkeypatch.setattr(socket, "getaddrinfo", refuse)
    assert OsdReader().read(burn(wall(), "0013.8", (30, 255), boxed=True)).distance == pytest.approx(13.8)


def test_reading_takes_one_core(reader: OsdReader) -> None:
    image = burn(wall(), "0013.8", (30, 255), boxed=True)
    reader.read(image)
    computing, clock = time.process_time(), time.perf_counter()
    for _ in range(4):
        reader.read(image)
    # a pool of onnxruntime's own would spin on every core that there is
    assert time.process_time() - computing < 1.3 * (time.perf_counter() - clock)


@pytest.mark.parametrize("package", ["rapidocr", "onnxruntime"])
def test_without_the_extra_it_says_how_to_install_it(package: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(SensorMissing, match=rf"{package} is not installed: run pip install 'borescout\[osd\]'"):
        OsdReader()


def test_real_pictures_are_read(data_dir: Path) -> None:
    folder = data_dir / "cctv_run"
    if not folder.is_dir():
        pytest.skip("no cctv_run among the recordings")
    reader = OsdReader()
    # plain, negative, turning between the fields, one line up under an observation, two digits turning at once
    for second, values in {60: {13.8}, 118: {-1.6}, 141: {11.7, 11.8}, 191: {35.3}, 204: {39.2}, 244: {50.9, 51.0}}.items():
        seen = reader.read(np.asarray(cv2.imread(str(folder / f"{second}000.jpg")), dtype=np.uint8))
        assert seen.distance in values, second
