"""Luxonis OAK cameras behind the pyrealsense2 surface, over DepthAI v3.

The names are pyrealsense2's, so that ``drivers.depth.librealsense`` drives an OAK as it drives a RealSense: ``pipeline``,
``config``, ``context``, ``stream``, ``format``, ``option``, ``camera_info``, ``distortion``, ``align``. A device with a
time-of-flight sensor gives its depth from there, every other from its stereo pair. RuntimeErrors carry pyrealsense2's words.
"""

from drivers.depth.depthai_rs.alignment import align
from drivers.depth.depthai_rs.configs import config, pipeline_wrapper
from drivers.depth.depthai_rs.devices import context, device, sensor
from drivers.depth.depthai_rs.frames import composite_frame, frame, stream_profile
from drivers.depth.depthai_rs.lens import extrinsics, intrinsics
from drivers.depth.depthai_rs.names import camera_info, distortion, format, option, stream
from drivers.depth.depthai_rs.pipelines import pipeline
from drivers.depth.depthai_rs.profile import pipeline_profile

__all__ = [
    "align",
    "camera_info",
    "composite_frame",
    "config",
    "context",
    "device",
    "distortion",
    "extrinsics",
    "format",
    "frame",
    "intrinsics",
    "option",
    "pipeline",
    "pipeline_profile",
    "pipeline_wrapper",
    "sensor",
    "stream",
    "stream_profile",
]
