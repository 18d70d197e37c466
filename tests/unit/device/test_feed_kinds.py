"""The ladder under a CCTV grabber and a tether encoder: what is a fault for one kind of source is none for another."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from device.feeds.feed import EncoderFeed, Feed, GrabberFeed
from device.feeds.reader import FeedTiming
from device.feeds.samples import DEPTH, VIDEO
from drivers.grabber.base import VideoFrame
from tests.unit.device.device_doubles import ScriptedEncoder, ScriptedGrabber, eventually, frame
from tests.unit.device.test_feed import QUICK


@pytest.fixture
def open_feeds() -> Iterator[list[Feed[Any]]]:
    feeds: list[Feed[Any]] = []
    yield feeds
    for feed in feeds:
        feed.close()


def grabbing(feeds: list[Feed[Any]], script: str, **options: Any) -> tuple[GrabberFeed, ScriptedGrabber]:
    grabber = ScriptedGrabber(script)
    feed = GrabberFeed("cctv", "v4l2", lambda: grabber, timing=QUICK, **options)
    feeds.append(feed)
    feed.start()
    return feed, grabber


def reading(feeds: list[Feed[Any]], script: str) -> tuple[EncoderFeed, ScriptedEncoder]:
    encoder = ScriptedEncoder(script)
    feed = EncoderFeed("tether", "qsb", lambda: encoder, timing=QUICK)
    feeds.append(feed)
    feed.start()
    return feed, encoder


def test_a_grabber_is_up_and_its_lost_frames_are_counted(open_feeds: list[Feed[Any]]) -> None:
    feed, _ = grabbing(open_feeds, "frame skip frame")
    assert eventually(lambda: feed.status().frames > 20)
    assert (feed.status().state, feed.status().drops) == ("up", 3)


def test_a_frozen_grabber_is_restarted(open_feeds: list[Feed[Any]]) -> None:
    feed, grabber = grabbing(open_feeds, "frame freeze")
    assert eventually(lambda: grabber.calls.count("open") > 1)
    assert "same picture again and again" in feed.status().message
    assert feed.status().frames == 2


def test_an_even_picture_is_no_signal_and_is_said_to_be(open_feeds: list[Feed[Any]]) -> None:
    feed, _ = grabbing(open_feeds, "frame blue")
    assert eventually(lambda: "no signal" in feed.status().message)
    assert feed.blind
    assert feed.status().frames == 1


def test_a_tether_that_stands_still_is_no_fault(open_feeds: list[Feed[Any]]) -> None:
    feed, encoder = reading(open_feeds, "100")
    assert eventually(lambda: feed.status().frames > 10 * QUICK.repeats_before_frozen)
    assert feed.status().state == "up"
    assert feed.status().bad_frames == 0
    assert encoder.calls == ["open"]


def test_an_encoder_that_is_unplugged_and_comes_back_is_up_again(open_feeds: list[Feed[Any]]) -> None:
    feed, _ = reading(open_feeds, "1 2 lost lost 3 4 5")
    tap = feed.tap(1000)
    assert eventually(lambda: feed.status().reconnects == 2 and feed.status().state == "up")
    values = [tap.get(1.0) for _ in range(3)]
    assert [sample.value for sample in values if sample][-1] in (2, 3, 4, 5)


def test_a_silent_encoder_is_told_in_its_own_words(open_feeds: list[Feed[Any]]) -> None:
    feed, _ = reading(open_feeds, "1 timeout")
    assert eventually(lambda: feed.status().state == "lost")
    assert feed.status().message == "The encoder said nothing."


def test_a_costly_source_is_only_read_while_somebody_needs_it(open_feeds: list[Feed[Any]]) -> None:
    feed, grabber = grabbing(open_feeds, "frame", on_demand=True)
    time.sleep(0.1)
    assert grabber.calls == []
    assert feed.status().state == "resting"
    tap = feed.tap(2)
    assert eventually(lambda: feed.status().frames > 5)
    tap.close()
    assert eventually(lambda: grabber.calls == ["open", "close"])
    assert eventually(lambda: feed.status().state == "resting")
    feed.wake(0.2)
    assert eventually(lambda: grabber.calls.count("open") == 2)
    assert eventually(lambda: grabber.calls.count("close") == 2)
    assert feed.status().reconnects == 0  # to rest is no fault


def test_a_source_at_rest_can_be_closed(open_feeds: list[Feed[Any]]) -> None:
    feed, grabber = grabbing(open_feeds, "frame", on_demand=True)
    begun = time.monotonic()
    feed.close()
    assert time.monotonic() - begun < 1.0
    assert grabber.calls == []


def test_random_bytes_are_no_picture_and_no_depth() -> None:
    """What comes over a broken cable is told from what a sensor can have seen: pipes, walls with holes, noise within reason."""
    rng = np.random.default_rng(4)
    noise = rng.integers(0, 65536, (172, 224)).astype(np.uint16)
    rows, columns = np.mgrid[0:172, 0:224]
    pipe = (60_000 / (10 + np.hypot(rows - 86, columns - 112))).astype(np.uint16)
    holes = np.where(rng.random(pipe.shape) < 0.4, 0, pipe).astype(np.uint16)
    rough = (pipe * rng.normal(1, 0.05, pipe.shape)).astype(np.uint16)
    for depth, garbled in ((noise, True), (pipe, False), (holes, False), (rough, False), (pipe * 0, False)):
        assert DEPTH.garbled(replace(frame(1), depth=depth)) == garbled
    picture = np.repeat(np.clip(pipe // 24, 0, 255).astype(np.uint8)[..., None], 3, axis=2)
    speckled = np.clip(picture + rng.normal(0, 15, picture.shape), 0, 255).astype(np.uint8)
    snow = rng.integers(0, 256, picture.shape).astype(np.uint8)
    for image, garbled in ((snow, True), (picture, False), (speckled, False)):
        assert VIDEO.garbled(VideoFrame(image, 0, 1)) == garbled


def test_a_source_that_sends_garbage_is_declared_so_and_recovers() -> None:
    snow = np.random.default_rng(5).integers(0, 256, (48, 64, 3)).astype(np.uint8)
    broken = threading.Event()

    class Grabber(ScriptedGrabber):
        def _read(self, timeout_s: float) -> VideoFrame:
            seen = super()._read(timeout_s)
            return replace(seen, image=np.roll(snow, seen.number, axis=1)) if broken.is_set() else seen

    feed = GrabberFeed("g", "virtual", lambda: Grabber("frame"), timing=FeedTiming(back_off_s=(0.01,)))
    feed.start()
    try:
        assert eventually(lambda: feed.status().state == "up")
        broken.set()
        assert eventually(lambda: feed.status().state in ("degraded", "lost") and "noise" in feed.status().message)
        assert feed.status().bad_frames >= 15
        broken.clear()
        assert eventually(lambda: feed.status().state == "up")
    finally:
        feed.close()
