"""Where the detector's model comes from: the one that is shipped, or a file that somebody trained."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from device.errors import Invalid

if TYPE_CHECKING:
    from estimators.fcdd import Fcdd

SHIPPED = Path(__file__).parents[1] / "data" / "fcdd" / "fcdd.onnx"
SHIPPED_INT8 = SHIPPED.with_name("fcdd_int8.onnx")
MOST_BYTES = 200_000_000
TIMED_RUNS = 5


def load_model(path: Path | None = None, threads: int = 1) -> Fcdd:
    """The model of ``path``, the shipped one where that is None. Raises Invalid with one sentence."""
    file = SHIPPED if path is None else path
    try:
        from estimators.fcdd import Fcdd, ModelBroken
    except ImportError:
        raise Invalid("The detector needs onnxruntime, which is not installed here: pip install onnxruntime.") from None
    try:
        if file.stat().st_size > MOST_BYTES:
            raise Invalid(f"The model {file} is larger than any detector.")
        return Fcdd(file.read_bytes(), threads)
    except FileNotFoundError:
        raise Invalid(f"There is no model {file}.") from None
    except OSError as error:
        raise Invalid(f"The model {file} cannot be read: {error.strerror}.") from None
    except ModelBroken as error:
        raise Invalid(f"The file {file} {error}.") from None


def fastest_model(threads: int = 1) -> Fcdd:
    """The shipped model as float32 or as int8, whichever this machine runs faster: a processor without an int8 dot product
    gains nothing from int8. The least of some runs counts, taken in turns. Raises Invalid."""
    candidates = [load_model(SHIPPED, threads), load_model(SHIPPED_INT8, threads)]
    width, height = candidates[0].card.size
    blank = np.zeros((1, 3, height, width), np.float32)
    least = [float("inf")] * len(candidates)
    for turn in range(TIMED_RUNS + 1):
        for k, model in enumerate(candidates):
            begun = time.perf_counter()
            model.run(blank)
            if turn > 0:  # the first run lays out its memory
                least[k] = min(least[k], time.perf_counter() - begun)
    return candidates[0] if least[0] <= least[1] else candidates[1]
