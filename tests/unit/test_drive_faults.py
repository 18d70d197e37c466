"""Events of a drive: each fault once, with its moment, and not again while it lasts."""

from __future__ import annotations

from device.feed import FeedStatus
from device.surveys.drive_faults import FaultWatch


def status(state: str, message: str = "", frames: int = 9) -> FeedStatus:
    return FeedStatus(state, 0.1, 25.0, frames, 0, 0, 0, message)  # type: ignore[arg-type] # a state by its name


def test_a_stream_that_dies_and_returns_is_two_events() -> None:
    watch = FaultWatch()
    for moment, state in ((0.0, "up"), (1.0, "degraded"), (1.2, "lost"), (3.5, "up"), (3.6, "up")):
        watch.now(moment, 2.0 * moment)
        watch.feed("grabber", status(state, "No signal."))
    lost, back = watch.untold()
    assert (lost["time_s"], lost["chainage_m"], lost["what"]) == (1.0, 2.0, "grabber_lost")
    assert lost["text"] == "The CCTV picture failed: No signal."
    assert (back["what"], back["text"]) == ("grabber_back", "The CCTV picture is back after 2.5 s.")
    assert watch.untold() == []


def test_a_source_that_only_wakes_is_no_fault() -> None:
    watch = FaultWatch()
    watch.now(0.0, None)
    watch.feed("grabber", status("starting", "It is being started.", frames=0))
    assert watch.untold() == []


def test_each_jump_is_told_once() -> None:
    watch = FaultWatch()
    watch.now(4.0, 1.0)
    watch.jumps([(3.9, -1.5)])
    watch.now(8.0, 1.5)
    watch.jumps([(3.9, -1.5), (7.9, 0.8)])
    assert [(event["time_s"], event["what"]) for event in watch.untold()] == [(4.0, "encoder_jump"), (8.0, "encoder_jump")]


def test_a_prompt_is_an_event_once_it_lasts_and_flicker_is_one_event() -> None:
    watch = FaultWatch()
    for tick in range(100):  # 10 s, the prompt comes and goes every half second
        watch.now(tick / 10, None)
        watch.codes(["too_dark"] if tick // 5 % 2 else [])
    assert [event["what"] for event in watch.untold()] == ["too_dark"]
    watch.now(30.0, None)
    watch.codes(["too_dark"])
    assert watch.untold() == []  # it has not lasted yet
    watch.now(31.0, None)
    watch.codes(["too_dark"])
    assert [event["what"] for event in watch.untold()] == ["too_dark"]


def test_what_is_kept_is_counted_apart_from_what_is_told() -> None:
    watch = FaultWatch()
    watch.now(0.0, None)
    watch.jumps([(0.0, 1.0)])
    watch.untold()
    assert len(watch.unkept()) == 1  # the disk was full
    assert len(watch.unkept()) == 1
    watch.were_kept(1)
    assert watch.unkept() == []
