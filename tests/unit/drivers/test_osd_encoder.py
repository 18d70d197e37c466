"""The burned-in distance as an encoder, the series of a recording, and the verdict on a video without distance."""

from __future__ import annotations

import threading
from collections.abc import Iterator

import numpy as np
import pytest
from numpy.typing import NDArray

from drivers.base import BadFrame, FrameTimeout
from drivers.encoder.osd import NoDistance, OsdEncoder, OsdReader, OsdText, read_series, require_distance
from drivers.grabber.base import VideoFrame
from tests.unit.drivers.osd_pictures import as_read, burn, wall


class Scripted(OsdReader):
    """A reader that finds a given text in picture number n, without OCR: for what comes after the reading."""

    def __init__(self, texts: list[str]) -> None:
        self.searches, self.lines, self._region = 0, (), None
        self.texts = texts

    def read(self, image: NDArray[np.uint8], patient: bool = True) -> OsdText:
        return as_read(self.texts[int(image[0, 0, 0])])


def frame(number: int, time_s: float | None = None) -> VideoFrame:
    image = np.full((4, 4, 3), number, dtype=np.uint8)
    return VideoFrame(image, 1_000_000 * number, number, media_s=float(number) if time_s is None else time_s, source="run.mp4")


def opened(texts: list[str]) -> OsdEncoder:
    encoder = OsdEncoder(Scripted(texts))
    encoder.open()
    return encoder


def test_a_picture_that_is_fed_gives_a_reading_in_metres_at_its_time() -> None:
    encoder = opened(["0007.0", "0007.2"])
    encoder.feed(frame(0))
    encoder.read()
    encoder.feed(frame(1))
    reading = encoder.read()
    assert (reading.value, reading.unit, reading.quantum) == (7.2, "m", pytest.approx(0.1))
    assert (reading.media_s, reading.monotonic_ns, reading.time_s) == (1.0, 1_000_000, 1.0)


def test_without_a_picture_it_times_out() -> None:
    encoder = opened(["0007.0"])
    with pytest.raises(FrameTimeout, match="given no picture"):
        encoder.read(timeout_s=0.01)
    encoder.feed(frame(0))
    encoder.read(timeout_s=0.01)
    with pytest.raises(FrameTimeout):
        encoder.read(timeout_s=0.01)


def test_it_waits_for_a_picture_from_another_thread() -> None:
    encoder = opened(["0007.0"])
    feeder = threading.Timer(0.05, encoder.feed, [frame(0)])
    feeder.start()
    assert encoder.read(timeout_s=10.0).value == 7.0
    feeder.join()


def test_the_newest_picture_wins_and_the_others_are_counted() -> None:
    encoder = opened(["0007.0", "0007.1", "0007.2"])
    for number in range(3):
        encoder.feed(frame(number))
    assert encoder.read().value == 7.2
    assert encoder.dropped == 2


def test_pictures_without_a_believable_distance_are_rejected_and_counted() -> None:
    encoder = opened(["0007.0", "WATER LEVEL", "0055.5", "0007.3"])
    encoder.feed(frame(0))
    encoder.read()
    for number, sentence in ((1, '"WATER LEVEL" .* is no distance'), (2, '"0055.5" .* does not follow')):
        encoder.feed(frame(number))
        with pytest.raises(BadFrame, match=sentence):
            encoder.read()
    encoder.feed(frame(3))
    assert encoder.read().value == 7.3
    assert encoder.rejected == 2


def test_a_picture_older_than_the_last_is_rejected() -> None:
    encoder = opened(["0007.0", "0007.1"])
    encoder.feed(frame(0, time_s=5.0))
    encoder.read()
    encoder.feed(frame(1, time_s=4.0))
    with pytest.raises(BadFrame, match="came after"):
        encoder.read()


