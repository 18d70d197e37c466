"""A box that is left alone with a crawler in a virtual sewer: pipes, manholes, halts, darkness, on a clock that runs fast.

``python -m tests.hil.unattended_rig FOLDER ...`` is the whole tour with its power cuts: the box is a process of its own that is
killed, and the tour goes on without it, as the sewer does.
"""

from __future__ import annotations

import argparse
import os
import signal
import threading
import time
import traceback
from collections.abc import Sequence
from dataclasses import dataclass
from multiprocessing.sharedctypes import RawValue
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from device.clock import Clock
from device.config import Settings
from device.daemon import Device
from device.feeds.feed import EncoderFeed, GrabberFeed
from device.landmarks.crawler import Crawler, Optics
from device.landmarks.tether import Tether
from device.store import Store
from device.workers import WorkerPool
from drivers.base import FrameTimeout
from drivers.encoder.base import Encoder, Reading
from drivers.grabber.base import FrameGrabber, VideoFrame
from estimators.detections import Detection
from estimators.landmarks.projection import View, project
from tests.crash import shim
from tests.hil.crawler_rig import CAMERA, CENTRE, COUNTS_PER_METRE, SIGHT_M, TIMING, PipePictures

Kind = Literal["pipe", "manhole", "dark"]
FPS = 5.0
ASKED_EACH_S = 0.5
KEEP_FREE_MB, STOP_FREE_MB = 70, 60
STILL_S = 20.0
"""After so long a halt is a standstill; on a real crawler it takes longer (``device.autonomy.machine.Rules``)."""


@dataclass(frozen=True)
class Stage:
    """``seconds`` of the tour at ``speed`` (m/s). ``number`` of the pipe, 0 for none; ``dark`` with the lamp out."""

    number: int
    seconds: float
    speed: float = 0.2
    dark: bool = False


@dataclass(frozen=True)
class Moment:
    """What is so at one moment: ``way`` (m) is what the counter has counted, ``chainage`` (m) is since the pipe's begin."""

    kind: Kind
    number: int
    way: float
    chainage: float
    speed: float


class Tour:
    """Everything as a function of the seconds since its begin."""

    def __init__(self, stages: Sequence[Stage]) -> None:
        self.stages = tuple(stages)
        self._times = np.concatenate([[0.0], np.cumsum([stage.seconds for stage in stages])])
        self._ways = np.concatenate([[0.0], np.cumsum([stage.seconds * stage.speed for stage in stages])])
        self.length_s = float(self._times[-1])

    def at(self, t: float) -> Moment:
        index = int(np.clip(np.searchsorted(self._times, t, side="right") - 1, 0, len(self.stages) - 1))
        stage = self.stages[index]
        way = float(self._ways[index] + stage.speed * min(max(t - self._times[index], 0.0), stage.seconds))
        kind: Kind = "dark" if stage.dark else "pipe" if stage.number else "manhole"
        return Moment(kind, stage.number, way, way - self.begin_m(stage.number), stage.speed)

    def begin_m(self, number: int) -> float:
        """What the counter says where pipe ``number`` begins."""
        return next((float(way) for stage, way in zip(self.stages, self._ways, strict=False) if stage.number == number), 0.0)

    def pipes(self) -> dict[int, tuple[float, float]]:
        """From when to when the crawler goes through each pipe: halts and flickers belong to it, the last standstill and the
        last darkness do not."""
        found: dict[int, tuple[float, float]] = {}
        for stage, begin, end in zip(self.stages, self._times, self._times[1:], strict=False):
            if stage.number and stage.speed and not stage.dark:
                found[stage.number] = (found.get(stage.number, (float(begin), 0.0))[0], float(end))
        return found

    def things(self, number: int) -> tuple[tuple[str, float, float], ...]:
        """Landmarks of a pipe: (class, metres from its begin, radians)."""
        rng = np.random.default_rng([number, 5])
        return tuple(("connection", 2.0 + 2.2 * k, float(rng.uniform(-3, 3))) for k in range(3))


def five_pipes() -> Tour:
    """Halts, a flicker of the lamp, darkness, a standstill between two pipes, manholes."""
    manhole = Stage(0, 14.0, 0.1)
    return Tour(
        (
            manhole,
            *(Stage(1, 20.0), Stage(1, 8.0, 0.0), Stage(1, 25.0)),
            manhole,
            Stage(2, 70.0),
            Stage(0, 25.0, 0.1, dark=True),
            *(Stage(3, 20.0), Stage(3, 4.0, dark=True), Stage(3, 25.0)),
            Stage(3, 40.0, 0.0),
            *(Stage(4, 20.0), Stage(4, 10.0, 0.0), Stage(4, 25.0)),
            manhole,
            Stage(5, 80.0),
            Stage(0, 30.0, 0.1),
        )
    )


