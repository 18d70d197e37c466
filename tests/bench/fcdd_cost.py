"""Figure 4 of the detector: what a picture costs, float32 and int8, beside a trunk of the size that the CCTV paper used.

    python -m tests.bench.fcdd_cost                      the shipped models, and with torchvision an Inception-v3 trunk
    python -m tests.bench.fcdd_cost --inception FILE     the same with a trunk exported elsewhere (ONNX)
    python -m tests.bench.drive_cost --network           the whole survey with the network at every second picture

The trunk has random weights and a head of one 1 x 1 convolution, and eq. 8; it needs torch and torchvision. The models take
turns, one core each, and the median of each counts: other work on the machine hits all of them alike.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import onnxruntime

from device.fcdd.model import SHIPPED, SHIPPED_INT8, load_model
from tests.bench.table import print_table


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.bench.fcdd_cost", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--inception", type=Path)
    parser.add_argument("--rounds", type=int, default=60)
    chosen = parser.parse_args()
    models = {"shipped, float32": SHIPPED.read_bytes(), "shipped, int8": SHIPPED_INT8.read_bytes()}
    trunk = _inception() if chosen.inception is None else chosen.inception.read_bytes()
    if trunk is not None:
        models["Inception-v3 trunk"] = trunk
    runs = {name: _session(model) for name, model in models.items()}
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
    most = max(float(np.median(times)) for times in work.values())
    rows = [
        (
            name,
            f"{len(models[name]) / 1e6:.1f}",
            f"{1e3 * np.median(work[name]):.1f}",
            f"{1e3 * np.median(wall[name]):.1f}",
            f"{1 / np.median(work[name]):.0f}",
            f"{most / np.median(work[name]):.1f}",
        )
        for name in runs
    ]
    header = ("model", "MB", "processor ms", "wall ms", "a second of one core", "times the slowest")
    print_table("One picture, 320 x 240, one thread", header, rows)
    network = load_model()
    picture = rng.integers(0, 255, (576, 720, 3)).astype(np.uint8)
    times = []
    for _ in range(chosen.rounds):
        used = time.process_time()
        network.detect(picture)
        times.append(time.process_time() - used)
    print(f"\n  from a 720 x 576 picture to detections: {1e3 * np.median(times):.1f} ms of one core")


def _inception() -> bytes | None:
    """An Inception-v3 trunk with random weights as ONNX; None where torch and torchvision are not installed."""
    try:
        import torch
        import torchvision
    except (ImportError, RuntimeError) as error:
        print(f"Without the Inception-v3 trunk: {error}", file=sys.stderr)
        return None
    network = torchvision.models.inception_v3(weights=None, init_weights=False, aux_logits=False)
    layers = [layer for name, layer in network.named_children() if name not in ("avgpool", "dropout", "fc", "AuxLogits")]

    class Trunk(torch.nn.Module):
        def __init__(self) -> None:
            super().__init__()
            self.layers, self.head = torch.nn.Sequential(*layers), torch.nn.Conv2d(2048, 5, 1)

        def forward(self, x: torch.Tensor) -> torch.Tensor:
            return torch.sqrt(self.head(self.layers(x)) ** 2 + 1) - 1

    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "inception.onnx"
        torch.onnx.export(Trunk().eval(), (torch.zeros(1, 3, 240, 320),), str(file), opset_version=17, dynamo=False)
        return file.read_bytes()


def _session(model: bytes) -> onnxruntime.InferenceSession:
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    options.inter_op_num_threads = 1
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    return onnxruntime.InferenceSession(model, options, providers=["CPUExecutionProvider"])


if __name__ == "__main__":
    main()
