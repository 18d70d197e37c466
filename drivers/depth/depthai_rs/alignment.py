"""pyrealsense2's ``align``: one stream seen from the place of another. For the eye: resampled depth is not measured on."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from drivers.depth.depthai_rs.frames import composite_frame, frame
from drivers.depth.depthai_rs.lens import extrinsics, intrinsics
from drivers.depth.depthai_rs.names import stream
from estimators.pinhole import Intrinsics, project_rays, rays


class align:
    """``align(stream.color)`` moves depth into the colour picture, ``align(stream.depth)`` colour into the depth picture."""

    def __init__(self, align_to: stream) -> None:
        if align_to not in (stream.color, stream.depth):
            raise RuntimeError(f"Cannot align to {align_to.name}")
        self._to = align_to

    def process(self, frames: composite_frame) -> composite_frame:
        """The same set with the moved stream in place of the original. Raises RuntimeError where one of the two is missing."""
        depth, color = frames.get_depth_frame(), frames.get_color_frame()
        if depth is None or color is None:
            raise RuntimeError("Alignment needs a depth and a colour frame")
        moved = _moved_depth(depth, color) if self._to is stream.color else _moved_color(depth, color)
        replaced = stream.depth if self._to is stream.color else stream.color
        return composite_frame([moved if item.profile.stream_type() is replaced else item for item in frames])


def _pixels_in_color(depth: frame, color: frame) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[Any]]:
    """For every measured depth pixel: where it lies in the colour picture (N, 2), its distance from there (N,), its index."""
    lens = _house(depth.profile.get_intrinsics())
    pose: extrinsics = depth.profile.get_extrinsics_to(color.profile)
    data = depth.get_data()
    index = np.flatnonzero(data)
    z = data.ravel()[index] * depth.get_units()
    directions = rays(lens).reshape(-1, 2)[index].astype(np.float64)
    points = np.column_stack([directions * z[:, None], z])
    seen = points @ np.reshape(pose.rotation, (3, 3)) + pose.translation
    ahead = seen[:, 2] > 0
    seen, index = seen[ahead], index[ahead]
    pixels = project_rays(seen[:, :2] / seen[:, 2:], _house(color.profile.get_intrinsics()))
    return pixels, seen[:, 2], index


def _moved_depth(depth: frame, color: frame) -> frame:
    target = color.profile.get_intrinsics()
    pixels, distance, _ = _pixels_in_color(depth, color)
    scale = max(target.fx / depth.profile.get_intrinsics().fx, 1.0)
    reach = int(np.ceil((scale - 1.0) / 2.0))  # a depth pixel covers several of a finer colour picture
    nearest = np.full((target.height, target.width), np.iinfo(np.uint16).max, np.uint16)
    units = np.clip(np.rint(distance / depth.get_units()), 1, np.iinfo(np.uint16).max - 1).astype(np.uint16)
    base = np.rint(pixels).astype(np.int64)
    for dy in range(-reach, reach + 1):
        for dx in range(-reach, reach + 1):
            u, v = base[:, 0] + dx, base[:, 1] + dy
            inside = (u >= 0) & (u < target.width) & (v >= 0) & (v < target.height)
            np.minimum.at(nearest, (v[inside], u[inside]), units[inside])
    nearest[nearest == np.iinfo(np.uint16).max] = 0
    return frame(nearest, depth.profile.seen_through(target), depth.get_frame_number(), depth.get_timestamp())


def _moved_color(depth: frame, color: frame) -> frame:
    source = depth.get_data()
    pixels, _, index = _pixels_in_color(depth, color)
    lookup = np.full((source.size, 2), -1.0, np.float32)
    lookup[index] = pixels
    lookup = lookup.reshape(*source.shape, 2)
    u, v = lookup[..., 0], lookup[..., 1]
    moved = cv2.remap(color.get_data(), u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT)
    lens: intrinsics = depth.profile.get_intrinsics()
    return frame(np.asarray(moved), color.profile.seen_through(lens), color.get_frame_number(), color.get_timestamp())


def _house(found: intrinsics) -> Intrinsics:
    return Intrinsics(
        found.width, found.height, found.fx, found.fy, found.ppx, found.ppy, found.model.name, tuple(found.coeffs)
    )
