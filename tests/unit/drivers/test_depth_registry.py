"""The table of kinds of depth camera."""

from __future__ import annotations

import importlib
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from drivers.base import SensorMissing
from drivers.depth.base import DepthSettings
from drivers.depth.librealsense import LibrealsenseCamera
from drivers.depth.replay import ReplayCamera
from drivers.registry import DEPTH_CAMERAS, open_depth_cameras


@pytest.mark.parametrize("kind", DEPTH_CAMERAS)
def test_every_kind_names_an_opener_that_is_there(kind: str) -> None:
    module, function = DEPTH_CAMERAS[kind].split(":")
    assert callable(getattr(importlib.import_module(module), function))


def test_an_unknown_kind_is_told_which_there_are() -> None:
    with pytest.raises(SensorMissing, match="realsense, oak, replay, virtual"):
        open_depth_cameras("kinect")


def test_replay_plays_its_source(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "depth.png"), np.full((4, 6), 500, np.uint16))
    lens = {"width": 6, "height": 4, "fx": 5, "fy": 5, "ppx": 3, "ppy": 2, "model": "none", "coeffs": []}
    entry = {"depth": "depth.png", "recording": "one", "depth_unit_m": 0.001, "intrinsics": lens}
    (tmp_path / "manifest.json").write_text(json.dumps([entry]))
    (camera,) = open_depth_cameras("replay", source=tmp_path, loop=True)
    assert isinstance(camera, ReplayCamera)
    camera.open()
    assert camera.read().depth.max() == 500


@pytest.mark.parametrize(("kind", "package", "extra"), [("realsense", "pyrealsense2", "realsense"), ("oak", "depthai", "oak")])
def test_a_package_that_is_not_installed_is_named_with_its_remedy(
    kind: str, package: str, extra: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(SensorMissing, match=rf"{package} is not installed.*borescout\[{extra}\]"):
        open_depth_cameras(kind)


@pytest.mark.parametrize(("kind", "package"), [("realsense", "pyrealsense2"), ("oak", "depthai")])
def test_real_cameras_are_made_without_being_opened(kind: str, package: str) -> None:
    pytest.importorskip(package, reason=f"{package} is not installed")
    (camera,) = open_depth_cameras(kind, DepthSettings(640, 480))
    assert isinstance(camera, LibrealsenseCamera)


def test_depthai_writes_nothing_where_results_are_printed() -> None:
    pytest.importorskip("depthai", reason="depthai is not installed")
    code = "from drivers.library import library; library('depthai').Device.getAllAvailableDevices()"
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60)
    assert found.stdout == ""


def test_the_makers_packages_are_not_imported_before_they_are_asked_for() -> None:
    code = "import sys, drivers.registry, drivers.depth.openers, drivers.depth.depthai_rs, drivers.depth.replay\n"
    code += "print([name for name in ('pyrealsense2', 'depthai') if name in sys.modules])"
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60)
    assert found.stdout.strip() == "[]"


@pytest.mark.parametrize(
    "wrong", [{"width": 0}, {"fps": 0}, {"exposure_us": 0}, {"laser_power": 1.5}, {"laser_power": float("nan")}]
)
def test_impossible_settings_are_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=r"camera|exposure|laser"):
        DepthSettings(**wrong)
