"""An OAK device that is not there. What DepthAI can make without one is its own: messages, queues, calibration, controls.

Nodes of a pipeline need a device, so they are stood in for; every call on them is held against the real class and signature.
"""

from __future__ import annotations

import inspect
import itertools
import re
import threading
from datetime import timedelta
from typing import Any

import depthai as dai
import numpy as np

import drivers.depth.depthai_rs as oak
from drivers.depth.base import DepthSettings
from drivers.depth.librealsense import LibrealsenseCamera
from estimators.pinhole import Intrinsics
from tests.unit.drivers.depth_camera_contract import LiveRig

SOCKET = dai.CameraBoardSocket
RATIONAL = [5.2, 3.1, 0.0011, -0.0005, 0.41, 5.5, 4.3, 1.2]
"""k1, k2, p1, p2, k3, k4, k5, k6 as factories write them: large, and nearly cancelling."""
_serials = itertools.count()
TURN = 0.004
"""Radians by which rectification turns the right camera about y."""


def matrix(focal: float, ppx: float, ppy: float) -> list[list[float]]:
    return [[focal, 0.0, ppx], [0.0, focal + 1.0, ppy], [0.0, 0.0, 1.0]]


def calibration() -> dai.CalibrationHandler:
    """Of a device like an OAK-D: colour on A, a pair 75 mm apart on B and C, time of flight on D; through its EEPROM's JSON."""
    made = dai.CalibrationHandler()
    made.setBoardInfo("OAK-D", "R1")
    for socket, size, numbers in (
        (SOCKET.CAM_A, (1920, 1080), (1500.0, 960.0, 540.0)),
        (SOCKET.CAM_B, (1280, 800), (804.4, 645.8, 394.1)),
        (SOCKET.CAM_C, (1280, 800), (793.3, 649.4, 406.8)),
        (SOCKET.CAM_D, (640, 480), (470.0, 321.0, 243.0)),
    ):
        made.setCameraIntrinsics(socket, matrix(*numbers), *size)
        made.setDistortionCoefficients(socket, RATIONAL + [0.0] * 6)
        made.setCameraType(socket, dai.CameraModel.Perspective)
    straight = np.eye(3).tolist()
    made.setCameraExtrinsics(SOCKET.CAM_B, SOCKET.CAM_C, straight, [-7.5, 0.0, 0.0], [-7.5, 0.0, 0.0])
    made.setCameraExtrinsics(SOCKET.CAM_C, SOCKET.CAM_A, straight, [3.75, 0.0, 0.0], [3.75, 0.0, 0.0])
    made.setCameraExtrinsics(SOCKET.CAM_D, SOCKET.CAM_A, straight, [1.0, 0.0, 0.0], [1.0, 0.0, 0.0])
    turned = [[np.cos(TURN), 0.0, np.sin(TURN)], [0.0, 1.0, 0.0], [-np.sin(TURN), 0.0, np.cos(TURN)]]
    made.setStereoLeft(SOCKET.CAM_B, straight)
    made.setStereoRight(SOCKET.CAM_C, np.array(turned).tolist())
    return dai.CalibrationHandler.fromJson(made.eepromToJson())


def feature(socket: Any, width: int, height: int, *kinds: Any) -> dai.CameraFeatures:
    made = dai.CameraFeatures()
    made.socket, made.width, made.height, made.supportedTypes = socket, width, height, list(kinds)
    return made


def stereo_features() -> list[dai.CameraFeatures]:
    """An OAK-D: colour in the middle, two mono cameras."""
    return [
        feature(SOCKET.CAM_A, 3840, 2160, dai.CameraSensorType.COLOR),
        feature(SOCKET.CAM_B, 1280, 800, dai.CameraSensorType.MONO),
        feature(SOCKET.CAM_C, 1280, 800, dai.CameraSensorType.MONO),
    ]


def tof_features() -> list[dai.CameraFeatures]:
    """An OAK-D with a time-of-flight sensor and a colour pair."""
    return [
        feature(SOCKET.CAM_B, 1280, 800, dai.CameraSensorType.COLOR),
        feature(SOCKET.CAM_C, 1280, 800, dai.CameraSensorType.COLOR),
        feature(SOCKET.CAM_D, 640, 480, dai.CameraSensorType.TOF),
    ]


def stereo_pair() -> dai.StereoPair:
    made = dai.StereoPair()
    made.left, made.right, made.baseline, made.isVertical = SOCKET.CAM_B, SOCKET.CAM_C, 7.5, False
    return made


