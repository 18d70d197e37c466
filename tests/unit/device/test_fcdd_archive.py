"""Labelled pictures from disk."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from device.errors import Invalid
from device.fcdd.archive import SHIPPED_CLASSES, class_name, read_archive, read_boxes, read_classes, read_picture
from estimators.detections import CLASSES


def _picture(path: Path) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(path), np.full((8, 10, 3), 90, np.uint8))


def test_manifest(tmp_path: Path) -> None:
    _picture(tmp_path / "a.jpg")
    rows = [{"image": "a.jpg", "labels": ["displaced_joint", "roots"], "source": "k01"}]
    (tmp_path / "manifest.json").write_text(json.dumps(rows), encoding="utf-8")
    (still,) = read_archive(tmp_path)
    assert still.labels == {"displaced joint", "roots"}
    assert (still.source, still.cluster) == ("k01", "a.jpg")
    assert read_picture(still).shape == (8, 10, 3)


def test_one_folder_per_class_or_code(tmp_path: Path) -> None:
    for name in ("CN/1.jpg", "DES/2.jpg", "JDM/3.png", "FL/4.jpg", "RM/4.jpg", "normal/5.jpg", "papers/6.jpg", "CN/notes.txt"):
        _picture(tmp_path / name) if name.endswith(("jpg", "png")) else (tmp_path / name).write_text("x")
    found = {still.path.name: still.labels for still in read_archive(tmp_path)}
    assert found == {
        "1.jpg": {"connection"},
        "2.jpg": {"deposit"},
        "3.png": {"displaced joint"},
        "4.jpg": {"fracture", "roots"},
        "5.jpg": {"normal"},
    }


@pytest.mark.parametrize(
    ("folder", "label"),
    [
        ("CN", "connection"),
        ("DEG", "deposit"),
        ("JDL", "displaced joint"),
        ("FM", "fracture"),
        ("RT", "roots"),
        ("Displaced_Joint", "displaced joint"),
        ("root", "roots"),
        ("notes", None),
        ("FRIENDS", None),
        ("OB", None),
    ],
)
def test_codes(folder: str, label: str | None) -> None:
    assert SHIPPED_CLASSES.of_folder(folder) == label


def test_names_of_classes_are_written_one_way() -> None:
    assert class_name("Displaced_Joint") == class_name("joint displaced") == "displaced joint"


@pytest.mark.parametrize("text", ["", "{}", "[1]", '[{"image": "a.jpg"}]', '[{"image": "../a.jpg", "labels": []}]'])
def test_a_broken_manifest_is_one_sentence(tmp_path: Path, text: str) -> None:
    (tmp_path / "manifest.json").write_text(text, encoding="utf-8")
    with pytest.raises(Invalid) as told:
        read_archive(tmp_path)
    assert str(told.value).endswith(".")
    assert "\n" not in str(told.value)


def test_a_broken_picture_is_named(tmp_path: Path) -> None:
    (tmp_path / "roots").mkdir()
    (tmp_path / "roots" / "bad.jpg").write_bytes(b"no picture")
    (still,) = read_archive(tmp_path)
    with pytest.raises(Invalid, match=r"bad\.jpg is not a picture"):
        read_picture(still)


def test_an_empty_or_missing_folder_is_told(tmp_path: Path) -> None:
    with pytest.raises(Invalid, match="no labelled pictures"):
        read_archive(tmp_path)
    with pytest.raises(Invalid, match="no folder"):
        read_archive(tmp_path / "none")


def test_the_shipped_class_file_names_the_classes_of_the_paper() -> None:
    assert SHIPPED_CLASSES.names == CLASSES


def test_a_class_file_adds_classes_and_the_longest_code_wins(tmp_path: Path) -> None:
    file = tmp_path / "classes.json"
    file.write_text(json.dumps({"roots": ["R"], "Repair_Point": ["RP"], "obstacle": []}), encoding="utf-8")
    classes = read_classes(file)
    assert classes.names == ("roots", "repair point", "obstacle")
    assert [classes.of_folder(name) for name in ("RM", "RPL", "obstacle", "CN")] == ["roots", "repair point", "obstacle", None]
    for name in ("obstacle/1.jpg", "RPL/2.jpg", "CN/3.jpg"):
        _picture(tmp_path / name)
    found = {still.path.name: still.labels for still in read_archive(tmp_path, classes)}
    assert found == {"1.jpg": {"obstacle"}, "2.jpg": {"repair point"}}


@pytest.mark.parametrize(
    "text", ["", "[]", "{}", '{"roots": "R"}', '{"roots": [1]}', '{"normal": []}', '{"roots": [], "root": []}']
)
def test_a_broken_class_file_is_one_sentence(tmp_path: Path, text: str) -> None:
    file = tmp_path / "classes.json"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(Invalid) as told:
        read_classes(file)
    assert str(told.value).endswith(".")
    assert "\n" not in str(told.value)


def test_boxes_say_deposit_and_neighbours_belong_together(tmp_path: Path) -> None:
    for name, text in (("00212207", "0 .5 .5 .1 .1\n1 .5 .8 .2 .2\n"), ("00212299", "0 .5 .5 .1 .1\n"), ("00213001", "")):
        _picture(tmp_path / f"{name}.png")
        (tmp_path / f"{name}.txt").write_text(text, encoding="utf-8")
    (tmp_path / "classes.txt").write_text("joint", encoding="utf-8")
    first, second, third = read_boxes(tmp_path)
    assert [still.labels for still in (first, second, third)] == [{"deposit"}, set(), set()]
    assert first.cluster == second.cluster != third.cluster
    (tmp_path / "00213001.txt").write_text("no box", encoding="utf-8")
    with pytest.raises(Invalid, match="holds no boxes"):
        read_boxes(tmp_path)
    with pytest.raises(Invalid, match="no pictures with boxes"):
        read_boxes(tmp_path / "none")
