"""A calibration from the page, with virtual cameras before which somebody holds a board."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from device.anomaly.calibration import BoardCalibration, RigSource, board_calibration, load_calibration
from device.calibrating import board_views, session
from device.calibrating.session import CalibrationSession
from device.errors import Busy, Invalid
from device.feeds.feed import StereoFeed
from device.feeds.reader import FeedTiming
from drivers.base import FrameTimeout, SensorMissing
from drivers.grabber.base import VideoFrame
from drivers.stereo.two_cameras import TwoCameras
from estimators.board.board import Board, Sighting
from estimators.board.calibration import PairCalibration, View
from tests.unit.device.board_views import SIZE, Photographer, good_places
from tests.waiting import wait_until

BOARD = Board()


def known_lenses() -> BoardCalibration:
    """As a board told them."""
    found = PairCalibration(Photographer(BOARD).pair, 0.2, 0.1, 0.1, 0.002, ("1",) * 18, ())
    return board_calibration(found, BOARD.name)


def views(count: int) -> list[View]:
    rng = np.random.default_rng(0)
    return [Photographer(BOARD).view(f"{k}", place, rng) for k, place in enumerate(good_places(rng, count))]


class Hands:
    """Two cameras, of which only one may be open: somebody holds the board before them, each of ``views`` for two pictures.
    ``step`` lets the next picture come, where there is one."""

    name = "pair of cameras"

    def __init__(self, shown: list[View], step: threading.Semaphore | None = None) -> None:
        self.views, self.number, self.step = shown, 0, step
        self.opened = 0
        self.missing = False

    def open(self) -> None:
        if self.missing:
            raise SensorMissing("There is no /dev/video0.")
        assert self.opened == 0, "the cameras are opened by one at a time"
        self.opened += 1

    def read(self, timeout_s: float) -> tuple[VideoFrame, VideoFrame]:
        if self.step is not None and not self.step.acquire(timeout=0.05):
            raise FrameTimeout("nothing came.")
        self.number += 1
        image = np.full((SIZE[1], SIZE[0], 3), 20 + self.number % 200, np.uint8)
        image[::2] = 90
        both = [VideoFrame(image, self.number, self.number, source=side) for side in "LR"]
        return both[0], both[1]

    def sighted(self) -> tuple[Sighting, Sighting]:
        view = self.views[min((self.number - 1) // 2, len(self.views) - 1)]
        return view.left, view.right

    def reset(self) -> None: ...

    def close(self) -> None:
        self.opened = 0


class Box:
    """A pair that was never calibrated, its feed, and the session."""

    def __init__(self, folder: Path, hands: Hands) -> None:
        self.hands, self.source, self.file = hands, RigSource(), folder / "rig.json"
        camera: Any = TwoCameras(hands, lambda: self.source.lenses)  # type: ignore[arg-type]
        timing = FeedTiming(read_s=0.2, back_off_s=(0.05,))
        self.feed = StereoFeed("pair of cameras", "pair", lambda: camera, timing=timing)
        self.feed.start()
        self.feed.wake(1e6)
        self.session = CalibrationSession(lambda: hands, self.feed, self.source, self.file)  # type: ignore[arg-type,return-value]

    def state(self) -> str:
        return str(self.session.state()["state"])


@pytest.fixture
def box(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    made: list[Box] = []

    def make(shown: list[View], step: threading.Semaphore | None = None) -> Box:
        hands = Hands(shown, step)
        monkeypatch.setattr(board_views, "sighted", lambda board, left, right: hands.sighted())
        made.append(Box(tmp_path, hands))
        return made[-1]

    yield make
    for one in made:
        one.session.close()
        one.feed.close()


def test_a_pair_that_nothing_is_known_of_scans_once_it_is_calibrated(box: Any) -> None:
    pair = box(views(40))
    wait_until(lambda: pair.feed.status().state == "lost")
    assert "not calibrated" in pair.feed.status().message
    pair.session.start(BOARD)
    wait_until(lambda: pair.state() == "done")
    told = pair.session.state()
    assert told["views"] == told["views_wanted"]
    assert told["next"] == ""
    assert min(told["tilts"].values()) >= told["tilts_wanted"]
    assert told["found"]["baseline_mm"] == pytest.approx(60.3, abs=0.3)
    assert (told["calibrated"], pair.file.exists()) == (None, False), "nothing is changed before it is saved"
    assert (pair.session.picture("left") or b"").startswith(b"\xff\xd8")
    pair.session.save()
    assert pair.session.state()["calibrated"]["baseline_mm"] == told["found"]["baseline_mm"]
    assert load_calibration(pair.file) == pair.source.calibration
    wait_until(lambda: pair.feed.latest is not None)
    assert pair.feed.latest.baseline_m == pytest.approx(0.0603, abs=0.0003)
    with pytest.raises(Invalid, match="no calibration to save"):
        pair.session.save()


def test_the_camera_in_use_is_lent_and_given_back(box: Any) -> None:
    step = threading.Semaphore(0)
    pair = box(views(4), step)
    pair.source.calibration = known_lenses()
    step.release(2)
    wait_until(lambda: pair.feed.latest is not None)
    pair.session.start(BOARD)
    with pytest.raises(Busy):
        pair.session.start(BOARD)
    step.release(6)
    wait_until(lambda: pair.session.state()["views"] >= 2)
    assert pair.feed.status().state == "resting"
    assert pair.session.state()["covered"]["left"]
    pair.session.cancel()
    wait_until(lambda: pair.state() == "idle")
    number = pair.feed.latest.number
    step.release(2)
    wait_until(lambda: pair.feed.latest.number > number)


def test_a_calibration_that_nobody_looks_at_is_ended(box: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(session, "ABANDONED_S", 0.2)
    pair = box(views(4), threading.Semaphore(0))
    pair.session.start(BOARD)
    wait_until(lambda: not pair.session.busy)
    assert "Nobody looked" in pair.session.state()["message"]
    pair.source.calibration = known_lenses()
    pair.hands.step = None
    wait_until(lambda: pair.feed.latest is not None)  # the cameras were given back


def test_too_few_views_are_refused_and_a_missing_camera_is_told(box: Any) -> None:
    step = threading.Semaphore(0)
    pair = box(views(4), step)
    pair.session.start(BOARD)
    step.release(8)
    wait_until(lambda: pair.session.state()["views"] == 4)
    pair.session.finish()
    wait_until(lambda: pair.state() == "failed")
    assert "at least 12 are needed" in pair.session.state()["message"]
    with pytest.raises(Invalid):
        pair.session.finish()
    pair.hands.missing = True
    pair.session.start(BOARD)
    wait_until(lambda: pair.state() == "failed")
    assert pair.session.state()["message"] == "There is no /dev/video0."
