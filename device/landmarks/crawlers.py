"""From the settings to a crawler: which grabber, which encoder, which camera. Nothing is opened here."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from device.config import LIVE_STEREO, CrawlerSettings, LampSettings, Settings, StereoSettings
from device.errors import Invalid
from device.feeds.feed import EncoderFeed, GrabberFeed, StereoFeed
from device.feeds.reader import FeedTiming
from device.landmarks.crawler import Crawler, Optics
from device.landmarks.detectors import Detector
from device.landmarks.left_picture import LeftPicture, optics_of
from device.landmarks.pipeline import LEAST_RATE
from device.landmarks.tether import Tether
from device.store import Store
from drivers.base import DriverError
from drivers.encoder.base import Encoder
from drivers.encoder.osd import OsdEncoder, OsdReader
from drivers.grabber.base import FrameGrabber
from drivers.grabber.paced import PacedGrabber
from drivers.lamp.base import Lamp
from drivers.registry import open_encoder, open_grabber, open_lamp
from drivers.stereo.base import PairSettings

_GRABBER_ARGUMENT = {"v4l2": "device", "stream": "url", "video": "file", "stills": "folder"}
_RECORDED = ("video", "stills")


def make_crawler(settings: Settings, store: Store, pairs: StereoFeed | None, on_change: Callable[[], None]) -> Crawler:
    """The crawler of the settings; ``pairs`` are those of the box's stereo camera. Raises Invalid where they name what cannot
    be."""
    crawler = settings.crawler
    if crawler.grabber == "virtual" or crawler.encoder == "virtual":
        if (crawler.grabber, crawler.encoder) != ("virtual", "virtual"):
            raise Invalid("The virtual grabber and the virtual encoder go together.")
        from device.landmarks.virtual_crawler import virtual_crawler  # it draws in the whole virtual sewer

        return virtual_crawler(settings.virtual_seed, store, on_change)
    rate = _pairs_rate(settings.stereo) if crawler.grabber == "stereo" else _recorded_rate(crawler)
    return Crawler(
        grabber=_left_picture(pairs, on_change) if crawler.grabber == "stereo" else _grabber(crawler, rate, on_change),
        tether=_tether(crawler, store, on_change),
        reader=_reader(crawler),
        optics=partial(_optics, crawler, pairs),
        radius=crawler.radius_m,
        detector=partial(_detector, crawler.detect_every),
        lamp=make_lamp(settings.lamp),
        sparse=rate is not None and rate < LEAST_RATE,
    )


def make_lamp(settings: LampSettings) -> Lamp | None:
    """The lamp of the settings, not switched on; None where the box has none. Raises Invalid where they name what cannot be."""
    if settings.driver == "none":
        return None
    lamp: Lamp = _checked(lambda: open_lamp(settings.driver, **settings.options))
    return lamp


def _detector(every: int) -> Detector:
    """The shipped network, looking at each ``every``-th picture; loaded when a drive begins."""
    from device.fcdd.detector import shipped_detector

    return shipped_detector(every=every)


def _recorded_rate(settings: CrawlerSettings) -> float | None:
    """Pictures a second of a recording; None where it does not tell, or there is none to be read (yet)."""
    if settings.grabber not in _RECORDED or not settings.grabber_source:
        return None
    try:
        grabber = open_grabber(settings.grabber, **_grabber_arguments(settings))
        grabber.open()
    except (DriverError, ValueError, TypeError):  # told where the grabber is made, or by the feed
        return None
    try:
        return grabber.frame_rate
    finally:
        grabber.close()


def _pairs_rate(settings: StereoSettings) -> float:
    """Pairs a second, as asked."""
    return float(settings.options.get("fps", PairSettings.fps)) if settings.driver in LIVE_STEREO else settings.rate_hz


def _grabber_arguments(settings: CrawlerSettings) -> dict[str, Any]:
    return {_GRABBER_ARGUMENT[settings.grabber]: settings.grabber_source, **settings.grabber_options}


def _optics(settings: CrawlerSettings, pairs: StereoFeed | None) -> Optics:
    """What the settings say; of a stereo camera they need not."""
    if settings.grabber == "stereo" and pairs is not None and settings.focal_px is None:
        return optics_of(pairs)
    return Optics(settings.focal_px, settings.centre_px)


def _left_picture(pairs: StereoFeed | None, on_change: Callable[[], None]) -> GrabberFeed:
    if pairs is None:
        raise Invalid("The stereo grabber is the left picture of a stereo camera, and this box has none: name it in [stereo].")
    make = partial(LeftPicture, pairs)
    return GrabberFeed(make().name, "stereo", make, recorded=pairs.recorded, on_demand=True, on_change=on_change)


def _grabber(settings: CrawlerSettings, rate: float | None, on_change: Callable[[], None]) -> GrabberFeed | None:
    kind = settings.grabber
    if kind == "none":
        return None
    if not settings.grabber_source:
        raise Invalid(f"Say with grabber_source where the {kind} grabber finds its pictures.")
    arguments = _grabber_arguments(settings)

    def make() -> FrameGrabber:
        grabber = open_grabber(kind, **arguments)
        return PacedGrabber(grabber) if kind in _RECORDED else grabber

    name = _checked(make).name
    period_s = 1 / rate if rate else 0.0
    usual = FeedTiming()
    timing = FeedTiming(read_s=usual.read_s + period_s, stale_s=usual.stale_s + 2 * period_s)
    return GrabberFeed(name, kind, make, recorded=kind in _RECORDED, timing=timing, on_change=on_change)


def _tether(settings: CrawlerSettings, store: Store, on_change: Callable[[], None]) -> Tether | None:
    kind = settings.encoder
    if kind in ("none", "osd"):
        return None
    if not settings.encoder_port:
        raise Invalid(f"Say with encoder_port where the {kind} encoder is plugged in.")
    where = "file" if kind == "csv" else "port"
    arguments: dict[str, Any] = {where: settings.encoder_port, **settings.encoder_options}

    def make() -> Encoder:
        return open_encoder(kind, **arguments)

    name = _checked(make).name
    return Tether(
        EncoderFeed(name, kind, make, recorded=kind == "csv", on_change=on_change), store.remembered, settings.counts_per_metre
    )


def _reader(settings: CrawlerSettings) -> Callable[[], Any] | None:
    if settings.encoder != "osd":
        return None
    region = settings.osd_region
    return lambda: OsdEncoder(OsdReader(region))


def _checked(make: Callable[[], Any]) -> Any:
    """Made once, not opened: a slip in the settings is told now, before anything is started."""
    try:
        return make()
    except (DriverError, ValueError) as error:
        raise Invalid(str(error)) from None
    except TypeError as error:
        raise Invalid(f"The settings name an option that its driver does not have: {error}.") from None
