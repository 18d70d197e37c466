"""What a pipeline that runs is made of, named as in pyrealsense2."""

from __future__ import annotations

from typing import Generic, TypeVar

from drivers.depth.depthai_rs.frames import stream_profile
from drivers.depth.depthai_rs.names import stream

Owner = TypeVar("Owner")


class pipeline_profile(Generic[Owner]):
    """The device and the streams of a running pipeline."""

    def __init__(self, owner: Owner, streams: list[stream_profile]) -> None:
        self._owner, self._streams = owner, streams

    def get_device(self) -> Owner:
        return self._owner

    def get_streams(self) -> list[stream_profile]:
        return list(self._streams)

    def get_stream(self, kind: stream, index: int = -1) -> stream_profile:
        for found in self._streams:
            if found.stream_type() is kind and index in (-1, 0, found.stream_index()):
                return found
        raise RuntimeError("Profile does not contain the requested stream")
