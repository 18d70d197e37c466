"""dai.ImgFrame as pyrealsense2's frames and stream profiles."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.depth.depthai_rs.lens import extrinsics, intrinsics, stated_intrinsics
from drivers.depth.depthai_rs.names import format, stream

DEPTH_UNIT_M = 0.001
"""StereoDepth and ToF are set to millimetres."""


class stream_profile:
    """One stream that runs: what it is, and the lens it is seen through.

    ``lens`` gives the intrinsics from the calibration; it is asked when they are, since a lens may have no counterpart.
    """

    def __init__(
        self,
        kind: stream,
        index: int,
        pixels: format,
        size: tuple[int, int],
        fps: int,
        lens: Callable[[], intrinsics],
        rectified: bool,
        to: Callable[[stream_profile], extrinsics] | None = None,
    ) -> None:
        self._kind, self._index, self._pixels, self._size, self._fps = kind, index, pixels, size, fps
        self._lens, self._to = lens, to
        self.rectified = rectified

    def stream_type(self) -> stream:
        return self._kind

    def stream_index(self) -> int:
        return self._index

    def format(self) -> format:
        return self._pixels

    def fps(self) -> int:
        return self._fps

    def width(self) -> int:
        return self._size[0]

    def height(self) -> int:
        return self._size[1]

    def as_video_stream_profile(self) -> stream_profile:
        return self

    def get_intrinsics(self) -> intrinsics:
        return self._lens()

    def get_extrinsics_to(self, other: stream_profile) -> extrinsics:
        if self._to is None:
            raise RuntimeError("Requested extrinsics are not available!")
        return self._to(other)

    def seen_through(self, lens: intrinsics) -> stream_profile:
        """The same stream with the lens a frame states of itself."""
        return stream_profile(
            self._kind, self._index, self._pixels, (lens.width, lens.height), self._fps, lambda: lens, self.rectified, self._to
        )


class frame:
    """One picture. ``get_data`` gives (H, W) uint16 for depth, (H, W) uint8 for infrared, (H, W, 3) uint8 for colour."""

    def __init__(self, data: NDArray[Any], profile: stream_profile, number: int, timestamp_ms: float) -> None:
        self._data = data
        self.profile = profile
        self._number = number
        self._timestamp_ms = timestamp_ms

    def __bool__(self) -> bool:
        return True

    def get_data(self) -> NDArray[Any]:
        return self._data

    def get_frame_number(self) -> int:
        return self._number

    def get_timestamp(self) -> float:
        """Milliseconds of the device's clock."""
        return self._timestamp_ms

    def get_width(self) -> int:
        return int(self._data.shape[1])

    def get_height(self) -> int:
        return int(self._data.shape[0])

    def get_units(self) -> float:
        if self.profile.stream_type() is not stream.depth:
            raise RuntimeError("Only a depth frame has units")
        return DEPTH_UNIT_M

    def get_distance(self, x: int, y: int) -> float:
        """Metres at a pixel, 0 where nothing was measured."""
        return float(self._data[y, x]) * self.get_units()


class composite_frame:
    """The pictures of one moment. A stream that has none yet gives None, which is false like pyrealsense2's empty frame."""

    def __init__(self, frames: list[frame]) -> None:
        self._frames = frames

    def __iter__(self) -> Iterator[frame]:
        return iter(self._frames)

    def __len__(self) -> int:
        return len(self._frames)

    def size(self) -> int:
        return len(self._frames)

    def _find(self, kind: stream, index: int = 0) -> frame | None:
        for found in self._frames:
            if found.profile.stream_type() is kind and index in (0, found.profile.stream_index()):
                return found
        return None

    def get_depth_frame(self) -> frame | None:
        return self._find(stream.depth)

    def get_color_frame(self) -> frame | None:
        return self._find(stream.color)

    def get_infrared_frame(self, index: int = 0) -> frame | None:
        return self._find(stream.infrared, index)


def frame_of(message: Any, profile: stream_profile) -> frame:
    """A frame from a dai.ImgFrame. Raises RuntimeError where the message does not hold what its stream promises."""
    kind = profile.stream_type()
    if kind is stream.depth:
        data = np.asarray(message.getFrame())
        sound = data.dtype == np.uint16 and data.ndim == 2
    else:
        data = np.asarray(message.getCvFrame())
        sound = data.dtype == np.uint8 and data.ndim == (3 if kind is stream.color else 2)
    if not sound:
        raise RuntimeError(f"The device sent {data.dtype} of shape {data.shape} for {kind.name}")
    if profile.format() is format.rgb8:
        data = np.ascontiguousarray(data[..., ::-1])
    size = (int(data.shape[1]), int(data.shape[0]))
    stated = stated_intrinsics(message, size) if profile.rectified else None
    return frame(
        data,
        profile if stated is None else profile.seen_through(stated),
        int(message.getSequenceNum()),
        message.getTimestampDevice().total_seconds() * 1000.0,
    )
