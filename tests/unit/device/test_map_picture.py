"""The unrolled map as a picture."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from device.errors import Invalid
from device.landmarks.picture import COLORS, map_picture, save_map_picture


def landmark(label: str, chainage: float, clock: float | None, to: float | None = None, clock_to: float | None = None) -> Any:
    return {
        "class": label,
        "chainage_m": chainage,
        "chainage_to_m": chainage if to is None else to,
        "clock": clock,
        "clock_to": clock if clock_to is None else clock_to,
    }


def places(picture: np.ndarray, label: str) -> tuple[np.ndarray, np.ndarray]:
    """Rows and columns of the pixels in the colour of ``label``."""
    found: tuple[np.ndarray, np.ndarray] = np.nonzero((picture == COLORS[label]).all(axis=2))
    return found


def test_further_is_further_right_and_the_crown_is_in_the_middle() -> None:
    picture = map_picture([landmark("connection", 2.0, 12.0), landmark("roots", 8.0, 3.0), landmark("fracture", 5.0, 9.0)], [])
    middles = {label: (np.median(places(picture, label)[0]), places(picture, label)[1].min()) for label in COLORS if
               len(places(picture, label)[0])}  # fmt: skip
    assert middles["connection"][1] < middles["fracture"][1] < middles["roots"][1]
    assert middles["fracture"][0] < middles["connection"][0] < middles["roots"][0]


def test_what_lies_on_the_invert_shows_at_both_edges() -> None:
    rows, _ = places(map_picture([landmark("deposit", 3.0, 5.0, 6.0, 7.0)], []), "deposit")
    assert rows.max() - rows.min() > 330
    assert not ((rows > 150) & (rows < 290)).any()


def test_an_empty_map_and_a_mark_without_clock_are_drawn_too() -> None:
    assert map_picture([], []).shape[1] > 600
    rows, _ = places(map_picture([landmark("roots", 3.0, None)], [{"chainage_m": 1.0, "sightings": 3}]), "roots")
    assert rows.max() - rows.min() > 350


def test_it_is_saved_and_what_cannot_be_is_said(tmp_path: Path) -> None:
    found = {"landmarks": [], "rings": []}
    save_map_picture(tmp_path / "map.png", found)
    assert cv2.imread(str(tmp_path / "map.png")) is not None
    for bad in (tmp_path / "map.gif", tmp_path / "nowhere" / "map.png"):
        with pytest.raises(Invalid) as told:
            save_map_picture(bad, found)
        assert str(told.value).endswith(".")
