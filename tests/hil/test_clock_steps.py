"""The wall clock jumps by a year, there and back, in the middle of a drive: nobody measures by it."""

from __future__ import annotations

import ast
import time
from pathlib import Path
from typing import Any

import pytest

from device.clock import iso
from device.replay.survey import replay
from tests.hil.crawler_rig import Bench
from tests.hil.test_drive import THINGS, check, end, parked
from tests.unit.test_house import ROOT, sources

YEAR_NS = 365 * 86_400 * 10**9
WALL_CLOCKS = {"time", "time_ns", "localtime", "gmtime", "ctime", "now", "utcnow", "today"}


class Restless:
    """The system's clock: a year ahead or behind, another one with each look."""

    def __init__(self) -> None:
        self._real = time.time_ns
        self.looks = 0

    def __call__(self) -> int:
        self.looks += 1
        return self._real() + (YEAR_NS if self.looks % 2 else -YEAR_NS)


def drive(folder: Path) -> tuple[dict[str, Any], dict[str, Any]]:
    """A drive past a landmark, with the browser's clock a year off, now ahead and now behind; its map and its survey."""
    things = THINGS[:1]
    box = parked(lambda **options: Bench(folder, things, **options).up())
    try:
        box.device.set_clock(1_790_000_000_000)
        survey_id = box.device.drive.begin(radius_m=0.15)["survey_id"]
        box.moving = True
        for k, metres in enumerate((0.5, 1.0, 1.5, 2.0)):
            box.drive_to(metres)
            box.device.set_clock(1_790_000_000_000 + (1 if k % 2 else -1) * YEAR_NS // 10**6)
        box.drive_to(2.4)
        found = end(box, survey_id)
        return found, box.device.survey(survey_id)
    finally:
        box.close()


def test_a_year_either_way_changes_no_result(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    restless = Restless()
    monkeypatch.setattr("time.time_ns", restless)
    monkeypatch.setattr("time.time", lambda: restless() / 1e9)
    stepped, survey = drive(tmp_path / "stepped")
    assert restless.looks > 0, "somebody asks for the date, which is what this is about"
    check(stepped, 0.0, THINGS[:1])
    monkeypatch.undo()
    (recorded,) = (tmp_path / "stepped" / "recordings").glob("*.mcap")
    again = replay(recorded)
    assert again.equal, "under a steady clock the same pictures come to the same map"
    assert again.exact
    assert 0 < stepped["seconds"] < 300, "it took what it took, not a year"
    assert survey["created"] == iso(1_790_000_000_000), "it was begun when it was begun"


def test_only_the_clock_looks_at_the_wall_clock() -> None:
    for room in ("device", "drivers", "estimators", "web_ui"):
        for path in sources(room):
            if path == ROOT / "device/clock.py":
                continue
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
                    named = (node.value.id, node.attr)
                    assert not (named[0] in ("time", "datetime", "date") and named[1] in WALL_CLOCKS), f"{path}: {named}"