def depth_message(data: Any, number: int, lens: Any | None = None) -> dai.ImgFrame:
    made = dai.ImgFrame()
    made.setType(dai.ImgFrame.Type.RAW16)
    made.setWidth(data.shape[1])
    made.setHeight(data.shape[0])
    made.setData(np.ascontiguousarray(data).view(np.uint8).ravel())
    made.setSequenceNum(number)
    made.setTimestampDevice(timedelta(milliseconds=1000 + 33 * number))
    if lens is not None:
        made.setTransformation(dai.ImgTransformation(data.shape[1], data.shape[0], lens))
    return made


def color_message(data: Any, number: int, kind: Any = dai.ImgFrame.Type.NV12) -> dai.ImgFrame:
    made = dai.ImgFrame()
    made.setCvFrame(data, kind)
    made.setSequenceNum(number)
    return made


def gray_message(data: Any, number: int) -> dai.ImgFrame:
    return color_message(data, number, dai.ImgFrame.Type.GRAY8)


def held_against(real: type, name: str, arguments: tuple[Any, ...], keywords: dict[str, Any]) -> None:
    """Fail where the real class has no such method or none of its signatures takes these arguments."""
    text = inspect.getdoc(getattr(real, name)) or ""
    signatures = re.findall(rf"{name}\(self: [^,)]*(.*)\) -> ", text)
    for signature in signatures:
        parameters = re.findall(r"(?:^|, )(\w+): [^=]*?( = |(?=, \w+: )|$)", signature)
        names = [found[0] for found in parameters]
        needed = {found[0] for found in parameters if found[1] != " = "}
        given = set(names[: len(arguments)]) | set(keywords)
        if len(arguments) <= len(names) and set(keywords) <= set(names) and needed <= given:
            return
    raise AssertionError(f"{real.__name__}.{name} takes no {arguments} {keywords}: {signatures}")


class FakePort:
    """An input or output of a node."""

    def __init__(self, owner: FakeNode, name: str) -> None:
        self.owner, self.name = owner, name

    def link(self, target: FakePort) -> None:
        self.owner.pipeline.links.append((self, target))

    def createOutputQueue(self, maxSize: int = 16, blocking: bool = False) -> dai.MessageQueue:
        queue = dai.MessageQueue(self.name, maxSize, blocking)
        self.owner.pipeline.queues[str(self.owner), self.name] = queue
        return queue

    def createInputQueue(self) -> Any:
        pipeline = self.owner.pipeline

        class Queue:
            def send(self, message: Any) -> None:
                pipeline.sent.append(message)

        return Queue()


class FakeNode:
    """A node of the real class ``real``: its calls are checked and written down, its ports can be linked."""

    def __init__(self, real: type, pipeline: FakePipeline) -> None:
        self.real, self.pipeline = real, pipeline
        self.calls: dict[str, tuple[tuple[Any, ...], dict[str, Any]]] = {}
        self.outputs: list[tuple[Any, ...]] = []
        self.config = dai.ToFConfig()
        if real is dai.node.StereoDepth:
            self.initialConfig = dai.StereoDepthConfig()

    def __str__(self) -> str:
        socket = self.calls.get("build", ((SOCKET.AUTO,), {}))[0][0]
        return f"{self.real.__name__} {socket.name}"

    def __getattr__(self, name: str) -> Any:
        found = getattr(self.real, name)
        if isinstance(found, property):
            return FakePort(self, name)

        def call(*arguments: Any, **keywords: Any) -> Any:
            held_against(self.real, name, arguments, keywords)
            self.calls[name] = (arguments, keywords)
            if name == "requestOutput":
                self.outputs.append((*arguments, keywords))
                return FakePort(self, f"output {len(self.outputs)}")
            if name == "getInitialConfig":
                return self.config
            return self

        return call


class FakePipeline:
    def __init__(self, device: FakeDevice) -> None:
        self.device = device
        self.nodes: list[FakeNode] = []
        self.links: list[tuple[FakePort, FakePort]] = []
        self.queues: dict[tuple[str, str], dai.MessageQueue] = {}
        self.sent: list[Any] = []
        self.running = False
        device.pipeline = self

    def create(self, real: type) -> FakeNode:
        self.nodes.append(FakeNode(real, self))
        return self.nodes[-1]

    def start(self) -> None:
        self.device.bus.refuse_if("start")
        self.running = True

    def stop(self) -> None:
        self.running = False

    def isRunning(self) -> bool:
        return self.running

    def node(self, real: type) -> FakeNode:
        return next(node for node in self.nodes if node.real is real)


