"""Heatmaps to detections."""

import numpy as np
import pytest

from estimators.detections import from_heatmaps


def blank(width: int = 40, height: int = 30) -> np.ndarray:
    return np.zeros((height, width), dtype=np.float32)


def test_two_patches_of_one_class_are_two_detections_with_the_centroids_of_their_pixels() -> None:
    heat = blank()
    heat[5:9, 10:20] = 2.0  # rows 5..8, columns 10..19
    heat[20:23, 30:33] = 3.0
    strong, weak = from_heatmaps({"roots": heat}, {"roots": 1.0}, (40, 30))
    assert (strong.u, strong.v, strong.area) == (31.0, 21.0, 9.0)
    assert (weak.u, weak.v, weak.area) == (14.5, 6.5, 40.0)
    assert strong.score == pytest.approx(1 - np.exp(-3.0))
    assert weak.score == pytest.approx(1 - np.exp(-2.0))


def test_each_class_has_its_own_threshold_and_a_class_without_one_is_refused() -> None:
    heat = blank()
    heat[5:9, 5:9] = 1.0
    both = {"roots": heat, "fracture": heat}
    assert [d.label for d in from_heatmaps(both, {"roots": 0.5, "fracture": 1.5}, (40, 30))] == ["roots"]
    with pytest.raises(ValueError, match="no threshold for the class 'fracture'"):
        from_heatmaps(both, {"roots": 0.5}, (40, 30))


def test_a_coarse_map_is_brought_to_the_size_of_the_picture() -> None:
    heat = np.zeros((9, 9), dtype=np.float32)
    heat[2, 6] = 4.0
    (found,) = from_heatmaps({"deposit": heat}, {"deposit": 1.0}, (720, 576))
    # The middle of cell (6, 2) of a 9 x 9 grid; bilinear slopes are even on both sides.
    assert (found.u, found.v) == (pytest.approx(6.5 * 80 - 0.5, abs=0.6), pytest.approx(2.5 * 64 - 0.5, abs=0.6))


def test_outline_lies_on_the_border_of_the_component() -> None:
    heat = blank()
    heat[5:15, 10:31] = 2.0
    (found,) = from_heatmaps({"deposit": heat}, {"deposit": 1.0}, (40, 30))
    u, v = np.array(found.outline).T
    assert len(u) <= 32
    assert np.all((u == 10) | (u == 30) | (v == 5) | (v == 14))
    assert (u.min(), u.max(), v.min(), v.max()) == (10, 30, 5, 14)


def test_specks_and_empty_maps_give_nothing() -> None:
    heat = blank()
    heat[3, 3] = 9.0
    assert from_heatmaps({"roots": heat}, {"roots": 1.0}, (40, 30), least_area=2) == []
    assert from_heatmaps({"roots": blank()}, {"roots": 1.0}, (40, 30)) == []
