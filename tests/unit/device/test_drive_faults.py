"""What becomes an event of a drive, and what is the same event still."""

from device.feeds.feed import FeedStatus
from device.feeds.reader import FeedState
from device.landmarks.drive_faults import FaultWatch


def status(state: FeedState, frames: int = 10) -> FeedStatus:
    return FeedStatus(state, age_s=0.1, fps=25.0, frames=frames, drops=0, reconnects=0, bad_frames=0, message="No picture.")


def told(watch: FaultWatch) -> list[str]:
    return [event["what"] for event in watch.untold()]


def test_a_failure_and_a_return_are_two_events() -> None:
    watch = FaultWatch()
    for time_s, state in ((0.0, "up"), (20.0, "lost"), (21.0, "lost"), (24.0, "up"), (60.0, "up")):
        watch.now(time_s, 1.0)
        watch.feed("grabber", status(state))
    assert told(watch) == ["grabber_lost", "grabber_back"]


def test_a_source_that_flaps_is_told_once() -> None:
    watch = FaultWatch()
    for second in range(120):
        watch.now(float(second), 1.0)
        watch.feed("grabber", status("up" if second % 2 else "degraded"))
    assert told(watch) == ["grabber_lost", "grabber_back", "grabber_lost"]


def test_after_a_quiet_time_it_is_told_anew() -> None:
    watch = FaultWatch()
    for time_s, state in ((0.0, "lost"), (1.0, "up"), (2.0, "lost"), (3.0, "up"), (20.0, "up"), (40.0, "lost"), (41.0, "up")):
        watch.now(time_s, 1.0)
        watch.feed("encoder", status(state))
    assert told(watch) == ["encoder_lost", "encoder_back", "encoder_lost", "encoder_lost", "encoder_back"]


def test_a_source_that_only_starts_has_not_failed() -> None:
    watch = FaultWatch()
    watch.now(0.0, None)
    watch.feed("grabber", status("starting", frames=0))
    assert told(watch) == []
