"""From the settings to a crawler: what its recordings say of themselves."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from device.clock import Clock
from device.config import CrawlerSettings, Settings
from device.errors import Invalid
from device.feeds.feed import EncoderFeed
from device.landmarks import tether
from device.landmarks.crawler import Crawler
from device.landmarks.crawlers import make_crawler
from device.store import Store
from tests.unit.device.device_doubles import ScriptedEncoder
from tests.waiting import wait_until

PICTURE = np.full((48, 64, 3), 90, np.uint8)


def crawler_of(folder: Path, **settings: object) -> Crawler:
    store = Store(folder / "data", Clock(folder / "no-clock"))
    try:
        crawler = CrawlerSettings.model_validate({"encoder": "osd", **settings})
        return make_crawler(Settings(data_dir=folder / "data", crawler=crawler), store, None, lambda: None)
    finally:
        store.close()


@pytest.mark.parametrize(("period_ms", "sparse"), [(40, False), (1000, True)])
def test_stills_say_how_far_apart_they_are(tmp_path: Path, period_ms: int, sparse: bool) -> None:
    stills = tmp_path / "stills"
    stills.mkdir()
    for k in range(4):
        cv2.imwrite(str(stills / f"{period_ms * k}.jpg"), PICTURE)
    crawler = crawler_of(tmp_path, grabber="stills", grabber_source=str(stills))
    assert crawler.sparse == sparse
    assert crawler.grabber is not None
    assert crawler.grabber.recorded


def test_a_recording_that_is_not_there_yet_is_the_feeds_to_tell(tmp_path: Path) -> None:
    crawler = crawler_of(tmp_path, grabber="video", grabber_source=str(tmp_path / "nothing.mp4"))
    assert not crawler.sparse


def test_a_box_without_a_stereo_camera_has_no_left_picture(tmp_path: Path) -> None:
    with pytest.raises(Invalid, match=r"\[stereo\]"):
        crawler_of(tmp_path, grabber="stereo")


def test_an_option_that_no_driver_has_is_refused(tmp_path: Path) -> None:
    with pytest.raises(Invalid, match="does not have"):
        crawler_of(tmp_path, grabber="stills", grabber_source=str(tmp_path), grabber_options={"colour": 1})


def test_a_silent_tether_says_nowhere_and_not_where_it_was(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tether, "_FRESH_S", 0.3)
    store = Store(tmp_path, Clock(tmp_path / "no-clock"))
    feed = EncoderFeed("twin", "virtual", lambda: ScriptedEncoder("2.5 " * 30 + "timeout", 0.01))
    counted = tether.Tether(feed, store.remembered, 1.0)
    assert counted.metres() is None
    feed.start()
    wait_until(lambda: counted.metres() == 2.5)
    wait_until(lambda: counted.metres() is None)
    assert counted.state()["metres"] == 2.5, "the last count is still known"
    feed.close()
    store.close()
