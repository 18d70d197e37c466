"""Python packages that come with an extra: imported where they are used, so that a box needs only its own."""

from __future__ import annotations

import importlib
import os
from typing import Any

from drivers.base import SensorMissing

EXTRAS = {"pyrealsense2": "realsense", "depthai": "oak", "rapidocr": "osd", "onnxruntime": "osd"}


def library(name: str) -> Any:
    """The package ``name``, a key of EXTRAS. Raises SensorMissing with the command that installs it."""
    # DepthAI writes its log to standard output, where the command line prints its results
    os.environ.setdefault("DEPTHAI_LEVEL", "error")
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise SensorMissing(f"The package {name} is not installed: run pip install 'borescout[{EXTRAS[name]}]'.") from error
