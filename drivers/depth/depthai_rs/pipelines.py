"""pyrealsense2's ``pipeline`` over a dai.Pipeline."""

from __future__ import annotations

import time
from datetime import timedelta
from typing import Any

from drivers.depth.depthai_rs.configs import StreamRequest, config
from drivers.depth.depthai_rs.devices import context, device
from drivers.depth.depthai_rs.frames import composite_frame, frame, frame_of, stream_profile
from drivers.depth.depthai_rs.graph import Graph, Plan, PlannedStream, build_graph, plan_streams
from drivers.depth.depthai_rs.lens import beside, between, extrinsics, intrinsics, lens_intrinsics, rectified_intrinsics
from drivers.depth.depthai_rs.names import stream
from drivers.depth.depthai_rs.profile import pipeline_profile

_LEFT, _RIGHT = (stream.infrared, 1), (stream.infrared, 2)


class pipeline:
    """Streams of one OAK device."""

    def __init__(self, ctx: context | None = None) -> None:
        self._context = ctx
        self._running: _Running | None = None

    def start(self, wanted: config | None = None) -> pipeline_profile[device]:
        """Boot the device and start the streams. Raises RuntimeError: "No device connected", "Couldn't resolve requests"."""
        if self._running is not None:
            raise RuntimeError("start() cannot be called before stop()")
        if self._context is None:
            self._context = context()
        self._running = _Running(self._context, wanted or config())
        return self._running.profile

    def resolve(self, wanted: config) -> pipeline_profile[device]:
        """What ``start`` would run. The device is booted and closed again for it."""
        if self._running is not None:
            return self._running.profile
        profile = self.start(wanted)
        self.stop()
        return profile

    def get_active_profile(self) -> pipeline_profile[device]:
        return self._started().profile

    def wait_for_frames(self, timeout_ms: int = 5000) -> composite_frame:
        """The next depth picture with the latest of the other streams; without depth both infrared pictures of one moment, or
        the next of the first stream."""
        return self._started().wait(timeout_ms)

    def try_wait_for_frames(self, timeout_ms: int = 5000) -> tuple[bool, composite_frame]:
        found = self._started().next(timeout_ms)
        return found is not None, found or composite_frame([])

    def poll_for_frames(self) -> composite_frame:
        return self._started().next(0) or composite_frame([])

    def stop(self) -> None:
        self._started()
        running, self._running = self._running, None
        if running is not None:
            running.stop()

    def _started(self) -> _Running:
        if self._running is None:
            raise RuntimeError("The pipeline is not started")
        return self._running


