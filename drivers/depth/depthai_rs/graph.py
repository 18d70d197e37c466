"""From the streams that are asked for to a DepthAI pipeline: first a plan, then the nodes."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from drivers.depth.depthai_rs.configs import StreamRequest
from drivers.depth.depthai_rs.names import format, stream

DEFAULT_SIZE = (640, 480)
DEFAULT_FPS = 30
TOF_SIZE = (640, 480)
"""Of the 33D sensor, whatever its raw picture is."""
UNRESOLVED = "Couldn't resolve requests"


@dataclass(frozen=True)
class PlannedStream:
    """One stream that will run. ``socket`` is the camera whose view it shows."""

    kind: stream
    index: int
    socket: Any
    size: tuple[int, int]
    pixels: format
    fps: int
    rectified: bool


@dataclass(frozen=True)
class Plan:
    """All streams of one start. ``tof`` is the socket of a time-of-flight sensor, ``left`` and ``right`` the stereo pair."""

    streams: tuple[PlannedStream, ...]
    tof: Any | None
    left: Any | None
    right: Any | None

    @property
    def stereo_depth(self) -> bool:
        return self.tof is None and any(planned.kind is stream.depth for planned in self.streams)

    @property
    def pair(self) -> bool:
        """Both infrared pictures and no depth: they come rectified, and always two of one moment."""
        depth = any(planned.kind is stream.depth for planned in self.streams)
        return not depth and {planned.index for planned in self.streams if planned.kind is stream.infrared} == {1, 2}

    @property
    def rectifies(self) -> bool:
        """Whether a StereoDepth node is in it, which turns the pair's pictures."""
        return self.stereo_depth or self.pair


def plan_streams(dai: Any, features: Iterable[Any], pairs: Iterable[Any], requests: Iterable[StreamRequest]) -> Plan:
    """Where each stream comes from.

    ``features`` are the device's dai.CameraFeatures, ``pairs`` its dai.StereoPairs. Raises RuntimeError, in
    pyrealsense2's words, for what this device cannot do.
    """
    sockets = {feature.socket: feature for feature in features}
    tof = next((socket for socket, found in sockets.items() if dai.CameraSensorType.TOF in found.supportedTypes), None)
    pair = next((pair for pair in pairs if not pair.isVertical), None)
    left, right = (pair.left, pair.right) if pair is not None else (None, None)
    planned = []
    for request in requests:
        size = (request.width or DEFAULT_SIZE[0], request.height or DEFAULT_SIZE[1])
        fps = request.fps or DEFAULT_FPS
        if request.kind is stream.depth:
            _refuse_unless(request.pixels in (format.any, format.z16))
            if tof is not None:
                _refuse_unless(size == TOF_SIZE)
            else:
                # the matcher takes widths in steps of 16 pixels and never more than the sensor has
                _refuse_unless(right is not None and size[0] % 16 == 0)
                _refuse_larger(sockets, right, size)
            planned.append(PlannedStream(stream.depth, 0, tof if tof is not None else right, size, format.z16, fps, True))
        elif request.kind is stream.infrared:
            _refuse_unless(request.pixels in (format.any, format.y8) and left is not None)
            index = request.index or 1
            _refuse_unless(index in (1, 2))
            socket = left if index == 1 else right
            _refuse_larger(sockets, socket, size)
            planned.append(PlannedStream(stream.infrared, index, socket, size, format.y8, fps, False))
        else:
            _refuse_unless(request.pixels in (format.any, format.bgr8, format.rgb8))
            socket = _color_socket(dai, sockets)
            _refuse_larger(sockets, socket, size)
            pixels = format.bgr8 if request.pixels is format.any else request.pixels
            planned.append(PlannedStream(stream.color, 0, socket, size, pixels, fps, False))
    _refuse_unless(bool(planned))
    plan = Plan(tuple(planned), tof, left, right)
    return _with_rectified_infrared(plan) if plan.rectifies else plan


def _with_rectified_infrared(plan: Plan) -> Plan:
    """Beside stereo depth, and as a pair, infrared is what the matcher sees: rectified, and so of one size and rate."""
    first = _matched(plan)
    _refuse_unless(first.size[0] % 16 == 0)
    streams = []
    for planned in plan.streams:
        if planned.kind is stream.infrared:
            _refuse_unless(planned.size == first.size and planned.fps == first.fps)
            planned = PlannedStream(planned.kind, planned.index, planned.socket, first.size, planned.pixels, first.fps, True)
        streams.append(planned)
    return Plan(tuple(streams), plan.tof, plan.left, plan.right)


