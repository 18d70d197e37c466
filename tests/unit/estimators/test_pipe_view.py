"""Whether a picture shows a pipe: on drawn pictures, and on real ones."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from estimators.pipe_view import pipe_view

Gray = NDArray[np.uint8]


def drawn(u: float = 180.0, v: float = 144.0, light: float = 1.0, size: tuple[int, int] = (288, 360)) -> Gray:
    """A pipe whose end lies at (u, v): light falls off with depth, depth goes with 1 / distance from the end."""
    rows, columns = np.mgrid[: size[0], : size[1]]
    depth = 60.0 / np.maximum(np.hypot(columns - u, rows - v), 2.0)
    return np.clip(light * 200 / (0.6 + depth), 0, 255).astype(np.uint8)


@settings(max_examples=40, deadline=None)
@given(st.floats(120, 240), st.floats(100, 190), st.floats(0.6, 1.2), st.sampled_from(((288, 360), (576, 720), (96, 120))))
def test_a_pipe_is_one_wherever_its_end_lies(u: float, v: float, light: float, size: tuple[int, int]) -> None:
    scale = size[0] / 288
    gray = cv2.resize(drawn(u, v, light), (size[1], size[0]), interpolation=cv2.INTER_AREA)
    assert pipe_view(np.asarray(gray, np.uint8)).pipe, scale


@pytest.mark.parametrize(
    "gray",
    [
        np.full((288, 360), 120, np.uint8),
        np.tile(np.linspace(40, 200, 360), (288, 1)).astype(np.uint8),
        255 - drawn(light=1.2),  # bright in the middle: a lamp, the cover of a manhole
        drawn(u=10.0, v=10.0),  # dark at the edge only
    ],
    ids=["wall", "wall aslant", "lamp", "dark corner"],
)
def test_what_is_no_pipe(gray: Gray) -> None:
    view = pipe_view(gray)
    assert (view.lit, view.pipe) == (True, False)


@pytest.mark.parametrize("light", [0.0, 0.05])
def test_in_the_dark_nothing_is_seen(light: float) -> None:
    view = pipe_view(drawn(light=light))
    assert (view.lit, view.pipe) == (False, False)


def test_real_pictures_along_the_pipe_are_pipes_and_those_of_the_wall_and_the_manhole_are_not(data_dir: Path) -> None:
    def share(first: int, last: int) -> float:
        files = [data_dir / "cctv_run" / f"{second}000.jpg" for second in range(first, last + 1)]
        pictures = [cv2.imread(str(file), cv2.IMREAD_GRAYSCALE) for file in files if file.exists()]
        assert pictures
        return float(np.mean([pipe_view(np.asarray(picture, np.uint8)).pipe for picture in pictures]))

    assert share(100, 190) > 0.95  # down the pipe
    assert share(73, 93) == 0.0  # a crack in the wall, close
    assert share(250, 277) == 0.0  # up the manhole