class _Running:
    """A started pipeline: the device, the graph, the profile of each stream."""

    def __init__(self, bus: context, wanted: config) -> None:
        self._dai = bus.dai
        self._device = _pick(bus, wanted.serial)
        requests = list(wanted.requests.values()) or [StreamRequest(stream.depth)]
        seen = self._device.seen()
        if seen is not None:
            plan_streams(self._dai, *seen, requests)
        try:
            opened = self._device.open()
            plan = plan_streams(self._dai, opened.getConnectedCameraFeatures(), opened.getStereoPairs(), requests)
            calibration = opened.readCalibration()
            self._plan = plan
            self._pipeline = self._dai.Pipeline(opened)
            self._graph: Graph = build_graph(self._dai, self._pipeline, plan)
            self._pipeline.start()
            self._device.attach(self._graph.controls)
        except Exception as error:
            self._device.close()
            if isinstance(error, ValueError | IndexError):  # DepthAI's C++ speaks of faults of the device in these as well
                raise RuntimeError(str(error)) from error
            raise
        self._profiles = {(planned.kind, planned.index): _profile(calibration, plan, planned) for planned in plan.streams}
        first = _LEFT if plan.pair else next(iter(self._profiles))
        self._leader = next((key for key in self._profiles if key[0] is stream.depth), first)
        self._latest: dict[tuple[stream, int], frame] = {}
        self.profile = pipeline_profile(self._device, list(self._profiles.values()))

    def wait(self, timeout_ms: int) -> composite_frame:
        found = self.next(timeout_ms)
        if found is None:
            raise RuntimeError(f"Frame didn't arrive within {timeout_ms}")
        return found

    def next(self, timeout_ms: int) -> composite_frame | None:
        dai = self._dai
        deadline = time.monotonic() + timeout_ms / 1000.0
        try:
            message = self._graph.queues[self._leader].get(timedelta(milliseconds=timeout_ms))
            if self._plan.pair and message is not None:
                message = self._with_partner(message, deadline)
            for key, queue in self._graph.queues.items():
                if key != self._leader and not (self._plan.pair and key == _RIGHT):
                    waiting = queue.tryGetAll()
                    if waiting:
                        self._latest[key] = frame_of(waiting[-1], self._profiles[key])
        except dai.MessageQueue.QueueException as error:
            # DepthAI closes the queues when the device goes
            raise RuntimeError("Device disconnected") from error
        if message is None:
            if not self._device.is_connected() or not self._pipeline.isRunning():
                raise RuntimeError("Device disconnected")
            return None
        return composite_frame([frame_of(message, self._profiles[self._leader]), *self._latest.values()])

    def _with_partner(self, left: Any | None, deadline: float) -> Any | None:
        """The left picture from ``left`` on that has a right one of the same moment, which becomes the latest; None where the
        time is over before. Whichever of the two is older is passed over."""
        queues = self._graph.queues
        together = timedelta(seconds=0.5 / self._profiles[_LEFT].fps())
        right = queues[_RIGHT].get(_until(deadline))
        while left is not None and right is not None:
            lag = left.getTimestampDevice() - right.getTimestampDevice()
            if abs(lag) < together:
                self._latest[_RIGHT] = frame_of(right, self._profiles[_RIGHT])
                return left
            if lag > timedelta(0):
                right = queues[_RIGHT].get(_until(deadline))
            else:
                left = queues[_LEFT].get(_until(deadline))
        return None

    def stop(self) -> None:
        try:
            self._pipeline.stop()
        finally:
            self._device.close()


def _until(deadline: float) -> timedelta:
    return timedelta(seconds=max(0.0, deadline - time.monotonic()))


def _pick(bus: context, serial: str | None) -> device:
    for found in bus.query_devices():
        if serial is None or found.serial == serial:
            return found
    raise RuntimeError("No device connected")


def _profile(calibration: Any, plan: Plan, planned: PlannedStream) -> stream_profile:
    def lens() -> intrinsics:
        return calibrated_intrinsics(calibration, plan, planned)

    def to(other: stream_profile) -> extrinsics:
        target = next(item for item in plan.streams if (item.kind, item.index) == (other.stream_type(), other.stream_index()))
        if target.rectified and target.socket != planned.socket:
            if not planned.rectified or {planned.socket, target.socket} != {plan.left, plan.right}:
                raise RuntimeError("Requested extrinsics are not available!")
            return beside(calibration, plan.left, plan.right, to_left=target.socket == plan.left)
        return between(calibration, planned.socket, target.socket, rectification_of(calibration, plan, planned))

    return stream_profile(planned.kind, planned.index, planned.pixels, planned.size, planned.fps, lens, planned.rectified, to)


def calibrated_intrinsics(calibration: Any, plan: Plan, planned: PlannedStream) -> intrinsics:
    """Intrinsics from the factory calibration, for a picture cut and scaled to the planned size.

    The rectified pair shares the right camera's pin-hole and has no distortion; a time-of-flight depth is undistorted on the
    device; other pictures keep the distortion of their own lens.
    """
    socket = plan.right if plan.rectifies and planned.rectified else planned.socket
    matrix = calibration.getCameraIntrinsics(socket, planned.size[0], planned.size[1], keepAspectRatio=True)
    if planned.rectified:
        return rectified_intrinsics(matrix, planned.size)
    model = calibration.getDistortionModel(socket).name
    return lens_intrinsics(matrix, planned.size, calibration.getDistortionCoefficients(socket), model)


def rectification_of(calibration: Any, plan: Plan, planned: PlannedStream) -> Any | None:
    """What StereoDepth turned a stream's picture by (3, 3), None where nothing did."""
    if not (plan.rectifies and planned.rectified):
        return None
    if planned.socket == plan.left:
        return calibration.getStereoLeftRectificationRotation()
    return calibration.getStereoRightRectificationRotation()