def _matched(plan: Plan) -> PlannedStream:
    """The stream that says of which size and rate the pair is that a plan with a StereoDepth node is made from."""
    kind = stream.depth if plan.stereo_depth else stream.infrared
    return next(planned for planned in plan.streams if planned.kind is kind)


def _color_socket(dai: Any, sockets: dict[Any, Any]) -> Any:
    colored = [socket for socket, found in sockets.items() if dai.CameraSensorType.COLOR in found.supportedTypes]
    _refuse_unless(bool(colored))
    return dai.CameraBoardSocket.CAM_A if dai.CameraBoardSocket.CAM_A in colored else colored[0]


def _refuse_larger(sockets: dict[Any, Any], socket: Any, size: tuple[int, int]) -> None:
    _refuse_unless(socket in sockets and size[0] <= sockets[socket].width and size[1] <= sockets[socket].height)


def _refuse_unless(possible: bool) -> None:
    if not possible:
        raise RuntimeError(UNRESOLVED)


@dataclass(frozen=True)
class Graph:
    """The nodes of a plan, with the queue of each stream and the control queues of the cameras the depth is made from."""

    queues: dict[tuple[stream, int], Any]
    controls: tuple[Any, ...]


def build_graph(dai: Any, pipeline: Any, plan: Plan) -> Graph:
    """The nodes of ``plan`` in a dai.Pipeline that has a device and is not started yet."""
    cameras: dict[Any, Any] = {}
    queues: dict[tuple[stream, int], Any] = {}

    def camera(socket: Any) -> Any:
        if socket not in cameras:
            cameras[socket] = pipeline.create(dai.node.Camera).build(socket)
        return cameras[socket]

    def picture(planned: PlannedStream, socket: Any) -> Any:
        gray = planned.kind is not stream.color
        kind = dai.ImgFrame.Type.GRAY8 if gray else dai.ImgFrame.Type.NV12
        return camera(socket).requestOutput(planned.size, type=kind, resizeMode=dai.ImgResizeMode.CROP, fps=float(planned.fps))

    stereo = None
    controls: list[Any] = []
    if plan.rectifies:
        stereo = _stereo(dai, pipeline)
        for socket, taken in ((plan.left, stereo.left), (plan.right, stereo.right)):
            picture(_matched(plan), socket).link(taken)
            controls.append(camera(socket).inputControl.createInputQueue())
    for planned in plan.streams:
        if planned.kind is stream.depth:
            depth = _tof(dai, pipeline, plan.tof, planned.fps) if stereo is None else stereo
            queues[stream.depth, 0] = _queue(depth.depth)
        elif planned.kind is stream.color:
            queues[stream.color, 0] = _queue(picture(planned, planned.socket))
        elif planned.kind is stream.infrared:
            if stereo is None:
                queues[stream.infrared, planned.index] = _queue(picture(planned, planned.socket))
            else:
                queues[stream.infrared, planned.index] = _queue(
                    stereo.rectifiedLeft if planned.index == 1 else stereo.rectifiedRight
                )
    return Graph(queues, tuple(controls))


def _queue(output: Any) -> Any:
    """Newest wins: a slow reader gets the latest pictures, and its gap shows in the frame numbers."""
    return output.createOutputQueue(maxSize=2, blocking=False)


def _stereo(dai: Any, pipeline: Any) -> Any:
    """Matching for pipes: near walls, nothing smoothed, millimetres, in the view of the rectified right camera."""
    stereo = pipeline.create(dai.node.StereoDepth)
    stereo.setRectification(True)
    # rectified through the lens model and not by a homography alone, or the depth would keep the lens's distortion
    stereo.enableDistortionCorrection(True)
    stereo.setDepthAlign(dai.StereoDepthConfig.AlgorithmControl.DepthAlign.RECTIFIED_RIGHT)
    stereo.setLeftRightCheck(True)
    stereo.setExtendedDisparity(True)
    stereo.setSubpixel(True)
    stereo.initialConfig.setMedianFilter(dai.MedianFilter.MEDIAN_OFF)
    stereo.initialConfig.setDepthUnit(dai.DepthUnit.MILLIMETER)
    return stereo


def _tof(dai: Any, pipeline: Any, socket: Any, fps: int) -> Any:
    """Time of flight at short range, rectified on the device: on RVC2 by its ToFConfig, on RVC4 by the node's own switch."""
    tof = pipeline.create(dai.node.ToF)
    tof.build(socket, dai.ImageFiltersPresetMode.TOF_LOW_RANGE, float(fps))
    settings = tof.getInitialConfig()
    settings.enableDistortionCorrection = True
    settings.enableOpticalCorrection = True  # distance along the ray to depth along z, as stereo gives it
    tof.setInitialConfig(settings)
    tof.setOutputUndistortion(True)
    return tof
