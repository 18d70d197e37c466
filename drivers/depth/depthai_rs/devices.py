"""The devices on the bus, opened and not: pyrealsense2's ``context``, ``device`` and depth ``sensor``."""

from __future__ import annotations

import threading
import time
from dataclasses import dataclass
from typing import Any

from drivers.depth.depthai_rs.frames import DEPTH_UNIT_M
from drivers.depth.depthai_rs.names import camera_info, option
from drivers.library import library

REBOOT_SECONDS = 8.0
"""An OAK that has been closed boots anew and is off the bus meanwhile."""
DEFAULT_ISO = 400

_closed_at: dict[str, float] = {}
_closed_lock = threading.Lock()


_seen: dict[str, tuple[list[Any], list[Any]]] = {}
"""Cameras and stereo pairs of the devices that have been open, so that an impossible request need not boot them again."""


def remember_closed(serial: str) -> None:
    with _closed_lock:
        _closed_at[serial] = time.monotonic()


def _coming_back() -> float:
    """Seconds for which a device closed here may still be booting."""
    with _closed_lock:
        latest = max(_closed_at.values(), default=float("-inf"))
    return max(0.0, latest + REBOOT_SECONDS - time.monotonic())


class context:
    """The bus. ``dai`` is the depthai package, or what stands in for it in a test."""

    def __init__(self, dai: Any | None = None) -> None:
        self.dai = library("depthai") if dai is None else dai

    def query_devices(self) -> list[device]:
        """The OAK devices that could be opened now. Waits for one that was closed here a moment ago and is still booting."""
        until = time.monotonic() + _coming_back()
        while True:
            found = [device(self.dai, info) for info in self.dai.Device.getAllAvailableDevices()]
            if found or time.monotonic() >= until:
                return found
            time.sleep(0.1)

    @property
    def devices(self) -> list[device]:
        return self.query_devices()


@dataclass(frozen=True)
class option_range:
    min: float
    max: float
    step: float
    default: float


class sensor:
    """The depth sensor of an opened device: its unit and its options."""

    def __init__(self, dai: Any, opened: Any, controls: tuple[Any, ...]) -> None:
        self._dai, self._opened, self._controls = dai, opened, controls
        self._values: dict[option, float] = {option.enable_auto_exposure: 1.0, option.gain: float(DEFAULT_ISO)}
        self._values.update({option.emitter_enabled: 0.0, option.laser_power: 1.0, option.exposure: 8000.0})
        self._projector = bool(opened.getIrDrivers())

    def is_depth_sensor(self) -> bool:
        return True

    def get_depth_scale(self) -> float:
        return DEPTH_UNIT_M

    def supports(self, wanted: option) -> bool:
        if wanted in (option.emitter_enabled, option.laser_power):
            return self._projector
        return bool(self._controls)

    def get_option_range(self, wanted: option) -> option_range:
        self._refuse_unsupported(wanted)
        return {
            option.emitter_enabled: option_range(0.0, 1.0, 1.0, 0.0),
            option.laser_power: option_range(0.0, 1.0, 0.01, 1.0),
            option.enable_auto_exposure: option_range(0.0, 1.0, 1.0, 1.0),
            option.exposure: option_range(1.0, 33000.0, 1.0, 8000.0),
            option.gain: option_range(100.0, 1600.0, 1.0, float(DEFAULT_ISO)),
        }[wanted]

    def get_option(self, wanted: option) -> float:
        self._refuse_unsupported(wanted)
        return self._values[wanted]

    def set_option(self, wanted: option, value: float) -> None:
        """Raises RuntimeError for an option the device has not, a value beyond its range, and a device that does not obey."""
        allowed = self.get_option_range(wanted)
        if not allowed.min <= value <= allowed.max:
            raise RuntimeError(f"out of range value for argument {wanted.name}: {value}")
        values = {**self._values, wanted: float(value)}
        if wanted in (option.emitter_enabled, option.laser_power):
            intensity = values[option.laser_power] if values[option.emitter_enabled] else 0.0
            if not self._opened.setIrLaserDotProjectorIntensity(intensity):
                raise RuntimeError("The infrared dot projector does not obey")
        else:
            if wanted in (option.exposure, option.gain):
                values[option.enable_auto_exposure] = 0.0
            try:
                for queue in self._controls:
                    queue.send(exposure_control(self._dai, values))
            except self._dai.MessageQueue.QueueException as error:
                raise RuntimeError("Device disconnected") from error
        self._values = values

    def _refuse_unsupported(self, wanted: option) -> None:
        if not self.supports(wanted):
            raise RuntimeError(f"object doesn't support option {wanted.name}")


def exposure_control(dai: Any, values: dict[option, float]) -> Any:
    """The dai.CameraControl for a set of option values."""
    control = dai.CameraControl()
    if values[option.enable_auto_exposure]:
        control.setAutoExposureEnable()
    else:
        control.setManualExposure(round(values[option.exposure]), round(values[option.gain]))
    return control


class device:
    """One OAK. Found on the bus it only knows its serial number; ``open`` boots it."""

    def __init__(self, dai: Any, info: Any) -> None:
        self._dai, self._info = dai, info
        self._sensor: sensor | None = None
        self.opened: Any | None = None

    @property
    def serial(self) -> str:
        return str(self._info.getDeviceId())

    def seen(self) -> tuple[list[Any], list[Any]] | None:
        """The device's dai.CameraFeatures and dai.StereoPairs, None where it has never been open."""
        return _seen.get(self.serial)

    def open(self) -> Any:
        """Boot the device and return the dai.Device. Raises RuntimeError."""
        opened = self._dai.Device(self._info)
        # coming back is the ladder's business: DepthAI's own attempts would hold the device meanwhile
        opened.setMaxReconnectionAttempts(0)
        self.opened = opened
        _seen[self.serial] = (list(opened.getConnectedCameraFeatures()), list(opened.getStereoPairs()))
        return opened

    def attach(self, controls: tuple[Any, ...]) -> None:
        """The control queues of the running pipeline."""
        self._sensor = sensor(self._dai, self.opened, controls)

    def first_depth_sensor(self) -> sensor:
        if self._sensor is None:
            raise RuntimeError("Could not find requested sensor type!")
        return self._sensor

    def query_sensors(self) -> list[sensor]:
        return [] if self._sensor is None else [self._sensor]

    @property
    def sensors(self) -> list[sensor]:
        return self.query_sensors()

    def supports(self, what: camera_info) -> bool:
        return what in (camera_info.name, camera_info.serial_number) or self.opened is not None

    def get_info(self, what: camera_info) -> str:
        if what is camera_info.serial_number:
            return self.serial
        if what is camera_info.name:
            named = None if self.opened is None else self.opened.getProductName() or self.opened.getDeviceName()
            return str(named or "OAK")
        if self.opened is None:
            raise RuntimeError("The device is not open")
        if what is camera_info.product_line:
            features = self.opened.getConnectedCameraFeatures()
            return "OAK ToF" if any(self._dai.CameraSensorType.TOF in found.supportedTypes for found in features) else "OAK"
        return str(self.opened.getUsbSpeed().name)

    def is_connected(self) -> bool:
        return self.opened is not None and not self.opened.isClosed()

    def hardware_reset(self) -> None:
        """Close the device, which boots it anew."""
        self.close()

    def close(self) -> None:
        opened, self.opened = self.opened, None
        if opened is not None:
            opened.close()
            remember_closed(self.serial)
