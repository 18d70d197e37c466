"""The journal: what the box tells of itself after a power cut, and when."""

from __future__ import annotations

import sqlite3
from pathlib import Path

import pytest

from device.clock import Clock
from device.store import Kept, Store


class Boot(Clock):
    """One boot of a box: its own monotonic clock, a date once somebody offers one."""

    def __init__(self, folder: Path, name: str, begun_s: float = 10.0) -> None:
        self.s = begun_s
        super().__init__(folder / "no-machine", lambda: round(self.s * 1e9), lambda: 0)
        self.boot_id = name


MAY_2026_MS = 1_777_600_000_000


def boot(folder: Path, name: str, begun_s: float = 10.0) -> tuple[Store, Boot]:
    clock = Boot(folder, name, begun_s)
    return Store(folder / "data", clock), clock


def test_a_box_that_was_switched_off_was_and_one_that_lost_its_power_is_counted(tmp_path: Path) -> None:
    store, _ = boot(tmp_path, "a")
    assert not store.journal.switched_on().unsafe  # the first time ever
    store.journal.switched_off()
    store.close()
    store, _ = boot(tmp_path, "b")
    assert not store.journal.switched_on().unsafe
    store.close()  # and no more
    store, _ = boot(tmp_path, "c")
    assert store.journal.switched_on().unsafe
    assert store.journal.unsafe_shutdowns() == 1
    store.close()
    store, _ = boot(tmp_path, "d")
    assert store.journal.switched_on().unsafe
    assert store.journal.unsafe_shutdowns() == 2
    assert [entry["what"] for entry in store.journal.entries()] == ["on", "off", "on", "cut", "on", "cut", "on"]


def test_a_drive_of_its_own_that_was_cut_ended_with_what_was_saved(tmp_path: Path) -> None:
    store, clock = boot(tmp_path, "a")
    store.journal.switched_on()
    assert clock.offer(MAY_2026_MS)
    number = store.drives.begin(None, {})
    store.journal.add("begin", number, "pipe_seen", at_s=12.0)
    store.drives.keep(number, Kept(log=[[1, 12.5], [2, 40.0]]))
    clock.s = 43.0
    store.close()
    store, _ = boot(tmp_path, "b", 3.0)
    last = store.journal.switched_on()
    assert (last.unsafe, last.cut) == (True, number)
    *_, end, cut, on = store.journal.entries()
    assert (end["what"], end["survey_id"], end["reason"], end["at_s"], end["boot"]) == ("end", number, "power_cut", 40.0, "a")
    assert end["at"] == "2026-05-01T01:47:10Z"  # the date of its own boot: offered at second 10, 30 s before
    assert (cut["what"], cut["survey_id"], cut["at"], on["boot"]) == ("cut", number, None, "b")
    store.close()
    store, _ = boot(tmp_path, "c")
    assert store.journal.switched_on().cut is None  # once is enough


def test_why_the_last_drive_ended_is_known_after_a_restart(tmp_path: Path) -> None:
    store, _ = boot(tmp_path, "a")
    store.journal.switched_on()
    number = store.drives.begin(None, {})
    store.journal.add("begin", number, "pipe_seen")
    store.journal.add("end", number, "standstill")
    store.close()
    store, _ = boot(tmp_path, "b")
    last = store.journal.switched_on()
    assert (last.unsafe, last.cut, last.reason) == (True, None, "standstill")


def test_what_happened_before_the_date_was_known_is_dated_when_it_is(tmp_path: Path) -> None:
    store, clock = boot(tmp_path, "a", 100.0)
    store.journal.switched_on()
    clock.s = 160.0
    store.journal.add("held", None, "heat", at_s=130.0)
    assert [entry["at"] for entry in store.journal.entries()] == [None, None]
    clock.offer(MAY_2026_MS)
    store.journal.date_this_boot()
    assert [entry["at"] for entry in store.journal.entries()] == ["2026-05-01T01:45:40Z", "2026-05-01T01:46:10Z"]


def test_what_was_looked_at_is_remembered_and_a_deleted_survey_leaves_its_entry(tmp_path: Path) -> None:
    store, _ = boot(tmp_path, "a")
    store.journal.switched_on()
    number = store.drives.begin(None, {})
    store.journal.add("begin", number, "moved")
    assert store.journal.looked_at == 0
    store.journal.look(store.journal.entries()[-1]["id"])
    store.drives.forget(number)
    store.close()
    store, _ = boot(tmp_path, "b")
    assert store.journal.looked_at == 2
    assert [(entry["what"], entry["survey_id"]) for entry in store.journal.entries(after=1)] == [("begin", None)]


def test_the_journal_does_not_grow_for_ever(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("device.store.journal.KEPT", 5)
    for name in "abcdefgh":
        store, _ = boot(tmp_path, name)
        store.journal.switched_on()
        store.journal.switched_off()
        store.close()
    with sqlite3.connect(tmp_path / "data" / "borescout.db") as onlooker:
        assert onlooker.execute("SELECT count(*) FROM journal").fetchone()[0] <= 7
