"""The cameras of this box, each with the feed that keeps it alive."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from device.config import Settings
from device.errors import Invalid
from device.feeds.feed import CameraFeed
from drivers.base import DriverError, FrameTimeout
from drivers.depth.base import DepthCamera, DepthFrame
from drivers.registry import open_depth_cameras


class HeldReplay(DepthCamera):
    """A folder of pictures as an operator can use it: each stays for ``hold_s`` seconds, sent ``rate_hz`` times a second."""

    def __init__(self, recording: DepthCamera, hold_s: float, rate_hz: float) -> None:
        self.name = recording.name
        self._recording = recording
        self._hold_s = hold_s
        self._period_s = 1.0 / rate_hz
        self._held: DepthFrame | None = None
        self._held_until = 0.0
        self._due = 0.0
        self._number = 0

    def _open(self) -> None:
        self._recording.open()
        self._held = None

    def _read(self, timeout_s: float) -> DepthFrame:
        now = time.monotonic()
        wait_s = max(0.0, self._due - now)
        if wait_s > timeout_s:
            time.sleep(timeout_s)
            raise FrameTimeout(f"The {self.name} sent no picture for {timeout_s:.3g} s.")
        time.sleep(wait_s)
        self._due = max(self._due + self._period_s, time.monotonic())
        if self._held is None or time.monotonic() >= self._held_until:
            self._held = self._recording.read(timeout_s)
            self._held_until = time.monotonic() + self._hold_s
        self._number += 1
        return replace(self._held, number=self._number, monotonic_ns=time.monotonic_ns())

    def close(self) -> None:
        """Stop. Never raises, may be called twice."""
        self._recording.close()


def feeds(settings: Settings, on_change: Callable[[], None]) -> list[CameraFeed]:
    """A feed for every camera of the settings, not started yet. Raises Invalid where the settings name what cannot be."""
    found: list[CameraFeed] = []
    for kind in settings.cameras:
        arguments = _arguments(kind, settings)
        names = ("virtual stereo", "virtual time of flight")[: settings.virtual_cameras] if kind == "virtual" else (kind,)
        for index, name in enumerate(names):
            make = partial(_make, kind, index, arguments, settings)
            found.append(CameraFeed(name, kind, make, recorded=kind == "replay", on_change=on_change))
    return found


def _arguments(kind: str, settings: Settings) -> dict[str, Any]:
    """What the cameras of ``kind`` are made with. A slip of the operator's is told now, before anything is started."""
    arguments: dict[str, Any] = {}
    if kind == "replay":
        if settings.replay is None:
            raise Invalid("Say which recording to replay.")
        _check_recording(settings.replay)
        rate_hz = None if settings.replay.is_dir() else settings.replay_hz  # of a folder HeldReplay sets the pace
        return {"source": settings.replay, "rate_hz": rate_hz, "loop": True}
    if kind == "virtual":
        arguments = {
            "seed": settings.virtual_seed,
            "cameras": settings.virtual_cameras,
            "description": settings.virtual_description,
        }
    try:
        open_depth_cameras(kind, **arguments)  # made, not opened: its package is there, its description can be read
    except DriverError as error:
        raise Invalid(str(error)) from None
    return arguments


def _check_recording(source: Path) -> None:
    from drivers.depth.replay import ReplayCamera

    camera = ReplayCamera(source)
    try:
        camera.open()
    except DriverError as error:
        raise Invalid(str(error)) from None
    finally:
        camera.close()


def _make(kind: str, index: int, arguments: dict[str, Any], settings: Settings) -> DepthCamera:
    camera = open_depth_cameras(kind, **arguments)[index]
    if kind == "replay" and settings.replay is not None and settings.replay.is_dir():
        return HeldReplay(camera, settings.replay_hold_s, settings.replay_hz)
    return camera
