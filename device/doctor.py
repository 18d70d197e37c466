"""``borescout doctor``: what is installed and plugged in, what is missing, and how to get it."""

from __future__ import annotations

import importlib
import platform
import shutil
import socket
import sys
from collections.abc import Callable
from dataclasses import asdict, dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, Literal

import click

from device.anomaly.rig import make_stereo
from device.config import Settings, StereoSettings, load_settings
from device.daemon import program_version
from device.errors import DeviceError
from device.json_text import dumps
from drivers.grabber.v4l2 import device_path

_REQUIRED = ("numpy", "scipy", "opencv-python-headless", "flask", "waitress", "pydantic", "click", "mcap")
_CAMERAS = {"pyrealsense2": ("RealSense cameras", "realsense"), "depthai": ("OAK cameras", "oak")}
_MARK = {"ok": "ok", "note": "--", "fault": "!!"}


@dataclass(frozen=True)
class Finding:
    """One thing looked at. A "fault" keeps the box from working, a "note" may be as it should; ``remedy`` may be empty."""

    what: str
    state: Literal["ok", "note", "fault"]
    found: str
    remedy: str = ""


@click.command()
@click.option("--config", type=click.Path(path_type=Path), help="Settings file (TOML).")
@click.option("--data-dir", type=click.Path(path_type=Path, file_okay=False), help="Where findings are kept.")
@click.option("--host", help="Address the page is served at.")
@click.option("--port", type=int, help="Port the page is served at.")
@click.option("--json", "as_json", is_flag=True, help="One JSON object.")
def doctor(config: Path | None, data_dir: Path | None, host: str | None, port: int | None, as_json: bool) -> int:
    """Look at everything the box needs; exit status 1 where something is wrong."""
    settings = load_settings(config, data_dir=data_dir, host=host, port=port)
    findings = examine(settings)
    healthy = all(finding.state != "fault" for finding in findings)
    if as_json:
        click.echo(dumps({"healthy": healthy, "findings": [asdict(finding) for finding in findings]}))
    else:
        for finding in findings:
            click.echo(f"{_MARK[finding.state]}  {finding.what:<24} {finding.found}")
            if finding.remedy:
                click.echo(f"{'':<28} -> {finding.remedy}")
        click.echo("The box is fit to measure." if healthy else "The box is not fit to measure.")
    return 0 if healthy else 1


def examine(settings: Settings) -> list[Finding]:
    """Everything there is to say, software first."""
    findings = [
        Finding("borescout", "ok", program_version()),
        Finding("python", "ok", f"{platform.python_version()} on {platform.machine()}"),
    ]
    findings += [_package(name) for name in _REQUIRED]
    findings += [_camera(name, *about) for name, about in _CAMERAS.items()]
    findings += _stereo(settings.stereo)
    findings += [_data_dir(settings.data_dir), _free_space(settings), _port(settings.host, settings.port)]
    return findings


def _package(name: str) -> Finding:
    try:
        return Finding(name, "ok", version(name))
    except PackageNotFoundError:
        return Finding(name, "fault", "not installed", f"{sys.executable} -m pip install {name}")


def _camera(package: str, what: str, extra: str) -> Finding:
    """Whether the maker's package is there and sees a camera. A box needs one kind only, so neither is a fault."""
    try:
        installed = version(package)
    except PackageNotFoundError:
        remedy = f"for {what}: {sys.executable} -m pip install 'borescout[{extra}]'"
        return Finding(package, "note", "not installed", remedy)
    try:
        seen = _SEEN[package](importlib.import_module(package))
    except Exception as error:  # noqa: BLE001 - whatever a maker's native library throws is the finding itself
        return Finding(
            package, "fault", f"{installed}, does not work: {error}", "reinstall it, or see its troubleshooting page"
        )
    if not seen:
        return Finding(package, "note", f"{installed}, no camera seen", f"plug one of the {what} in, into a blue USB port")
    return Finding(package, "ok", f"{installed}, sees {', '.join(seen)}")


def _realsense_cameras(module: Any) -> list[str]:
    return [str(device.get_info(module.camera_info.name)) for device in module.context().query_devices()]


def _oak_cameras(module: Any) -> list[str]:
    return [str(info.name or info.getDeviceId()) for info in module.Device.getAllAvailableDevices()]


_SEEN: dict[str, Callable[[Any], list[str]]] = {"pyrealsense2": _realsense_cameras, "depthai": _oak_cameras}


def _stereo(settings: StereoSettings) -> list[Finding]:
    """The stereo camera that the settings name; those of RealSense and OAK are seen above."""
    if settings.driver == "none":
        return []
    what = "stereo camera"
    try:
        eye = make_stereo(settings, 0, lambda: None)
    except DeviceError as error:
        return [Finding(what, "fault", str(error), "mend the table [stereo] of the settings, or its calibration")]
    gone = [
        device
        for device in (settings.left, settings.right)
        if settings.driver == "pair" and not Path(device_path(device)).exists()
    ]
    if gone:
        return [Finding(what, "fault", f"{' and '.join(gone)} not there", "plug both cameras in, always into the same ports")]
    if settings.driver == "pair" and eye is not None and eye.source.lenses is None:
        return [Finding(what, "fault", "two cameras that are not calibrated", "calibrate them on the page, /anomaly/calibrate")]
    calibrated = "calibrated" if eye is not None and eye.source.calibration is not None else "as its maker calibrated it"
    return [Finding(what, "ok", f"{settings.driver}, {calibrated}")]


def _data_dir(folder: Path) -> Finding:
    probe = folder / ".doctor"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        probe.write_text("probe")
        probe.unlink()
    except OSError as error:
        return Finding("data folder", "fault", f"{folder}: {error.strerror}", "choose another --data-dir, or mend its rights")
    return Finding("data folder", "ok", str(folder))


def _free_space(settings: Settings) -> Finding:
    folder = settings.data_dir
    while not folder.exists() and folder != folder.parent:
        folder = folder.parent
    free_mb = shutil.disk_usage(folder).free // 1_000_000
    if free_mb < settings.reserve_mb:
        return Finding("free disk space", "fault", f"{free_mb} MB", f"make room: at least {settings.reserve_mb} MB are needed")
    return Finding("free disk space", "ok", f"{free_mb} MB")


def _port(host: str, port: int) -> Finding:
    """Whether the page could be served. A port in use is a note: most often it is the daemon that runs already."""
    try:
        family, kind, protocol, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        with socket.socket(family, kind, protocol) as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind(address)
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        return Finding("page", "note", f"{host}:{port}: {reason}", "choose another --port, unless borescout is running already")
    return Finding("page", "ok", f"{host}:{port} is free")