class FakeDevice:
    """A booted device. ``bus`` holds what it is like."""

    bus: FakeDai
    pipeline: FakePipeline | None = None

    def __init__(self, info: Any) -> None:
        self.bus.refuse_if("open")
        if not self.bus.plugged or self.bus.device is not None:
            raise RuntimeError("Cannot find any device with given deviceInfo")
        self.closed = False
        self.intensity = -1.0
        self.attempts = -1
        self.bus.device = self
        self.bus.boots += 1

    def setMaxReconnectionAttempts(self, attempts: int) -> None:
        self.attempts = attempts

    def getConnectedCameraFeatures(self) -> list[Any]:
        return self.bus.features

    def getStereoPairs(self) -> list[Any]:
        return [stereo_pair()]

    def readCalibration(self) -> dai.CalibrationHandler:
        return calibration()

    def getIrDrivers(self) -> list[tuple[str, int, int]]:
        return [("LM3644", 2, 0x63)] if self.bus.projector else []

    def setIrLaserDotProjectorIntensity(self, intensity: float) -> bool:
        self.intensity = intensity
        return True

    def getProductName(self) -> str:
        return "OAK-D-PRO"

    def getDeviceName(self) -> str:
        return ""

    def getUsbSpeed(self) -> Any:
        return dai.UsbSpeed.SUPER

    def isClosed(self) -> bool:
        return self.closed

    def close(self) -> None:
        self.closed = True
        self.bus.device = None
        if self.pipeline is not None:
            self.pipeline.running = False
            for queue in self.pipeline.queues.values():
                queue.close()


class FakeDai:
    """The depthai package with one device on its bus."""

    def __init__(self, features: list[Any] | None = None, projector: bool = True) -> None:
        self.features = stereo_features() if features is None else features
        self.projector = projector
        self.plugged = True
        self.device: FakeDevice | None = None
        self.boots = 0
        self.serial = f"18443010{next(_serials):04X}"
        self.faults: dict[str, Exception] = {}
        bus = self

        class Device(FakeDevice):
            @staticmethod
            def getAllAvailableDevices() -> list[Any]:
                # as the real one: a device that is open is not available
                return [bus.info()] if bus.plugged and bus.device is None else []

        Device.bus = self
        self.Device = Device
        self.Pipeline = FakePipeline

    def __getattr__(self, name: str) -> Any:
        return getattr(dai, name)

    def info(self) -> dai.DeviceInfo:
        usb = (dai.X_LINK_UNBOOTED, dai.X_LINK_USB_VSC, dai.X_LINK_MYRIAD_X, dai.X_LINK_SUCCESS)
        return dai.DeviceInfo("1.1", self.serial, *usb)

    def refuse_if(self, at: str) -> None:
        if at in self.faults:
            raise self.faults[at]

    def surface(self) -> Any:
        """``drivers.depth.depthai_rs`` on this bus."""
        return FakeSurface(self)


class FakeSurface:
    def __init__(self, bus: FakeDai) -> None:
        self.bus = bus

    def __getattr__(self, name: str) -> Any:
        return getattr(oak, name)

    def context(self) -> Any:
        return oak.context(self.bus)

    def pipeline(self) -> Any:
        return oak.pipeline(oak.context(self.bus))


class OakRig(LiveRig):
    """The driver over depthai_rs over a device that sends 60 frames a second."""

    def __init__(
        self, settings: DepthSettings, intrinsics: Intrinsics, features: list[Any] | None = None, lens: Any | None = None
    ) -> None:
        self.bus = FakeDai(features)
        self.camera = LibrealsenseCamera(self.bus.surface(), settings)
        self.intrinsics = intrinsics
        self._lens = lens
        self._sending = threading.Event()
        self._sending.set()
        self._over = threading.Event()
        self._feeder = threading.Thread(target=self._feed, daemon=True)
        self._feeder.start()

    def _feed(self) -> None:
        number = 0
        depth = np.empty((self.intrinsics.height, self.intrinsics.width), np.uint16)
        blue = np.zeros((self.intrinsics.height, self.intrinsics.width, 3), np.uint8)
        blue[..., 0] = 255
        while not self._over.wait(1 / 60):
            pipeline = None if self.bus.device is None else self.bus.device.pipeline
            if pipeline is None or not pipeline.running or not self._sending.is_set():
                continue
            number += 1
            depth[...] = number
            for (_, port), queue in list(pipeline.queues.items()):
                message = depth_message(depth, number, self._lens) if port == "depth" else color_message(blue, number)
                try:
                    queue.send(message)
                except dai.MessageQueue.QueueException:
                    break  # closed by the test under way

    def fall_silent(self) -> None:
        self._sending.clear()

    def unplug(self) -> None:
        self.bus.plugged = False
        if self.bus.device is not None:
            self.bus.device.close()

    def plug_in(self) -> None:
        self.bus.plugged = True

    def close(self) -> None:
        self.camera.close()
        self._over.set()
        self._feeder.join(5.0)
