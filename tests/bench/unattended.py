"""A box left alone: a virtual drive through five pipes with halts, darkness, two power cuts and a nearly full disk.

The box is a process of its own that is killed like a power cut and started again; the sewer's clock runs on meanwhile, some
times as fast as ours. What the box's journal says is compared with what was so.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from device.clock import Clock
from device.store import Store
from tests.bench.table import print_table
from tests.crash import shim
from tests.hil.unattended_rig import TOURS, Tour

MB = 1_000_000
GRACE_S = 5.0


@dataclass(frozen=True)
class Part:
    """A drive as the journal has it (seconds of the tour)."""

    survey_id: int
    begin_s: float
    end_s: float
    reason: str
    continues: int | None
    landmarks: int
    state: str


def drive(
    folder: Path, tour: str, scale: float, cuts: list[tuple[float, float]], room_mb: int | None = None
) -> tuple[list[Part], list[dict[str, Any]]]:
    """Leave the box alone for the whole tour; the power goes at each of ``cuts`` (second of the tour, for so long). With
    ``room_mb`` the disk has so much left."""
    data = folder / "data"
    data.mkdir(parents=True, exist_ok=True)
    command = [sys.executable, "-m", "tests.hil.unattended_rig", str(data), "--tour", tour, "--scale", str(scale)]
    for cut in cuts:
        command += ["--cut", *map(str, cut)]
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    if room_mb is not None:
        command += ["--room", str(room_mb * MB)]
        environment = shim.environment(shim.build(folder), data, None)
    subprocess.run(command, cwd=shim.ROOT, env=environment, check=True)
    return read(data)


def read(data: Path) -> tuple[list[Part], list[dict[str, Any]]]:
    """The drives of the journal, and the journal."""
    store = Store(data, Clock(data / "no-machine"))
    try:
        entries = store.journal.entries()
        begun: dict[int, dict[str, Any]] = {}
        parts = []
        for entry in entries:
            if entry["what"] == "begin":
                begun[entry["survey_id"]] = entry
            elif entry["what"] == "end":
                number = entry["survey_id"]
                found = store.drives.map(number)
                parts.append(
                    Part(
                        number,
                        begun[number]["at_s"],
                        entry["at_s"],
                        entry["reason"],
                        found["settings"].get("continues"),
                        len(found["landmarks"]),
                        found["state"],
                    )
                )
        return parts, entries
    finally:
        store.close()


@dataclass(frozen=True)
class Row:
    """One pipe: what was so, what the box made of it."""

    pipe: int
    truth: tuple[float, float]
    parts: tuple[Part, ...]
    begin_off_s: float | None
    end_off_s: float | None


def compare(tour: Tour, parts: list[Part], entries: list[dict[str, Any]]) -> tuple[list[Row], list[Part]]:
    """Each pipe with its survey, and the surveys that belong to none. A survey that was cut goes on in the one that continues
    it; a box that had no power when a pipe came into view can begin only once it is back."""
    rows, used = [], set[int]()
    back_s = [entry["at_s"] for entry in entries if entry["what"] == "on"]
    for number, (begin, end) in tour.pipes().items():
        heads = [p for p in parts if p.continues is None and p.survey_id not in used and _overlap(p, begin, end) > 0]
        chain: list[Part] = heads[:1]
        while chain and (following := next((p for p in parts if p.continues == chain[-1].survey_id), None)) is not None:
            chain.append(following)
        used |= {p.survey_id for p in chain}
        could = min((s for s in back_s if begin < s < end and not _powered(begin, entries)), default=begin)
        rows.append(
            Row(
                number,
                (begin, end),
                tuple(chain),
                chain[0].begin_s - could if chain else None,
                chain[-1].end_s - end if chain else None,
            )
        )
    return rows, [p for p in parts if p.survey_id not in used]


def _overlap(part: Part, begin: float, end: float) -> float:
    return min(part.end_s, end) - max(part.begin_s, begin)


def _powered(at_s: float, entries: list[dict[str, Any]]) -> bool:
    """Whether the box was on: it was switched on before, and nothing was cut since."""
    last = [entry["what"] for entry in entries if entry["what"] in ("on", "off") and entry["at_s"] <= at_s]
    return bool(last) and last[-1] == "on"


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.bench.unattended", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--tour", choices=sorted(TOURS), default="five")
    parser.add_argument("--scale", type=float, default=4.0, help="at most so many times as fast as ours the sewer's clock runs")
    parser.add_argument("--room", type=int, default=80, help="MB left on the disk that is played; 0 for the real disk")
    parser.add_argument("--keep", type=Path, help="keep what the box wrote in this folder")
    given = parser.parse_args()
    tour = TOURS[given.tour]()
    pipes = tour.pipes()
    numbers = sorted(pipes)
    cuts = [(sum(pipes[number]) / 2, 4.0) for number in (numbers[1], numbers[-1])]
    room = given.room if given.room and not shim.missing() else None
    with tempfile.TemporaryDirectory(prefix="unattended-") as scratch:
        folder = given.keep or Path(scratch)
        parts, entries = drive(folder, given.tour, given.scale, cuts, room)
        made = {int(path.name.split("-")[1]) for path in (folder / "data").rglob("*.mcap")}
        written = sum(path.stat().st_size for path in (folder / "data").rglob("*") if path.is_file())
    rows, invented = compare(tour, parts, entries)
    print(f"{tour.length_s:.0f} s of a virtual drive at {given.scale:g} times its pace; power cut at", end=" ")
    print(" and ".join(f"{at:.0f} s" for at, _ in cuts), end=f"; {room or 'as many as there are'} MB on the disk, ")
    print(f"{written / MB:.0f} MB written at the end")
    print_table(
        "Pipes and their surveys (seconds of the drive)",
        ("pipe", "from", "to", "surveys", "begin off", "end off", "why ended", "landmarks", "of"),
        [
            (
                row.pipe,
                f"{row.truth[0]:.0f}",
                f"{row.truth[1]:.0f}",
                " + ".join(str(part.survey_id) for part in row.parts) or "none",
                "-" if row.begin_off_s is None else f"{row.begin_off_s:+.1f}",
                "-" if row.end_off_s is None else f"{row.end_off_s:+.1f}",
                ", ".join(part.reason for part in row.parts),
                sum(part.landmarks for part in row.parts),
                len(tour.things(row.pipe)),
            )
            for row in rows
        ],
    )
    worst = max((abs(off) for row in rows for off in (row.begin_off_s, row.end_off_s) if off is not None), default=0.0)
    lost = sum(not row.parts for row in rows)
    print(f"\nsurveys: {len(rows) - lost} of {len(rows)}, lost {lost}, invented {len(invented)}; worst boundary {worst:.1f} s")
    print(f"raw data left on the disk: of survey {', '.join(map(str, sorted(made))) or 'none'}")
    print(f"unsafe shutdowns counted: {sum(entry['what'] == 'cut' for entry in entries)} of {len(cuts)}")
    for part in invented:
        print(f"  invented: survey {part.survey_id}, {part.begin_s:.1f} to {part.end_s:.1f} s, {part.reason}")
    if given.keep is None:
        shutil.rmtree(scratch, ignore_errors=True)


if __name__ == "__main__":
    main()
