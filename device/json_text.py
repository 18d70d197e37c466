"""JSON that every reader understands: no NaN, no infinity, no numpy types."""

from __future__ import annotations

import json
import math
from typing import Any

import numpy as np


def plain(value: Any) -> Any:
    """``value`` in Python's own types; numbers that are not finite become None, since JSON has no word for them."""
    if isinstance(value, dict):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def dumps(value: Any) -> str:
    """Compact JSON of ``plain(value)``."""
    return json.dumps(plain(value), allow_nan=False, ensure_ascii=False, separators=(",", ":"))
