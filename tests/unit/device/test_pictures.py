import threading
import time
from dataclasses import replace

import cv2
import numpy as np

from device.pictures import PictureCache, depth_in_colors
from drivers.depth.base import DepthFrame
from estimators.pinhole import Intrinsics

WIDE = Intrinsics(848, 480, 420.0, 420.0, 424.0, 240.0)


def picture(depth_mm: int, moment: int = 1) -> DepthFrame:
    return DepthFrame(np.full((480, 848), depth_mm, np.uint16), WIDE, 0.001, moment, 1)


def decoded(data: bytes) -> np.ndarray:
    return cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)


def test_near_is_red_far_is_blue_and_nothing_is_black() -> None:
    near, far, nothing = (depth_in_colors(picture(mm))[0, 0].astype(int) for mm in (150, 2400, 0))
    assert near[2] > near[0] + 50
    assert far[0] > far[2]
    assert nothing.tolist() == [0, 0, 0]


def test_equal_distances_look_equal_whatever_the_unit() -> None:
    millimetres = picture(400)
    tenths = replace(millimetres, depth=millimetres.depth * 10, depth_unit_m=0.0001)
    assert np.array_equal(depth_in_colors(millimetres), depth_in_colors(tenths))


def test_pictures_are_at_most_640_wide() -> None:
    frame = replace(picture(500), color=np.full((1080, 1920, 3), 128, np.uint8))
    for kind in ("depth", "color"):
        data = PictureCache().jpeg("front", kind, frame)
        assert data is not None
        assert decoded(data).shape[1] <= 640
        assert abs(decoded(data).shape[1] / decoded(data).shape[0] - 16 / 9) < 0.02


def test_a_frame_is_encoded_once_and_a_new_one_replaces_it() -> None:
    cache = PictureCache()
    first = cache.jpeg("front", "depth", picture(300, moment=1))
    assert cache.jpeg("front", "depth", picture(2000, moment=1)) is first  # the same moment is the same frame
    assert cache.jpeg("front", "depth", picture(2000, moment=99_000_000)) is first  # fresh enough for another phone
    assert cache.jpeg("front", "depth", picture(2000, moment=100_000_001)) != first


def test_a_camera_without_colour_has_no_colour_picture() -> None:
    assert PictureCache().jpeg("front", "color", picture(300)) is None


def test_however_many_look_at_once_a_picture_is_made_once() -> None:
    cache, made, begin = PictureCache(), [], threading.Barrier(8)

    def make() -> bytes:
        made.append(1)
        time.sleep(0.05)
        return b"picture"

    def look() -> None:
        begin.wait()
        assert cache.shared("front", 1, make) == b"picture"

    lookers = [threading.Thread(target=look) for _ in range(8)]
    for looker in lookers:
        looker.start()
    for looker in lookers:
        looker.join()
    assert made == [1]
    assert cache.shared("front", 10**9, lambda: None) is None
    assert cache.shared("front", 1, lambda: b"a clock set back") == b"a clock set back"
    assert cache.shared("other", 1, lambda: b"x") == b"x"
