"""Figure 4 of the detector: what a picture costs, float32 and int8, beside a trunk of the size that the CCTV paper used.

    python -m tests.bench.fcdd_cost                                  the shipped model
    python -m tests.bench.fcdd_cost --int8 FILE --inception FILE     beside its int8 export and an Inception-v3 trunk (ONNX)

The models take turns, one core each, and the median of each counts: other work on the machine hits all of them alike.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np
import onnxruntime

from device.fcdd_model import SHIPPED, load_model
from tests.bench.table import print_table


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.bench.fcdd_cost", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--int8", type=Path)
    parser.add_argument("--inception", type=Path)
    parser.add_argument("--rounds", type=int, default=60)
    chosen = parser.parse_args()
    models = {"shipped, float32": SHIPPED, "int8": chosen.int8, "Inception-v3 trunk": chosen.inception}
    runs = {name: _session(file) for name, file in models.items() if file is not None}
    rng = np.random.default_rng(0)
    x = rng.normal(0, 0.5, (1, 3, 240, 320)).astype(np.float32)
    wall: dict[str, list[float]] = {name: [] for name in runs}
    work: dict[str, list[float]] = {name: [] for name in runs}
    for _ in range(chosen.rounds):
        for name, run in runs.items():
            before, used = time.perf_counter(), time.process_time()
            run.run(None, {run.get_inputs()[0].name: x})
            wall[name].append(time.perf_counter() - before)
            work[name].append(time.process_time() - used)
    base = float(np.median(work["shipped, float32"]))
    rows = [
        (
            name,
            f"{models[name].stat().st_size / 1e6:.1f}",
            f"{1e3 * np.median(work[name]):.1f}",
            f"{1e3 * np.median(wall[name]):.1f}",
            f"{1 / np.median(work[name]):.0f}",
            f"{np.median(work[name]) / base:.1f}",
        )
        for name in runs
    ]
    header = ("model", "MB", "processor ms", "wall ms", "a second of one core", "times the shipped")
    print_table("One picture, 320 x 240, one thread", header, rows)
    network = load_model()
    picture = rng.integers(0, 255, (576, 720, 3)).astype(np.uint8)
    times = []
    for _ in range(chosen.rounds):
        used = time.process_time()
        network.detect(picture)
        times.append(time.process_time() - used)
    print(f"\n  from a 720 x 576 picture to detections: {1e3 * np.median(times):.1f} ms of one core")


def _session(file: Path) -> onnxruntime.InferenceSession:
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    options.inter_op_num_threads = 1
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    return onnxruntime.InferenceSession(file.read_bytes(), options, providers=["CPUExecutionProvider"])


if __name__ == "__main__":
    main()
