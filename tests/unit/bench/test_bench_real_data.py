"""How benchmarks judge a diameter against the truth, and what they crop."""

from __future__ import annotations

import numpy as np
import pytest

from estimators.pinhole import Intrinsics
from tests.bench import real_data


@pytest.mark.parametrize(
    ("diameter", "distance"), [(0.195, 0.0), (0.2, 0.0), (0.190, 0.005), (0.230, 0.030), (None, np.inf), (np.nan, np.inf)]
)
def test_error_is_the_distance_outside_the_interval(diameter: float | None, distance: float) -> None:
    assert real_data.distance_outside(diameter, (0.195, 0.2)) == pytest.approx(distance)


def test_pipes_known_only_roughly_have_a_wider_truth() -> None:
    def interval(pipe: str, low: float, high: float) -> tuple[float, float]:
        return real_data.truth_interval({"pipe": pipe, "interior_diameter_mm": [low, high]})

    assert interval("180mm", 180, 180) == (0.160, 0.200)
    assert interval("340mm", 340, 340) == (0.320, 0.360)
    assert interval("200mm_PVC", 188.2, 190.2) == pytest.approx((0.1882, 0.1902))


def test_the_crop_keeps_what_the_paper_keeps() -> None:
    intrinsics = Intrinsics(width=3, height=1, fx=1.0, fy=1.0, ppx=0.0, ppy=0.0)
    depth = np.array([[2500, 1000, 501]], dtype=np.uint16)  # X = 0, 1.0 and 1.002 m
    assert real_data.cropped_cloud(depth, intrinsics, 0.001) == pytest.approx(np.array([[0, 0, 2.5], [1, 0, 1]]))
    assert len(real_data.cropped_cloud(np.array([[0, 0, 0]], np.uint16), intrinsics, 0.001)) == 0
    assert len(real_data.cropped_cloud(np.array([[2501, 0, 0]], np.uint16), intrinsics, 0.001)) == 0
    assert len(real_data.cropped_cloud(np.array([[100, 0, 0]], np.uint16), intrinsics, 0.001, z_min=0.1)) == 0
