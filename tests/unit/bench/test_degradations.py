"""The fixed degradations must do what they are named for, the same each time, and leave their input alone."""

from __future__ import annotations

import numpy as np
import pytest

from tests.bench.degradations import DEGRADATIONS, degrade

FULL = np.full((120, 212), 800, dtype=np.uint16)


@pytest.mark.parametrize("name", DEGRADATIONS)
def test_same_every_time_and_the_original_untouched(name: str) -> None:
    depth = FULL.copy()
    depth[:, 100:] = 400
    before = depth.copy()
    spoiled = degrade(name, depth, "a/b.png")
    assert np.array_equal(spoiled, degrade(name, depth, "a/b.png"))
    assert np.array_equal(depth, before)
    assert spoiled.dtype == np.uint16
    assert spoiled.shape == depth.shape
    assert not np.array_equal(spoiled, depth)


@pytest.mark.parametrize(
    ("name", "share"),
    [
        ("crop left half", 0.5),
        ("crop lower third", 0.33),
        ("crop upper right quarter", 0.25),
        ("crop window 25 %", 0.0625),
        ("holes 60 %", 0.4),
        ("holes 90 %", 0.1),
        ("holes 98 %", 0.02),
    ],
)
def test_what_remains_is_as_much_as_the_name_says(name: str, share: float) -> None:
    spoiled = degrade(name, FULL, "frame")
    assert np.mean(spoiled > 0) == pytest.approx(share, abs=0.01)
    assert set(np.unique(spoiled)) == {0, 800}


def test_blur_smears_disparity_across_an_edge_but_leaves_a_flat_wall_and_wide_holes() -> None:
    depth = FULL.copy()
    depth[:, 100:] = 400
    depth[:, 160:] = 0
    spoiled = degrade("blur 4 %", depth, "frame")
    assert np.all(np.abs(spoiled[:, :60].astype(int) - 800) <= 1)
    between = spoiled[60, 95:105]
    assert np.all((between > 400) & (between < 800))
    harmonic_mean = 2 / (1 / 800 + 1 / 400)
    assert spoiled[60, 99:101].mean() == pytest.approx(harmonic_mean, rel=0.03)
    assert np.all(spoiled[:, 190:] == 0)


def test_sideways_blur_leaves_rows_apart() -> None:
    depth = FULL.copy()
    depth[60:] = 400
    spoiled = degrade("blur sideways 6 %", depth, "frame")
    assert np.all(spoiled[:60] == 800)
    assert np.all(spoiled[60:] == 400)
