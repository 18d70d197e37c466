"""Identifiers of pipes and manholes: built from the manholes, refused where taken, doubted where they look like a slip."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from device.export.base import fitting
from device.inspections.identifiers import LONGEST, judge_node, judge_pipe, of_pipe

OTHERS = {"MH 14-MH 15": ("MH 14", "MH 15"), "Elm Road": ("MH 7", "")}
MANHOLES = {"MH 7", "MH 14", "MH 15"}


@pytest.mark.parametrize(
    ("ends", "built"),
    [(("A", "B"), "A-B"), ((" A ", ""), "A"), (("", "B"), "B"), (("", " "), ""), (("MH 1", "MH 2"), "MH 1-MH 2")],
)
def test_a_pipe_is_called_by_its_manholes(ends: tuple[str, str], built: str) -> None:
    assert of_pipe(*ends) == built


@given(st.text(max_size=60), st.text(max_size=60), st.text(max_size=80))
def test_what_is_free_and_undoubted_can_be_exported(upstream: str, downstream: str, name: str) -> None:
    judged = judge_pipe(name, upstream, downstream, OTHERS, MANHOLES)
    if judged.error is None and not judged.warnings:
        assert len(judged.name) <= LONGEST
        assert judged.name.encode("ISO-8859-1")
        assert judged.name not in OTHERS


@pytest.mark.parametrize(
    ("typed", "error"),
    [
        (("", "", ""), "Name the pipe, or one of its manholes."),
        (("", "MH 14", "MH 15"), "There is already a pipe called MH 14-MH 15."),
        (("Elm Road", "", ""), "There is already a pipe called Elm Road."),
        (("X", "MH 7", " MH 7 "), "A pipe joins two manholes; both of this one are called MH 7."),
    ],
)
def test_refused(typed: tuple[str, str, str], error: str) -> None:
    assert judge_pipe(*typed, OTHERS, MANHOLES).error == error


@pytest.mark.parametrize(
    ("typed", "warning"),
    [
        (("elm  road", "", ""), "There is a pipe called Elm Road: is elm  road another one?"),
        (("", "mh14", "MH 16"), "There is a manhole called MH 14: is mh14 another one?"),
        (("", "MH-014", "MH 16"), "There is a manhole called MH 14: is MH-014 another one?"),
        (("Second", "MH 15", "MH 14"), "MH 15 and MH 14 are already joined by the pipe MH 14-MH 15."),
        (("x" * 31, "", ""), "has 31 letters; ISYBAU and EN 13508-2 files hold 30"),
        (("Łąka", "", ""), "Ł in Łąka cannot be written in ISYBAU and EN 13508-2 files (ISO-8859-1)."),
    ],
)
def test_doubted(typed: tuple[str, str, str], warning: str) -> None:
    judged = judge_pipe(*typed, OTHERS, MANHOLES)
    assert judged.error is None
    assert any(warning in one for one in judged.warnings), judged.warnings


def test_other_numbers_are_no_slip() -> None:
    assert judge_pipe("", "MH 1", "MH 41", OTHERS, MANHOLES).warnings == ()
    assert judge_node("MH 16", MANHOLES).warnings == ()
    assert judge_node("1-12", {"11-2", "112"}).warnings == ()


def test_manholes_are_judged_alike() -> None:
    assert judge_node(" ", MANHOLES).error == "Name the manhole."
    assert judge_node(" MH 14 ", MANHOLES).error == "There is already a manhole called MH 14."
    assert judge_node("Mh14", MANHOLES).warnings == ("There is a manhole called MH 14: is Mh14 another one?",)


def test_the_longest_name_is_the_formats() -> None:
    name = "x" * LONGEST
    assert judge_node(name, ()).warnings == ()
    assert fitting(name, LONGEST, "The name") == name
