"""What the network sees, over a picture."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from device.errors import Invalid
from device.landmarks.heatmaps import Heatmaps, painted
from estimators.detections import CLASSES


def test_paint_is_where_the_heat_is_and_nowhere_else() -> None:
    picture = np.full((60, 80, 3), 40, np.uint8)
    heat = np.zeros((6, 8), np.float32)
    heat[1, 6] = 1.0
    found = painted(picture, heat).astype(int)
    assert (found[30:, :40] == 40).all()
    hot = found[15, 65]
    # the far end of the scale is a bright yellow, seven tenths of it
    assert hot[2] > 150
    assert hot[1] > 150
    assert (painted(picture, np.zeros((6, 8), np.float32)) == picture).all()


def test_each_class_has_its_own_heat_and_an_unknown_one_is_told() -> None:
    rng = np.random.default_rng(1)
    picture = np.asarray(cv2.resize(rng.integers(0, 255, (9, 12, 3)).astype(np.uint8), (360, 288)), np.uint8)
    heatmaps = Heatmaps()
    found = [heatmaps.over(picture, label) for label in CLASSES]
    assert all(one.shape == picture.shape and one.dtype == np.uint8 for one in found)
    assert any((one != picture).any() for one in found)
    assert len({one.tobytes() for one in found}) > 1
    with pytest.raises(Invalid, match="There is no heatmap of cracks: the network knows connection, deposit"):
        heatmaps.over(picture, "cracks")


def test_a_jpeg_stays_a_jpeg_of_its_size() -> None:
    _, data = cv2.imencode(".jpg", np.full((96, 96, 3), 90, np.uint8))
    found = cv2.imdecode(np.frombuffer(Heatmaps().over_jpeg(data.tobytes(), "roots"), np.uint8), cv2.IMREAD_COLOR)
    assert found is not None
    assert found.shape == (96, 96, 3)