def two_pipes() -> Tour:
    """A shorter one: a halt, a power cut somewhere."""
    return Tour(
        (
            Stage(0, 6.0, 0.1),
            Stage(1, 12.0),
            Stage(1, 5.0, 0.0),
            Stage(1, 12.0),
            Stage(0, 15.0, 0.1),
            Stage(2, 60.0),
            Stage(0, 30.0, 0.1),
        )
    )


TOURS = {"five": five_pipes, "two": two_pipes}


class TourTime:
    """Seconds of the tour, shared by every process of it: each picture is ``1 / FPS`` later than the last one.

    Time goes on as fast as the box can look, at most ``scale`` times as fast as ours, so that a slow machine changes nothing;
    the rules are asked several times a second of it, and a drive that is being smoothed is waited for.
    """

    def __init__(self, scale: float) -> None:
        self.scale = scale
        self.shared = RawValue("d", 0.0)

    @property
    def now_s(self) -> float:
        return float(self.shared.value)


class TourClock(Clock):
    """The tour's time as the box's; it runs on while the box has no power. Each one is another boot."""

    def __init__(self, folder: Path, moment: TourTime) -> None:
        super().__init__(folder / "no-machine", lambda: round(moment.now_s * 1e9), lambda: 0)


class Pacer:
    """Lets time go on, a picture at a time, for the box of one process."""

    def __init__(self, moment: TourTime) -> None:
        self.moment = moment
        self.device: Device | None = None
        self.step = threading.Condition()
        self._due = time.monotonic()
        self._turned_s = 0.0

    def turned(self) -> None:
        """The rules were asked."""
        self._turned_s = self.moment.now_s

    def tick(self) -> float:
        """Wait for the next moment; it."""
        time.sleep(max(0.0, self._due - time.monotonic()))
        self._due = max(self._due + 1 / (FPS * self.moment.scale), time.monotonic())
        deadline = time.monotonic() + 20.0
        while self._behind() and time.monotonic() < deadline:
            time.sleep(0.002)
        with self.step:
            self.moment.shared.value += 1 / FPS
            self.step.notify_all()
        return self.moment.now_s

    def _behind(self) -> bool:
        device = self.device
        if device is None:
            return False
        if self.moment.now_s - self._turned_s > ASKED_EACH_S or device.drive.state()["state"] == "finishing":
            return True
        return any(tap.waiting for feed in device._crawler.feeds[:1] for tap in list(feed._taps))


class TourGrabber(FrameGrabber):
    name = "tour CCTV"

    def __init__(self, tour: Tour, pacer: Pacer) -> None:
        self._tour, self._pacer, self._number = tour, pacer, 0
        self._pipe = PipePictures(contrast=60.0)
        self._rng = np.random.default_rng(7)

    def _open(self) -> None: ...

    def _read(self, timeout_s: float) -> VideoFrame:
        t = self._pacer.tick()
        self._number += 1
        return VideoFrame(self._picture(self._tour.at(t)), time.monotonic_ns(), self._number, media_s=t)

    def _picture(self, now: Moment) -> NDArray[np.uint8]:
        if now.kind == "pipe":
            return self._pipe.at(now.chainage + 3.0 * now.number)
        shape = (CAMERA.height, CAMERA.width)
        if now.kind == "dark":
            grey = self._rng.normal(4, 1.5, shape)
        else:  # a wall before the lamp: bright where it shines, rough
            rows, columns = np.mgrid[: shape[0], : shape[1]]
            spot = np.exp(-(((columns - 120) / 90) ** 2) - ((rows - 96) / 70) ** 2)
            grey = 60 + 120 * spot + self._rng.normal(0, 6, shape)
        return np.repeat(np.clip(grey, 0, 255).astype(np.uint8)[..., None], 3, axis=2)

    def close(self) -> None: ...


class TourEncoder(Encoder):
    name = "tour tether"

    def __init__(self, tour: Tour, pacer: Pacer) -> None:
        self._tour, self._pacer, self._told = tour, pacer, -1.0

    def _open(self) -> None: ...

    def _read(self, timeout_s: float) -> Reading:
        moment = self._pacer.moment
        with self._pacer.step:
            if not self._pacer.step.wait_for(lambda: moment.now_s > self._told, timeout_s):
                raise FrameTimeout("The tether encoder says nothing.")
            t = self._told = moment.now_s
        return Reading(float(round(self._tour.at(t).way * COUNTS_PER_METRE)), time.monotonic_ns(), media_s=t)

    def close(self) -> None: ...


