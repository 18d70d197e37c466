"""The enumerations of pyrealsense2 that an OAK camera has an answer for."""

from __future__ import annotations

from enum import Enum


class stream(Enum):
    depth = "depth"
    color = "color"
    infrared = "infrared"
    """Index 1 is the left, 2 the right camera of the stereo pair."""


class format(Enum):
    any = "any"
    z16 = "z16"
    y8 = "y8"
    bgr8 = "bgr8"
    rgb8 = "rgb8"


class option(Enum):
    emitter_enabled = "emitter_enabled"
    """The infrared dot projector, 0 or 1."""
    laser_power = "laser_power"
    """Its intensity, 0 to 1."""
    enable_auto_exposure = "enable_auto_exposure"
    exposure = "exposure"
    """Of the cameras the depth is made from, in microseconds; setting it ends automatic exposure."""
    gain = "gain"
    """Their sensitivity as an ISO number."""


class camera_info(Enum):
    name = "name"
    serial_number = "serial_number"
    usb_type_descriptor = "usb_type_descriptor"
    product_line = "product_line"


class distortion(Enum):
    none = "none"
    brown_conrady = "brown_conrady"
    modified_brown_conrady = "modified_brown_conrady"
    inverse_brown_conrady = "inverse_brown_conrady"
    kannala_brandt4 = "kannala_brandt4"
    ftheta = "ftheta"
