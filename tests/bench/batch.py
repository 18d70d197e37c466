"""An archive: 50 recordings, 5 of them broken, killed and resumed twice; the gain of a second worker; the plan for a city.

python -m tests.bench.batch                 all of it
python -m tests.bench.batch --recordings 12 a quick look
"""

from __future__ import annotations

import argparse
import json
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from tests.archive import BROKEN, make_archive
from tests.bench.table import print_table

CITY_KM = 10_000
METRES = 6.0
COMMAND = [sys.executable, "-m", "device.cli", "batch"]


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--recordings", type=int, default=50)
    parser.add_argument("--scaling", type=int, default=8, help="recordings of the comparison of 1 and 2 workers")
    wanted = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="borescout-batch-") as folder:
        killed(Path(folder), wanted.recordings)
        scaling(Path(folder), wanted.scaling)


def killed(folder: Path, recordings: int) -> None:
    """Convert, killed twice on the way."""
    names = make_archive(folder / "in", recordings - len(BROKEN), len(BROKEN), METRES)
    out = folder / "out"
    rows = []
    for turn, share in enumerate((0.3, 0.65), 1):
        process = subprocess.Popen([*COMMAND, str(folder / "in"), "--out", str(out), "--json"], stdout=subprocess.DEVNULL)
        while len(list(out.glob("rows/*.json"))) < share * len(names) and process.poll() is None:
            time.sleep(0.1)
        process.send_signal(signal.SIGKILL)
        process.wait()
        rows.append((f"killed, {turn}", len(list(out.glob("rows/*.json")))))
    ended = subprocess.run([*COMMAND, str(folder / "in"), "--out", str(out), "--json"], capture_output=True, text=True)
    stated = [json.loads(line) for line in ended.stdout.splitlines()]
    good = [row for row in stated if row["ok"]]
    rows.append(("resumed to the end", len(stated)))
    print_table(f"{len(names)} recordings of {METRES:g} m, {len(BROKEN)} of them broken", ("", "results on the disk"), rows)
    each_once = sorted(row["input"] for row in stated) == sorted(names)
    print(f"  {len(good)} results, each once: {'yes' if each_once else 'NO'}; {len(stated) - len(good)} failures with reasons:")
    for row in stated:
        if not row["ok"]:
            print(f"    {row['input']}: {row['error']}")


def scaling(folder: Path, recordings: int) -> None:
    """Seconds with one and with two workers, and what that means for a city."""
    make_archive(folder / "scaling", recordings, 0, METRES)
    seconds = {}
    for workers in (1, 2):
        began = time.perf_counter()
        out = folder / f"out{workers}"
        subprocess.run(
            [*COMMAND, str(folder / "scaling"), "--out", str(out), "--workers", str(workers)],
            check=True,
            stdout=subprocess.DEVNULL,
        )
        seconds[workers] = time.perf_counter() - began
    speed = recordings * METRES / seconds[2]
    rows = [(n, f"{s:.1f}", f"{recordings * METRES / s:.2f}", f"{seconds[1] / s:.2f}") for n, s in seconds.items()]
    title = f"{recordings} recordings of {METRES:g} m"
    print_table(title, ("workers", "s", "metres of pipe a second", "times one worker"), rows)
    per_worker = speed / 2
    print(f"  a city of {CITY_KM} km at {per_worker:.2f} m/s and worker, from detections at {2:g} frames a second:")
    for workers in (2, 16, 64):
        print(f"    {workers:3d} workers: {CITY_KM * 1000 / (per_worker * workers) / 86400:.1f} days")
    print("  videos cost their detector too: python -m tests.bench.drive_cost --network says how many frames a second it takes")


if __name__ == "__main__":
    main()
