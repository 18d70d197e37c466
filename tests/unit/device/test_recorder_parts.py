"""What makes a replay come out the same: order, pictures as recorded, detections as said; and the comparison itself."""

from __future__ import annotations

import itertools
import json
import threading
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from device.diameter.take import Take
from device.errors import Invalid
from device.feeds.tap import Tap
from device.recorder.developing import DevelopingTap
from device.recorder.samples import Picture, picture
from device.replay.compare import differences, plain_json
from device.replay.drive import Again, DriveReplay, SaidThen
from drivers.grabber.base import VideoFrame
from estimators.detections import Detection
from estimators.frame import FrameEstimate, estimate_frame
from tests.unit.device.recorder_samples import depth_frame
from tests.unit.estimators.analytic_scenes import SMALL, cylinder, to_depth
from tests.waiting import wait_until


def frame(number: int) -> VideoFrame:
    image = np.random.default_rng(number).integers(0, 256, (48, 64, 3)).astype(np.uint8)
    return VideoFrame(image, 1000 * number, number, number / 25)


def estimates(*diameters: float) -> list[FrameEstimate]:
    known = estimate_frame(to_depth(cylinder(0.1, SMALL), 0.0, seed=1), SMALL, 0.001)
    assert known.fit is not None
    return [replace(known, fit=replace(known.fit, radius=one / 2)) for one in diameters]


def test_estimates_count_in_the_order_of_their_frames_however_they_come() -> None:
    diameters = (0.2, 0.26, 0.22, 0.23)
    them = estimates(*diameters)
    frames = [depth_frame(number) for number in range(5)]
    jobs = [(frames[k], them[k]) for k in range(4)]
    outcomes = []
    for order in itertools.permutations(range(5)):
        take = Take()
        for index in order:
            take.add(index, None if index == 2 else jobs[index - (index > 2)])
        assert take.kept is not None
        outcomes.append(([one.diameter for one in take.estimates], take.failed, take.kept[0].number))
    assert outcomes == [outcomes[0]] * 120
    assert outcomes[0][:2] == ([pytest.approx(one) for one in diameters], 1)


def test_a_picture_that_may_lose_nothing_loses_nothing() -> None:
    kept = picture(frame(1), lossless=True)
    assert kept.format == "png"
    assert np.array_equal(kept.frame().image, frame(1).image)
    assert picture(frame(1)).format == "jpeg"


def test_a_survey_reads_pictures_as_they_are_recorded() -> None:
    recorded: list[Picture] = []
    closed: list[Tap[VideoFrame]] = []
    tap = DevelopingTap(2, closed.append, recorded.append)
    tap.offer(frame(1))
    tap.offer(frame(2))
    first, second = tap.get(5.0), tap.get(5.0)
    assert first is not None
    assert second is not None
    assert (first.number, second.number, second.media_s) == (1, 2, 2 / 25)
    assert np.array_equal(first.image, recorded[0].frame().image)
    assert not np.array_equal(first.image, frame(1).image)
    assert tap.dropped == 0
    assert tap.get(0.0) is None
    tap.close()
    tap.offer(frame(3))
    assert closed == [tap]
    assert tap.waiting == 0


def test_a_survey_that_is_slow_gets_the_newest_pictures() -> None:
    gate = threading.Event()
    tap = DevelopingTap(2, lambda tap: None, lambda picture: gate.wait(5.0))
    for number in range(6):
        tap.offer(frame(number))
    gate.set()
    wait_until(lambda: tap.dropped + tap.waiting == 6 and not tap._busy)
    got = [one.number for one in iter(lambda: tap.get(0.1), None)]
    assert got == [4, 5]
    assert tap.dropped == 4
    tap.close()


class Always:
    name = "always"

    def __init__(self) -> None:
        self.asked = 0

    def detect(self, frame: VideoFrame) -> tuple[Detection, ...]:
        self.asked += 1
        return (Detection(1.0, 2.0, "roots"),)


def test_a_detector_is_asked_again_only_where_it_looked() -> None:
    then, always = SaidThen("fcdd"), Always()
    again = Again(always, then)
    assert again.detect(frame(1)) is None
    then.said = ()
    assert again.detect(frame(2)) == (Detection(1.0, 2.0, "roots"),)
    assert always.asked == 1
    assert then.detect(frame(2)) == ()


HEAD: dict[str, Any] = {
    "setup": {"focal": [500.0, 500.0], "centre": None, "radius": 0.15, "focal_radius": None, "sparse": False},
    "calibration": None,
    "detector": {"name": "fcdd", "model": "0" * 64},
    "seed": 1,
}


def test_what_this_program_does_not_know_is_told() -> None:
    with pytest.raises(Invalid, match="--recorded-detections"):
        DriveReplay(HEAD, None, recorded_detections=False)
    DriveReplay(HEAD, None, recorded_detections=True).close()
    with pytest.raises(Invalid, match="newer borescout"):
        DriveReplay({**HEAD, "setup": {**HEAD["setup"], "of_tomorrow": 1}}, None, recorded_detections=True)


def told(then: Any, now: Any) -> list[tuple[str, bool]]:
    return [(found.where, found.tolerable) for found in differences(then, now)]


@pytest.mark.parametrize(
    ("then", "now", "expected"),
    [
        ({"a": 1.0}, {"a": 1.0}, []),
        ({"a": 1}, {"a": 1.0}, [("a", True)]),  # not the same bits in a file
        ({"diameter_mm": 200.0}, {"diameter_mm": 200.4}, [("diameter_mm", True)]),
        ({"diameter_mm": 200.0}, {"diameter_mm": 200.6}, [("diameter_mm", False)]),
        ({"interval_mm": [1.0, 2.0]}, {"interval_mm": [1.0, 2.6]}, [("interval_mm[1]", False)]),
        ({"x": {"chainage_m": 3.0}}, {"x": {"chainage_m": 3.019}}, [("x.chainage_m", True)]),
        ({"clock": 3.0}, {"clock": 3.2}, [("clock", False)]),
        ({"score": 0.500}, {"score": 0.505}, [("score", True)]),
        ({"score": 0.5}, {"score": 0.52}, [("score", False)]),
        ({"rows": [1, 2]}, {"rows": [1]}, [("rows", False)]),
        ({"a": None}, {"a": 1.0}, [("a", False)]),
        ({"a": True}, {"a": 1}, [("a", False)]),
        ({"a": "x"}, {"b": "x"}, [("a", False), ("b", False)]),
    ],
)
def test_a_difference_is_told_and_judged(then: Any, now: Any, expected: list[tuple[str, bool]]) -> None:
    assert told(then, now) == expected


json_values = st.recursive(
    st.none() | st.booleans() | st.integers(-5, 5) | st.floats(allow_nan=False, allow_infinity=False) | st.text(max_size=3),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=3), inner, max_size=3),
    max_leaves=10,
)


@given(value=json_values, other=json_values)
def test_equal_is_equal_bit_by_bit(value: Any, other: Any) -> None:
    assert differences(value, plain_json(value)) == []
    assert bool(differences(value, other)) == (json.dumps(value, sort_keys=True) != json.dumps(other, sort_keys=True))
