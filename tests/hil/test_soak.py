"""A soak of twenty seconds: surveys, pages and faults at once, and nothing piles up. The long one is ``make soak``."""

from __future__ import annotations

from pathlib import Path

from tests.bench.faulty_box import faulty_box
from tests.bench.soak import Soak


def test_nothing_piles_up(tmp_path: Path) -> None:
    with faulty_box(tmp_path, live_hz=2.0) as box:
        assert box.wait(lambda: box.sensor("camera")["state"] == "up", 60)
        run = Soak(box, minutes=0.35, fault_every_s=5.0, drive_s=5.0).go()
    assert run.alive, box.log.read_text()[-2000:]
    assert run.faults >= 1
    assert run.after["saved"] + run.after.get("failed", 0) >= 1
    first, last = run.samples[0], run.samples[-1]
    assert last.threads <= first.threads + 8, "a thread for the drive under way, the streams, a reader left behind"
    assert last.handles <= first.handles + 8