class TourDetector:
    """Sees every landmark in sight, a little beside where it is."""

    name = "truth"

    def __init__(self, tour: Tour) -> None:
        self._tour, self._rng = tour, np.random.default_rng(3)

    def detect(self, frame: VideoFrame) -> tuple[Detection, ...]:
        now = self._tour.at(frame.time_s)
        if now.kind != "pipe":
            return ()
        near = [thing for thing in self._tour.things(now.number) if SIGHT_M[0] < thing[1] - now.chainage < SIGHT_M[1]]
        if not near:
            return ()
        states = np.array([(metres, angle) for _, metres, angle in near])
        pixels = project(CAMERA, View(now.chainage, CENTRE), states) + self._rng.normal(0, 1.5, (len(near), 2))
        return tuple(
            Detection(float(u), float(v), label, 0.9, 150.0)
            for (label, _, _), (u, v) in zip(near, pixels, strict=True)
            if 0 <= u < CAMERA.width and 0 <= v < CAMERA.height
        )


def box(folder: Path, tour: Tour, moment: TourTime) -> Device:
    """The box in the tour, logging by itself; not started."""
    pacer = Pacer(moment)

    def crawler(store: Store) -> Crawler:
        grabber = GrabberFeed("tour CCTV", "virtual", lambda: TourGrabber(tour, pacer), timing=TIMING)
        feed = EncoderFeed("tour tether", "virtual", lambda: TourEncoder(tour, pacer), timing=TIMING)
        tether = Tether(feed, store.remembered, COUNTS_PER_METRE)
        optics = Optics((CAMERA.fx, CAMERA.fy), CENTRE)
        return Crawler(grabber, tether, None, lambda: TourDetector(tour), lambda: optics, CAMERA.radius)

    settings = Settings.model_validate(
        {
            "data_dir": folder,
            "pin": "123456",
            "autonomy": {"enabled": True, "rules": {"still_s": STILL_S}},
            "recording": {"keep_free_mb": KEEP_FREE_MB, "stop_free_mb": STOP_FREE_MB, "part_mb": 2},
        }
    )
    device = Device(settings, feeds=[], pool=WorkerPool(0), clock=TourClock(folder, moment), crawler=crawler)
    pacer.device = device
    device._unattended._period_s = 0.03  # the tour goes fast
    device._unattended._turn = pacer.turned
    return device


def live(folder: Path, tour: Tour, moment: TourTime, room: int | None) -> None:
    """The life of a box from switching on to SIGTERM, in this process; ``room`` (bytes) is what its disk has left."""
    ended = threading.Event()
    signal.signal(signal.SIGTERM, lambda number, frame: ended.set())
    if room is not None:
        shim.loaded().crash_room(room)
    device = box(folder, tour, moment).start()
    ended.wait()
    device.close()


def leave_alone(folder: Path, tour: Tour, scale: float, cuts: Sequence[tuple[float, float]], room: int | None) -> None:
    """The whole tour. The box's power goes at each of ``cuts``, (second of the tour, for so long).

    Each time the box is another process; it is forked, so that it is up as fast as on a machine that does nothing else. With
    ``room`` (bytes) the disk is played by the shim.
    """
    moment = TourTime(scale)

    def wait_until(at_s: float) -> None:
        while moment.now_s < at_s:
            time.sleep(0.005)

    def switch_on() -> int:
        taken = sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())
        number = os.fork()
        if number == 0:
            try:
                live(folder, tour, moment, None if room is None else room - taken)
            except BaseException:  # noqa: BLE001 - the parent is told by the exit status
                traceback.print_exc()
                os._exit(1)
            os._exit(0)
        return number

    def ended(number: int) -> None:
        _, status = os.waitpid(number, 0)
        if os.WIFEXITED(status) and os.WEXITSTATUS(status):
            raise SystemExit("the box ended by itself")

    number = switch_on()
    for at_s, for_s in cuts:
        wait_until(at_s)
        os.kill(number, signal.SIGKILL)
        ended(number)
        moment.shared.value += for_s
        number = switch_on()
    wait_until(tour.length_s)
    os.kill(number, signal.SIGTERM)
    ended(number)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--tour", choices=sorted(TOURS), default="five")
    parser.add_argument("--scale", type=float, required=True)
    parser.add_argument("--cut", type=float, nargs=2, action="append", default=[], metavar=("AT_S", "FOR_S"))
    parser.add_argument("--room", type=int, help="bytes left on the disk")
    given = parser.parse_args()
    leave_alone(given.folder, TOURS[given.tour](), given.scale, [tuple(cut) for cut in given.cut], given.room)


if __name__ == "__main__":
    main()