def test_a_reset_by_the_operator_is_told() -> None:
    texts = ["0013.8"] * 5 + ["0000.0"] * 6
    encoder = opened(texts)
    values = []
    for number in range(len(texts)):
        encoder.feed(frame(number))
        try:
            values.append(encoder.read().value)
        except BadFrame:
            values.append(-1.0)
    assert values == [13.8] * 5 + [-1.0] * 3 + [0.0] * 3
    (reset,) = encoder.resets
    assert (reset.before, reset.after, reset.time_s) == (13.8, 0.0, 5.0)
    assert encoder.notice == "The counter leapt from 13.80 m to 0.00 m at 5.0 s."


def test_a_leap_away_from_a_first_reading_that_was_given_is_told_too() -> None:
    encoder = opened(["0055.5", "0007.0", "0007.0"])
    encoder.feed(frame(0))
    assert encoder.read().value == 55.5
    encoder.feed(frame(1))
    with pytest.raises(BadFrame, match="does not follow"):
        encoder.read()
    encoder.feed(frame(2))
    assert encoder.read().value == 7.0
    assert [(reset.before, reset.after) for reset in encoder.resets] == [(55.5, 7.0)]


def test_opening_again_starts_anew() -> None:
    encoder = opened(["0007.0", "WATER"])
    encoder.feed(frame(0))
    encoder.read()
    encoder.feed(frame(1))
    encoder.close()
    encoder.close()
    encoder.open()
    with pytest.raises(FrameTimeout):
        encoder.read(timeout_s=0.01)
    encoder.feed(frame(0))
    assert encoder.read().value == 7.0
    assert encoder.rejected == 0


def test_a_recording_is_decided_with_what_comes_after() -> None:
    texts = ["0013.8", "0013.9", "8014.0", "0014.1", "CRACK", *["0000.0"] * 6]
    series = read_series((frame(number) for number in range(len(texts))), Scripted(texts))
    assert [one.status for one in series.told] == ["read", "read", "repaired", "read", "missing", *["read"] * 6]
    assert [reading.value for reading in series.readings] == pytest.approx([13.8, 13.9, 14.0, 14.1, *[0.0] * 6])
    assert [reading.media_s for reading in series.readings] == [0, 1, 2, 3, 5, 6, 7, 8, 9, 10]
    assert [reset.time_s for reset in series.resets] == [5.0]


def test_a_recording_without_pictures_has_no_distances() -> None:
    series = read_series([], Scripted([]))
    assert (series.told, series.readings, series.resets) == ((), (), ())


def video(*texts: str) -> Iterator[VideoFrame]:
    """Real pictures with these lines, one each."""
    for number, text in enumerate(texts):
        image = burn(wall(seed=1), text, (30, 255), boxed=True) if text else wall(seed=1)
        yield VideoFrame(image, number, number, media_s=float(number), source="run.mp4")


def test_a_video_with_distances_is_accepted() -> None:
    assert require_distance(video("0007.0", "0007.1", "", "0007.3"), OsdReader(), look_at=4) == 0.75


def test_a_video_without_text_is_rejected() -> None:
    with pytest.raises(NoDistance) as error:
        require_distance(video("", "美"), OsdReader())  # what OCR makes of stains
    assert str(error.value) == (
        "No distance can be read in the video run.mp4: looked anywhere in the picture in the first 2 pictures, "
        "none of them shows text. Give the place of the distance with --osd X,Y,W,H, or the distances with --distance-csv FILE."
    )


def test_a_video_with_other_text_is_rejected_with_what_was_seen() -> None:
    with pytest.raises(NoDistance, match=r'first 3 pictures, 2 of them show text, such as "WATER ?LEVEL", but none') as error:
        require_distance(video("WATER LEVEL", "", "WATER LEVEL"), OsdReader())
    assert "--distance-csv" in str(error.value)


def test_a_video_with_too_few_distances_is_rejected_with_where_it_looked() -> None:
    reader = OsdReader(region=(0, 200, 400, 88))
    with pytest.raises(NoDistance, match=r"in the region 0,200,400,88 in the first 4 pictures, only 1 of them show a distance"):
        require_distance(video("0007.0", "CRACK", "", "CRACK"), reader)


def test_a_video_without_pictures_is_rejected() -> None:
    with pytest.raises(NoDistance, match="it has no pictures"):
        require_distance([], Scripted([]))
