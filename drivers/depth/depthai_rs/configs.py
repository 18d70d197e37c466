"""What is asked of a device: pyrealsense2's ``config``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from drivers.depth.depthai_rs.names import format, stream


@dataclass(frozen=True)
class StreamRequest:
    """One stream that is asked for. Index 0 means any, a size or a rate of 0 means the default."""

    kind: stream
    index: int = 0
    width: int = 0
    height: int = 0
    pixels: format = format.any
    fps: int = 0


class config:
    """The streams to start and the device to start them on."""

    def __init__(self) -> None:
        self.requests: dict[tuple[stream, int], StreamRequest] = {}
        self.serial: str | None = None

    def enable_device(self, serial: str) -> None:
        self.serial = serial

    def enable_stream(self, stream_type: stream, *arguments: Any) -> None:
        """As pyrealsense2: ([index,] [width, height,] [format [, framerate]])."""
        request = _request(stream_type, arguments)
        self.requests[request.kind, request.index] = request

    def disable_stream(self, stream_type: stream, index: int = 0) -> None:
        self.requests = {key: kept for key, kept in self.requests.items() if key != (stream_type, index)}

    def disable_all_streams(self) -> None:
        self.requests = {}

    def enable_device_from_file(self, file_name: str, repeat_playback: bool = True) -> None:
        raise RuntimeError(f"Recordings such as {file_name} are played by pyrealsense2, not by an OAK camera")

    def resolve(self, wrapper: pipeline_wrapper) -> Any:
        return wrapper.pipeline.resolve(self)

    def can_resolve(self, wrapper: pipeline_wrapper) -> bool:
        try:
            self.resolve(wrapper)
        except RuntimeError:
            return False
        return True


class pipeline_wrapper:
    def __init__(self, pipeline: Any) -> None:
        self.pipeline = pipeline


def _request(kind: stream, arguments: tuple[Any, ...]) -> StreamRequest:
    at = next((index for index, value in enumerate(arguments) if isinstance(value, format)), len(arguments))
    before, after = arguments[:at], arguments[at:]
    if not all(isinstance(value, int) for value in before) or len(before) > 3 or len(after) > 2:
        raise TypeError(f"enable_stream: incompatible arguments {arguments}")
    index, width, height = {0: (0, 0, 0), 1: (*before, 0, 0), 2: (0, *before), 3: before}[len(before)]
    pixels = after[0] if after else format.any
    return StreamRequest(kind, index, width, height, pixels, after[1] if len(after) > 1 else 0)
