"""Where the detector's model comes from: the one that is shipped, or a file that somebody trained."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from device.errors import Invalid

if TYPE_CHECKING:
    from estimators.fcdd import Fcdd

SHIPPED = Path(__file__).parent / "data" / "fcdd" / "fcdd.onnx"
MOST_BYTES = 200_000_000


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
