"""Labelled pictures from disk."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from device.errors import Invalid
from device.fcdd_archive import class_name, class_of_folder, read_archive, read_picture


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
    assert class_of_folder(folder) == label


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
    with pytest.raises(Invalid, match=r"bad\.jpg is no picture"):
        read_picture(still)


def test_an_empty_or_missing_folder_is_told(tmp_path: Path) -> None:
    with pytest.raises(Invalid, match="no labelled pictures"):
        read_archive(tmp_path)
    with pytest.raises(Invalid, match="no folder"):
        read_archive(tmp_path / "none")
