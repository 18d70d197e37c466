"""``borescout map --grabber``: a drive in the terminal, from now until Ctrl-C."""

from __future__ import annotations

import sys
import time
from functools import partial
from typing import TYPE_CHECKING, Any

import click

from device.errors import Invalid
from device.fcdd.detector import shipped_detector
from device.feeds.feed import EncoderFeed, Feed, GrabberFeed
from device.feeds.tap import Tap
from device.landmarks.command import Map, finished, warn
from device.landmarks.drive_faults import FaultWatch
from device.landmarks.pipeline import LandmarkPipeline
from device.landmarks.placing import Placing
from device.prompts import PROMPTS
from drivers.base import DriverError
from drivers.encoder.base import Reading
from drivers.encoder.calibration import Calibration
from drivers.encoder.osd import OsdEncoder, OsdReader
from drivers.grabber.base import VideoFrame
from drivers.registry import open_encoder, open_grabber

if TYPE_CHECKING:
    from device.landmarks.command import Options

FIRST_S = 15.0
"""How long a source may take until its first picture or reading."""
_SHOW_S = 1.0


def map_live(wanted: Options) -> Map:
    """Map until Ctrl-C. Raises Invalid where the sources do not come up."""
    grabber, encoder = _grabber(wanted), _encoder(wanted)
    feeds: list[Feed[Any]] = [feed for feed in (grabber, encoder) if feed is not None]
    for feed in feeds:
        feed.start()
    try:
        for feed in feeds:
            _wait_for(feed)
        return _drive(wanted, grabber, encoder)
    finally:
        for feed in feeds:
            feed.close()


def _drive(wanted: Options, grabber: GrabberFeed, encoder: EncoderFeed | None) -> Map:
    calibration = Calibration(wanted.counts_per_metre)
    if encoder is not None and encoder.latest is not None:
        calibration = calibration.zeroed_at(encoder.latest)
    placing = Placing(calibration, None if encoder is not None else OsdEncoder(OsdReader(wanted.region())))
    pipeline = LandmarkPipeline(wanted.setup(), shipped_detector(every=wanted.every))
    faults = FaultWatch()
    frames = grabber.tap(2)
    readings = None if encoder is None else encoder.tap(4096)
    begun = shown = time.monotonic()
    warn("Mapping; Ctrl-C ends the drive.")
    try:
        while True:
            frame = frames.get(0.05)
            _take(readings, placing)
            codes = _map(frame, placing, pipeline)
            now = time.monotonic()
            where = placing.now()
            faults.now(now - begun, None if where is None else where.chainage)
            faults.feed("grabber", grabber.status())
            if encoder is not None:
                faults.feed("encoder", encoder.status())
            faults.jumps(placing.jumps)
            faults.codes(codes)
            if now - shown > _SHOW_S:
                shown = now
                _show(pipeline, where.chainage if where else None, grabber.status().drops)
    except KeyboardInterrupt:
        warn(f"The drive has ended after {time.monotonic() - begun:.0f} s; its map follows, nothing else is kept.")
    finally:
        frames.close()
        placing.close()
        if readings is not None:
            readings.close()
    return finished(pipeline, faults, time.monotonic() - begun, wanted.length)


def _take(readings: Tap[Reading] | None, placing: Placing) -> None:
    while readings is not None and (reading := readings.get(0.0)) is not None:
        placing.add(reading)


def _map(frame: VideoFrame | None, placing: Placing, pipeline: LandmarkPipeline) -> list[str]:
    if frame is None:
        return []
    placing.see(frame)
    step = pipeline.step(frame, placing.at(frame.time_s))
    return [code for code in step.prompts if code in PROMPTS]


def _show(pipeline: LandmarkPipeline, chainage: float | None, dropped: int) -> None:
    if sys.stderr.isatty():
        where = "nobody knows where" if chainage is None else f"{chainage:.2f} m"
        found = f"{len(pipeline.landmarks())} landmarks, {len(pipeline.joints())} joints"
        click.echo(f"\r{where}, {pipeline.frames} frames, {dropped} dropped, {found}   ", err=True, nl=False)


def _grabber(wanted: Options) -> GrabberFeed:
    assert wanted.grabber is not None  # check() saw to it
    kind, argument = ("stream", "url") if "://" in wanted.grabber else ("v4l2", "device")
    make = partial(open_grabber, kind, **{argument: wanted.grabber})
    return GrabberFeed(_checked(make).name, kind, make)


def _encoder(wanted: Options) -> EncoderFeed | None:
    if wanted.encoder is None:
        return None
    given = {"port": wanted.port, "baud": wanted.baud, "pattern": wanted.pattern}
    make = partial(open_encoder, wanted.encoder, **{name: value for name, value in given.items() if value is not None})
    return EncoderFeed(_checked(make).name, wanted.encoder, make)


def _checked(make: Any) -> Any:
    try:
        return make()
    except (DriverError, ValueError) as error:
        raise Invalid(str(error)) from None
    except TypeError:
        raise Invalid("This encoder does not take one of the options --baud and --pattern, or needs one of them.") from None


def _wait_for(feed: Feed[Any]) -> None:
    deadline = time.monotonic() + FIRST_S
    while feed.latest is None:
        status = feed.status()
        if status.state == "lost" or time.monotonic() > deadline:
            raise Invalid(status.message or f"Nothing comes from {feed.name}.")
        time.sleep(0.05)
