"""Every way in which a camera fails, and what the feed makes of it."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator

import pytest

from device.feeds.feed import CameraFeed
from device.feeds.reader import FeedTiming
from drivers.base import EndOfRecording
from drivers.depth.base import DepthCamera, DepthFrame
from tests.unit.device.device_doubles import ScriptedCamera, eventually, frame

QUICK = FeedTiming(
    read_s=0.05,
    stale_s=0.15,
    read_limit_s=0.3,
    open_limit_s=0.6,
    faults_before_reopen=3,
    openings_before_reset=2,
    back_off_s=(0.01, 0.02, 0.04),
    repeats_before_frozen=5,
    empty_before_reopen=8,
    abandoned_limit=2,
)


class Made:
    """A feed with its cameras: every one that was made, in order."""

    def __init__(self, *cameras: DepthCamera, recorded: bool = False) -> None:
        self.cameras = list(cameras)
        self.made = 0
        self.changes = 0
        self.feed = CameraFeed("front", "realsense", self._make, recorded=recorded, timing=QUICK, on_change=self._changed)

    def _make(self) -> DepthCamera:
        camera = self.cameras[min(self.made, len(self.cameras) - 1)]
        self.made += 1
        return camera

    def _changed(self) -> None:
        self.changes += 1

    @property
    def state(self) -> str:
        return self.feed.status().state


@pytest.fixture
def closing() -> Iterator[list[Made]]:
    feeds: list[Made] = []
    yield feeds
    for made in feeds:
        for camera in made.cameras:
            if isinstance(camera, ScriptedCamera):
                camera.release.set()
        made.feed.close()


def start(closing: list[Made], *cameras: DepthCamera, recorded: bool = False) -> Made:
    made = Made(*cameras, recorded=recorded)
    closing.append(made)
    made.feed.start()
    return made


def test_good_frames_make_it_up_with_a_young_age(closing: list[Made]) -> None:
    made = start(closing, ScriptedCamera("frame"))
    assert eventually(lambda: made.feed.status().frames > 20)
    status = made.feed.status()
    assert status.state == "up"
    assert status.age_s is not None
    assert status.age_s < 0.3
    assert status.fps > 10
    assert (status.drops, status.reconnects, status.bad_frames, status.message) == (0, 0, 0, "")


def test_before_the_first_frame_it_is_starting_without_an_age(closing: list[Made]) -> None:
    made = start(closing, ScriptedCamera("timeout"))
    assert made.state in ("starting", "degraded")
    assert made.feed.status().age_s is None


def test_a_few_timeouts_do_not_reopen_and_the_camera_goes_on(closing: list[Made]) -> None:
    camera = ScriptedCamera("frame timeout timeout frame")
    made = start(closing, camera)
    assert eventually(lambda: made.feed.status().frames > 10)
    assert camera.calls == ["open"]
    assert made.state == "up"


def test_the_ladder_is_reopen_then_reset_then_tell_the_operator(closing: list[Made]) -> None:
    camera = ScriptedCamera("timeout")
    made = start(closing, camera)
    assert eventually(lambda: "reset" in camera.calls)
    assert camera.calls[: camera.calls.index("reset")].count("open") == QUICK.openings_before_reset
    assert eventually(lambda: made.state == "lost")
    assert made.feed.status().message == "Nothing came."
    opened = camera.calls.count("open")
    assert eventually(lambda: camera.calls.count("open") > opened + 3)  # it never gives up


def test_a_camera_that_comes_back_is_up_again_and_the_reconnect_counted(closing: list[Made]) -> None:
    camera = ScriptedCamera("frame frame lost frame")
    made = start(closing, camera)
    assert eventually(lambda: made.feed.status().reconnects == 1 and made.state == "up")
    assert made.feed.status().frames > 2


def test_a_camera_that_never_comes_is_lost_with_its_sentence_and_retried_quietly(
    closing: list[Made], caplog: pytest.LogCaptureFixture
) -> None:
    camera = ScriptedCamera("frame", missing=10**9)
    made = start(closing, camera)
    assert eventually(lambda: camera.calls.count("open") > 8)
    assert made.state == "lost"
    assert made.feed.status().message == "No camera is plugged in."
    assert sum("No camera is plugged in" in record.message for record in caplog.records) == 1


def test_a_camera_that_comes_late_is_taken(closing: list[Made]) -> None:
    made = start(closing, ScriptedCamera("frame", missing=4))
    assert eventually(lambda: made.state == "up")


def test_retries_are_paced(closing: list[Made]) -> None:
    camera = ScriptedCamera("frame", missing=10**9)
    start(closing, camera)
    time.sleep(0.5)
    assert camera.calls.count("open") <= 0.5 / QUICK.back_off_s[-1] + len(QUICK.back_off_s) + 2


def test_pictures_of_the_wrong_size_are_counted_and_lead_to_reopening(closing: list[Made]) -> None:
    camera = ScriptedCamera("frame bad bad bad frame")
    made = start(closing, camera)
    assert eventually(lambda: made.feed.status().reconnects == 1 and made.state == "up")
    assert made.feed.status().bad_frames == 3


def test_a_frozen_camera_is_not_shown_as_live_and_is_reset_when_reopening_does_not_help(closing: list[Made]) -> None:
    camera = ScriptedCamera("frame freeze")
    made = start(closing, camera)
    assert eventually(lambda: "reset" in camera.calls)
    status = made.feed.status()
    assert status.frames == 2  # the last live one, and the first of the still ones that could not be told from it
    assert status.bad_frames >= QUICK.repeats_before_frozen
    assert "same picture again and again" in status.message
    assert eventually(lambda: (made.feed.status().age_s or 0) > 0.3)


def test_empty_pictures_are_told_with_their_remedy_and_do_not_count_as_good(closing: list[Made]) -> None:
    made = start(closing, ScriptedCamera("frame empty"))
    assert eventually(lambda: "window covered" in made.feed.status().message)
    status = made.feed.status()
    assert status.state == "degraded"
    assert status.frames == 1
    assert status.bad_frames >= QUICK.empty_before_reopen


def test_a_recording_may_stand_still_and_be_empty(closing: list[Made]) -> None:
    camera = ScriptedCamera("frame freeze freeze freeze freeze freeze freeze freeze freeze empty")
    made = start(closing, camera, recorded=True)
    assert eventually(lambda: made.feed.status().frames > 30)
    assert made.state == "up"
    assert camera.calls == ["open"]


def test_broken_pictures_of_a_recording_are_counted_and_passed_over(closing: list[Made]) -> None:
    camera = ScriptedCamera("frame broken broken broken broken frame")
    made = start(closing, camera, recorded=True)
    assert eventually(lambda: made.feed.status().frames > 5)
    assert made.feed.status().bad_frames == 4
    assert camera.calls == ["open"]


def test_a_driver_that_crashes_costs_a_reopening_and_a_sentence_not_a_trace(closing: list[Made]) -> None:
    camera = ScriptedCamera("crash crash crash crash crash frame")
    made = start(closing, camera)
    assert eventually(lambda: made.state == "up")
    assert made.feed.status().reconnects == 5


def test_the_sentence_never_is_the_drivers_exception(closing: list[Made]) -> None:
    made = start(closing, ScriptedCamera("crash"))
    assert eventually(lambda: made.state == "lost")
    assert "segmentation" not in made.feed.status().message


def test_a_call_that_never_returns_is_left_behind_and_a_new_camera_made(closing: list[Made]) -> None:
    stuck, fresh = ScriptedCamera("frame stuck"), ScriptedCamera("frame")
    made = start(closing, stuck, fresh)
    assert eventually(lambda: made.feed.status().frames > 20)
    assert made.state == "up"
    assert made.made == 2
    stuck.release.set()  # back after all: it closes its own camera and touches nothing else
    assert eventually(lambda: stuck.calls[-1] == "close")
    assert made.state == "up"
    assert fresh.calls == ["open"]


def test_threads_left_behind_are_bounded(closing: list[Made]) -> None:
    before = threading.active_count()
    stuck = ScriptedCamera("stuck")
    made = start(closing, stuck)
    time.sleep(3.0)
    assert made.made == 1 + QUICK.abandoned_limit
    assert made.state == "lost"
    assert "unplug it" in made.feed.status().message
    assert threading.active_count() - before <= 2 + QUICK.abandoned_limit
    stuck.release.set()
    assert eventually(lambda: made.feed.status().message == "Back from the dead.")  # the last one goes on trying
    assert eventually(lambda: threading.active_count() - before <= 2)  # the others have ended


def test_closing_does_not_wait_for_a_stuck_call(closing: list[Made]) -> None:
    made = start(closing, ScriptedCamera("frame stuck"))
    assert eventually(lambda: made.feed.status().frames == 1)
    begun = time.monotonic()
    made.feed.close(wait_s=0.2)
    assert time.monotonic() - begun < 2.0


def test_closing_closes_the_camera(closing: list[Made]) -> None:
    camera = ScriptedCamera("frame")
    made = start(closing, camera)
    assert eventually(lambda: made.state == "up")
    made.feed.close()
    made.feed.close()
    assert camera.calls == ["open", "close"]


def test_gaps_in_the_sensors_count_are_drops(closing: list[Made]) -> None:
    made = start(closing, ScriptedCamera("frame skip frame"))
    assert eventually(lambda: made.feed.status().frames > 5)
    assert made.feed.status().drops == 4


def test_a_slow_consumer_gets_the_newest_frames_and_the_drops_are_counted(closing: list[Made]) -> None:
    made = start(closing, ScriptedCamera("frame"))
    tap = made.feed.tap(3)
    assert eventually(lambda: made.feed.status().frames > 30)
    latest = made.feed.latest
    assert latest is not None
    taken = tap.get(1.0)
    assert taken is not None
    assert latest.number - taken.number <= 3
    assert made.feed.status().drops > 20
    tap.close()
    drops = made.feed.status().drops
    time.sleep(0.1)
    assert made.feed.status().drops == drops  # nobody listens, nothing is missed
    assert tap.get(0.0) is None


def test_the_age_grows_when_nothing_comes_even_inside_one_long_read(closing: list[Made]) -> None:
    made = start(closing, ScriptedCamera("frame stuck"))
    assert eventually(lambda: made.state == "degraded", 3.0)
    assert eventually(lambda: made.state == "lost")


class Short(DepthCamera):
    """A recording of twenty frames."""

    name = "recording"

    def _open(self) -> None:
        self.left = 20

    def _read(self, timeout_s: float) -> DepthFrame:
        if self.left == 0:
            raise EndOfRecording("The recording has been played to its end.")
        self.left -= 1
        return frame(20 - self.left)

    def close(self) -> None: ...


def test_a_recording_played_to_its_end_begins_again(closing: list[Made]) -> None:
    made = start(closing, Short(), recorded=True)
    assert eventually(lambda: made.feed.status().frames >= 50)
    assert made.feed.status().reconnects >= 2


def test_changes_of_state_are_told_once(closing: list[Made]) -> None:
    made = start(closing, ScriptedCamera("frame"))
    assert eventually(lambda: made.feed.status().frames > 20)
    assert made.changes == 1
