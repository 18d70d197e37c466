"""The crawler of ``--virtual``: the twins of grabber and encoder on one drive, and a detector that knows the truth.

Live, the crawler waits at the start node until a drive begins and stands while it is paused; as a recording it is drawn as
fast as it goes. Between drives nothing is drawn unless somebody looks at the picture.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator

import numpy as np

from device.feeds.feed import EncoderFeed, GrabberFeed
from device.landmarks.crawler import Crawler, Optics
from device.landmarks.pipeline import PipelineSetup
from device.landmarks.recorded_way import RecordedWay, recorded_way
from device.landmarks.tether import Tether
from device.store import Store
from drivers.base import EndOfRecording
from drivers.encoder.base import Reading
from drivers.grabber.base import VideoFrame
from drivers.lamp.virtual import NOMINAL, VirtualLamp
from drivers.virtual.crawler import DriveClock
from drivers.virtual.detections import SeenLandmark, corrupted
from drivers.virtual.drive import Drive, demo_drive
from drivers.virtual.encoder import VirtualCount, VirtualEncoder
from drivers.virtual.faults import FaultScript
from drivers.virtual.grabber import Footage, VirtualGrabber, VirtualVideo
from estimators.detections import Detection

FRESH_S = 1.0
"""How long the counter may take to see that the crawler is back at the start node."""


class VirtualDetector:
    """What the detector network would say: the truth, corrupted as the CCTV paper's Table II has it. ``moment`` tells the time
    since the start of the drive at which a frame was taken."""

    name = "virtual"

    def __init__(self, drive: Drive, moment: Callable[[VideoFrame], float]) -> None:
        self._drive = drive
        self._moment = moment
        self._rng = np.random.default_rng([drive.seed, 71])

    def detect(self, frame: VideoFrame) -> tuple[Detection, ...]:
        """Everything it sees, and what it takes for something."""
        return tuple(_detection(seen) for seen in corrupted(self._drive, self._moment(frame), self._rng))


def _detection(seen: SeenLandmark) -> Detection:
    return Detection(seen.u, seen.v, seen.label, area=seen.area, outline=seen.outline)


def _optics(drive: Drive) -> Optics:
    """As a calibration would state it."""
    camera = drive.camera
    return Optics((camera.fx, camera.fy), (camera.cx, camera.cy))


class VirtualRun:
    """A whole drive as a recording, for ``borescout map --virtual``."""

    def __init__(self, seed: int) -> None:
        self._drive = demo_drive(seed)
        self._video = VirtualVideo(Footage(self._drive))
        self._video.open()
        self.frame_count = self._video.frame_count

    def frames(self) -> Iterator[VideoFrame]:
        """Every picture, with its time in the drive."""
        try:
            while True:
                yield self._video.read()
        except EndOfRecording:
            self._video.close()

    def way(self) -> RecordedWay:
        """Where the tether says that the crawler was."""
        readings = list(_readings(self._drive))
        return recorded_way(
            [reading.time_s for reading in readings], [reading.value for reading in readings], readings[0].quantum
        )

    def setup(self) -> PipelineSetup:
        """What is known of the camera and the pipe."""
        optics = _optics(self._drive)
        return PipelineSetup(optics.focal, optics.centre, self._drive.sewer.radius)

    def detector(self) -> VirtualDetector:
        """The detector of this drive."""
        return VirtualDetector(self._drive, lambda frame: frame.time_s)


def _readings(drive: Drive) -> Iterator[Reading]:
    counter = VirtualCount(drive)
    counter.open()
    try:
        while True:
            yield counter.read()
    except EndOfRecording:
        counter.close()


def virtual_crawler(
    seed: int,
    store: Store,
    on_change: Callable[[], None],
    faults: tuple[FaultScript, FaultScript] | None = None,
    footage: Footage | None = None,
) -> Crawler:
    """The live virtual crawler. ``faults`` are those of its grabber and of its encoder, for who wants to trigger some;
    ``footage`` is what it sees, where that is not to be drawn at the usual rate: then its drive is the footage's."""
    of_grabber, of_encoder = faults or (FaultScript(), FaultScript())
    footage = footage or Footage(demo_drive(seed))
    drive = footage.drive
    clock, lamp = DriveClock(drive.length_s), VirtualLamp()
    lamp.set(NOMINAL)  # until the box takes hold of it
    grabber = GrabberFeed(
        "virtual CCTV", "virtual", lambda: VirtualGrabber(footage, clock, of_grabber, lamp), on_demand=True, on_change=on_change
    )
    feed = EncoderFeed("virtual tether", "virtual", lambda: VirtualEncoder(drive, clock, of_encoder), on_change=on_change)

    def begin() -> None:
        """The crawler is set down at the start node; the counter must have seen it there before it is zeroed."""
        clock.begin()
        begun = time.monotonic_ns()
        while (feed.latest is None or feed.latest.monotonic_ns < begun) and time.monotonic_ns() - begun < 1e9 * FRESH_S:
            time.sleep(0.01)

    def moment(frame: VideoFrame) -> float:
        return clock.now_s() - (time.monotonic_ns() - frame.monotonic_ns) / 1e9

    return Crawler(
        grabber=grabber,
        tether=Tether(feed, store.remembered, 1.0),
        detector=lambda: VirtualDetector(drive, moment),
        optics=lambda: _optics(drive),
        radius=drive.sewer.radius,
        lamp=lamp,
        begin=begin,
        hold=clock.hold,
    )
