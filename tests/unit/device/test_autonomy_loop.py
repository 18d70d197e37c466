"""The loop around the rules, turned by hand, on surveys that only note what they are told."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from device.autonomy.loop import Unattended, sentence
from device.autonomy.machine import Condition, Rules
from device.clock import Clock
from device.errors import StorageFull
from device.landmarks.crawler import Crawler
from device.store import Store
from device.store.journal import LastTime
from tests.unit.device.test_store import result


class Steered(Clock):
    """Shows what a test sets."""

    def __init__(self, folder: Path) -> None:
        self.s = 100.0
        super().__init__(folder / "no-machine", lambda: round(self.s * 1e9), lambda: 0)


class NoDrive:
    """A box without a crawler."""

    available = False


class Live:
    """What the aim says."""

    level = "none"

    def newest(self) -> dict[str, Any] | None:
        return {"level": self.level}


class Diameter:
    """Measures at once, or refuses."""

    def __init__(self, store: Store) -> None:
        self.busy = False
        self.refuses: Exception | None = None
        self.verdict = "retry"
        self._store = store

    def start(self, pipe_id: int | None, position: str | None, frames: int, survey_id: int | None) -> int:
        if self.refuses is not None:
            raise self.refuses
        number = self._store.surveys.begin("diameter", None)
        self._store.surveys.conclude(number, "saved", [], result(verdict=self.verdict))
        return number


class Box:
    """A loop with everything around it."""

    def __init__(self, folder: Path, last_time: LastTime | None = None, enabled: bool = True) -> None:
        self.clock = Steered(folder)
        self.store = Store(folder / "data", self.clock)
        self.live, self.diameter = Live(), Diameter(self.store)
        self.condition = Condition()
        self.loop = Unattended(
            self.store,
            self.clock,
            Crawler(),
            NoDrive(),  # type: ignore[arg-type]  # all that is asked of it
            self.diameter,  # type: ignore[arg-type]
            self.live,  # type: ignore[arg-type]
            lambda: self.condition,
            enabled=enabled,
        )

    def turn(self, seconds: float) -> None:
        """So long, a turn each half second."""
        for _ in range(round(seconds / 0.5)):
            self.clock.s += 0.5
            self.loop._look()

    @property
    def journal(self) -> list[tuple[str, int | None, str]]:
        return [(entry["what"], entry["survey_id"], entry["reason"]) for entry in self.store.journal.entries()]


@pytest.fixture
def box(tmp_path: Path) -> Iterator[Box]:
    made = Box(tmp_path)
    yield made
    made.store.close()


def test_a_pipe_in_view_is_measured_until_a_measurement_is_accepted(box: Box) -> None:
    box.turn(10)
    assert box.journal == []
    box.live.level = "good"
    box.turn(10)
    assert box.journal == [("measure", 1, "pipe_seen")]
    box.diameter.verdict = "accept"
    box.turn(60)  # the first was refused: once more, and no more once one is accepted
    assert [what for what, _, _ in box.journal] == ["measure", "measure"]
    assert box.loop.state()["news"] == 2
    box.loop.looked(2)
    assert box.loop.state()["news"] == 0


def test_a_measurement_that_cannot_begin_is_no_entry_and_is_tried_again(box: Box) -> None:
    box.diameter.refuses = StorageFull("There is no room.")
    box.live.level = "fair"
    box.turn(10)
    assert box.journal == []
    box.diameter.refuses = None
    box.turn(Rules().again_s + 5)
    assert [what for what, _, _ in box.journal] == ["measure"]


def test_a_box_in_trouble_measures_nothing_and_says_why(box: Box) -> None:
    box.condition = Condition(too_hot=True)
    box.live.level = "good"
    box.turn(30)
    assert box.journal == [("held", None, "heat")]
    assert (box.loop.state()["state"], box.loop.state()["holds"]) == ("held", ["The box was too hot."])
    box.condition = Condition()
    box.turn(10)
    assert [what for what, _, _ in box.journal] == ["held", "released", "measure"]


def test_the_last_word_on_the_page_counts_more_than_the_settings(tmp_path: Path) -> None:
    box = Box(tmp_path, enabled=False)
    box.live.level = "good"
    box.turn(10)
    assert (box.journal, box.loop.state()["state"]) == ([], "off")
    box.loop.switch(True)
    box.turn(10)
    assert len(box.journal) == 1
    box.store.close()
    assert Box(tmp_path, enabled=False).loop.state()["on"]


def test_every_entry_has_a_sentence(box: Box) -> None:
    box.store.journal.add("begin", None, "pipe_seen")
    box.store.journal.add("held", None, "disk")
    box.store.journal.add("off")
    told = [sentence(entry) for entry in box.store.journal.entries()]
    assert told == [
        "Survey (deleted) began. A pipe came into view.",
        "No survey was begun any more. The disk was nearly full.",
        "The box was switched off.",
    ]
