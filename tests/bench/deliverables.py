"""What taking an inspection home costs: each format, beside a baseline, and the page's answers meanwhile.

python -m tests.bench.deliverables          a demo inspection, and one of 100 m with as much in it
"""

from __future__ import annotations

import argparse
import http.client
import logging
import statistics
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from datetime import date
from pathlib import Path

import numpy as np
from werkzeug.serving import make_server

from device.clock import Clock
from device.export.base import Options
from device.export.formats import FORMATS, export
from device.inspections.assemble import assemble
from device.inspections.coding import observations
from device.inspections.demo import LENGTH_M, demo_inspection
from device.inspections.model import Inspection, Photo
from device.store import Store
from tests.bench.table import print_table

ROUNDS = 5
LIMITS_S = {"pdf": 3.0, "zip": 5.0}


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=1)
    seed = parser.parse_args().seed
    with tempfile.TemporaryDirectory(prefix="borescout-deliverables-") as folder:
        store = Store(Path(folder), Clock())
        short = assemble(store, demo_inspection(store, seed))
        store.close()
    options = Options(made=date(2026, 6, 1))
    for name, inspection in (("demo, 25 m", short), ("four of them in a row, 100 m", longer(short, 4))):
        times(name, inspection, options)
    latency(longer(short, 4), options)


def longer(inspection: Inspection, times: int) -> Inspection:
    """The same pipe ``times`` over, one after the other, with every landmark and photo of each."""
    landmarks, photos = [], []
    for turn in range(times):
        for photo in inspection.photos:
            photos.append(Photo(f"{turn}_{photo.name}", photo.jpeg))
        for one in inspection.landmarks:
            moved = {key: float(one[key]) + turn * LENGTH_M for key in ("chainage_m", "chainage_to_m")}
            landmarks.append(
                {**one, **moved, "photo": f"{turn}_{one['photo']}" if one["photo"] else "", "id": len(landmarks) + 1}
            )
    whole = replace(
        inspection,
        length=times * LENGTH_M,
        pipe=replace(inspection.pipe, length=times * LENGTH_M),
        landmarks=tuple(landmarks),
        photos=tuple(photos),
    )
    return replace(whole, observations=observations(whole))


def times(name: str, inspection: Inspection, options: Options) -> None:
    """Seconds of each format, best of ROUNDS."""
    rows = []
    base = min(_seconds(_baseline) for _ in range(ROUNDS))
    for format_name in (*FORMATS, "zip"):
        best = min(_seconds(lambda wanted=format_name: export(wanted, inspection, options)) for _ in range(ROUNDS))
        size = len(export(format_name, inspection, options)[0])
        limit = LIMITS_S.get(format_name)
        rows.append(
            (format_name, f"{best:.3f}", f"{best / base:.1f}", f"{size / 1000:.0f}", "-" if limit is None else f"{limit:g}")
        )
    title = f"{name}: {len(inspection.observations)} observations, {len(inspection.photos)} photos; best of {ROUNDS}"
    print_table(title, ("format", "s", "times the baseline", "kB", "wanted s"), rows)
    print(f"  baseline: 20 sorts of 400 000 float32, {base:.3f} s")


def latency(inspection: Inspection, options: Options) -> None:
    """How long a page waits while reports are made in the same process, as in the daemon."""
    with _page() as port:
        idle = _asked(port, lambda: time.sleep(2.0))
        busy = _asked(port, lambda: [export("pdf", inspection, options) for _ in range(3)])
    rows = [
        (name, len(values), *(f"{1000 * np.percentile(values, q):.1f}" for q in (50, 99)))
        for name, values in (("nothing else", idle), ("reports are made", busy))
    ]
    print_table("A page's answer meanwhile (ms)", ("", "requests", "median", "99th percentile"), rows)
    print(f"  mean while reports are made: {1000 * statistics.mean(busy):.1f} ms")


def _asked(port: int, work: object) -> list[float]:
    seconds: list[float] = []
    stop = threading.Event()

    def ask() -> None:
        while not stop.is_set():
            began = time.perf_counter()
            connection = http.client.HTTPConnection("127.0.0.1", port, timeout=30)
            connection.request("GET", "/")
            connection.getresponse().read()
            connection.close()
            seconds.append(time.perf_counter() - began)
            stop.wait(0.02)

    asker = threading.Thread(target=ask)
    asker.start()
    work()  # type: ignore[operator]
    stop.set()
    asker.join()
    return seconds


@contextmanager
def _page() -> Iterator[int]:
    from flask import Flask

    app = Flask("page")
    app.add_url_rule("/", view_func=lambda: "page")
    logging.getLogger("werkzeug").setLevel(logging.ERROR)
    server = make_server("127.0.0.1", 0, app, threaded=True)
    thread = threading.Thread(target=server.serve_forever)
    thread.start()
    try:
        yield server.port
    finally:
        server.shutdown()
        thread.join()


def _baseline() -> None:
    for _ in range(20):
        np.random.default_rng(0).random(400_000, dtype=np.float32).sort()


def _seconds(work: object) -> float:
    began = time.perf_counter()
    work()  # type: ignore[operator]
    return time.perf_counter() - began


if __name__ == "__main__":
    main()
