"""Medians along the rows of a map of which a part was not measured."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def row_medians(values: NDArray[np.floating]) -> NDArray[np.float64]:
    """Median (Z,) of each row of ``values`` (Z, A) without its nan; nan for rows that have nothing else.

    numpy's nanmedian takes four to seven times as long for maps of this size, and warns of such rows.
    """
    ordered = np.sort(values, axis=1)  # nan comes last
    known = np.isfinite(values).sum(axis=1)
    row = np.arange(len(values))
    low, high = ordered[row, np.maximum(known - 1, 0) // 2], ordered[row, np.minimum(known // 2, values.shape[1] - 1)]
    return np.where(known > 0, 0.5 * (low.astype(np.float64) + high), np.nan)
