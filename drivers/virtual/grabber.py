"""The twin of the CCTV grabber: pictures of a drive through the virtual sewer, live or as a recording."""

from __future__ import annotations

import math
import time
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from drivers.base import EndOfRecording, SensorLost
from drivers.grabber.base import FrameGrabber, VideoFrame
from drivers.lamp.virtual import VirtualLamp
from drivers.virtual.cctv import Renderer
from drivers.virtual.crawler import STALL_EACH_S, STALL_S, DriveClock, Plug
from drivers.virtual.drive import Drive
from drivers.virtual.faults import FaultScript

Picture = NDArray[np.uint8]
FPS = 25.0


class Footage:
    """The pictures of one ``drive``: what the camera sees at any moment, the same for whoever asks."""

    def __init__(self, drive: Drive, fps: float = FPS) -> None:
        self.drive, self.fps = drive, fps
        self._renderer = Renderer(drive.sewer, drive.camera, drive.look, drive.seed)
        self._dark: Renderer | None = None

    def picture(self, t: float, number: int, dark: bool = False) -> Picture:
        """(H, W, 3) uint8 BGR at ``t`` seconds of the drive; its noise goes by its number. ``dark``: the lamp is out."""
        drive, rng = self.drive, np.random.default_rng([self.drive.seed, 61, number])
        before = drive.pose(max(0.0, t - 0.5 / self.fps))
        texts = (f"{drive.encoder(t):07.2f} m", f"{int(t) // 60:02d}:{int(t) % 60:02d}")
        return (self._unlit() if dark else self._renderer).picture(drive.pose(t), rng, before, texts, t)

    def _unlit(self) -> Renderer:
        if self._dark is None:
            drive = self.drive
            self._dark = Renderer(drive.sewer, drive.camera, replace(drive.look, lamp=0.02, haze=0.0), drive.seed)
        return self._dark


class VirtualGrabber(FrameGrabber):
    """Live: what the crawler of ``clock`` sees now; numbers run on at the camera's rate while nobody reads. Faults are those of
    CCTV_FAULTS, by the wall clock. ``lamp`` lights it, where it has one."""

    name = "virtual CCTV"

    def __init__(
        self, footage: Footage, clock: DriveClock, faults: FaultScript | None = None, lamp: VirtualLamp | None = None
    ) -> None:
        self.faults = faults or FaultScript()
        self._lamp = lamp
        self.frame_rate = footage.fps
        self._footage, self._clock = footage, clock
        self._plug = Plug(self.name, self.faults)
        self._opened = 0.0
        self._number = 0
        self._frozen: Picture | None = None

    def _open(self) -> None:
        self._plug.open()
        self._opened, self._number, self._frozen = time.monotonic(), 0, None

    def _read(self, timeout_s: float) -> VideoFrame:
        active = self._plug.wait(self._opened + self._number / self._footage.fps, timeout_s, "no picture")
        t, taken = self._clock.now_s(), time.monotonic_ns()
        number = max(self._number + 1, int((taken / 1e9 - self._opened) * self._footage.fps) + 1)
        if "stall" in active and _stalled(number, self._footage.fps, self._number):
            time.sleep(STALL_S)
            taken = time.monotonic_ns()
        image = _spoilt(self._footage, t, number, active, self._frozen)
        if self._lamp is not None and image is not self._frozen and "garbage" not in active:
            image = self._lamp.light(image)
        self._frozen = image if "freeze" in active else None
        self._number = number
        return VideoFrame(image.copy() if image is self._frozen else image, taken, number, source=self.name)

    def close(self) -> None:
        self._plug.close()


class VirtualVideo(FrameGrabber):
    """The whole drive as a recording, drawn as fast as it is read; opened again it begins again, to the bit.

    Faults befall it by the time in the recording; what a live source would not have sent is missing from it.
    """

    name = "virtual CCTV recording"

    def __init__(self, footage: Footage, faults: FaultScript | None = None) -> None:
        self._footage, self._given = footage, faults
        self._media_s = 0.0
        self.faults = faults or FaultScript()
        self.frame_rate = footage.fps
        self._next: int | None = None
        self._frozen: Picture | None = None

    def _open(self) -> None:
        self.frame_count = math.floor(self._footage.drive.length_s * self._footage.fps)
        self._next, self._frozen, self._media_s = 0, None, 0.0
        self.faults = (self._given or FaultScript()).anew(lambda: self._media_s)
        self.faults.begin()

    def _read(self, timeout_s: float) -> VideoFrame:
        if self._next is None:
            raise SensorLost(f"The {self.name} is not open.")
        fps, count = self._footage.fps, self.frame_count or 0
        while self._next < count:
            k = self._next
            self._media_s = k / fps
            active = self.faults.active()
            self._next += 1
            if not active.isdisjoint(("disconnect", "never comes", "hang")):
                continue
            seen_s = k / fps
            if "stall" in active and _stalled(k + 1, fps, k):
                k = min(k + round(STALL_S * fps), count - 1)
                self._next = k + 1
            image = _spoilt(self._footage, seen_s, k + 1, active, self._frozen)
            self._frozen = image if "freeze" in active else None
            copy = image.copy() if image is self._frozen else image
            return VideoFrame(copy, time.monotonic_ns(), k + 1, k / fps, f"virtual drive {self._footage.drive.seed}")
        raise EndOfRecording("The virtual drive is at its end.")

    def close(self) -> None:
        self._next = None


def _spoilt(footage: Footage, t: float, number: int, faults: frozenset[str], frozen: Picture | None) -> Picture:
    """The picture at ``t`` with what the ``faults`` make of it."""
    if "freeze" in faults and frozen is not None:
        return frozen
    image = footage.picture(t, number, "dark" in faults)
    if "garbage" in faults:
        image = np.random.default_rng([footage.drive.seed, 62, number]).integers(0, 256, image.shape, np.uint8)
    return np.ascontiguousarray(image[: len(image) // 2]) if "wrong size" in faults else image


def _stalled(number: int, fps: float, before: int) -> bool:
    """Whether a second went by between two pictures."""
    return int(number / (fps * STALL_EACH_S)) != int(before / (fps * STALL_EACH_S))
