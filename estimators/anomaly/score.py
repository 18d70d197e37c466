"""The anomaly score of the RADIUS paper, eq. 18, with its outward twin, for the whole wall and for bands of depth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimators.anomaly.deviation import DeviationMap


@dataclass(frozen=True)
class BandScore:
    """Mean inward and outward deviation (m) of the wall between two depths (m); nan where less than a tenth was measured."""

    first: float
    last: float
    inward: float
    outward: float
    measured: float


def score(found: DeviationMap, left_out: NDArray[np.bool_] | None = None) -> tuple[float, float]:
    """(inward, outward): mean of |min(r - r', 0)| and of max(r - r', 0) over the measured wall, in metres.

    The paper averages over points; here every patch of wall counts by its area, so that the score does not depend on how near
    the camera stood. ``left_out`` (Z, A): cells that are no anomaly, such as joints.
    """
    return _means(found, slice(None), left_out)[:2]


def band_scores(found: DeviationMap, length: float, left_out: NDArray[np.bool_] | None = None) -> list[BandScore]:
    """The score of successive bands, each ``length`` (m) of the pipe, from near to far."""
    step = float(found.depth[1] - found.depth[0])
    rows = max(1, round(length / step))
    bands = []
    for start in range(0, len(found.depth), rows):
        part = slice(start, min(start + rows, len(found.depth)))
        inward, outward, measured = _means(found, part, left_out)
        edge = found.depth[part]
        enough = measured >= 0.1
        nan = float("nan")
        bands.append(
            BandScore(
                float(edge[0] - step / 2),
                float(edge[-1] + step / 2),
                inward if enough else nan,
                outward if enough else nan,
                measured,
            )
        )
    return bands


def _means(found: DeviationMap, rows: slice, left_out: NDArray[np.bool_] | None) -> tuple[float, float, float]:
    counted = found.measured[rows]
    if left_out is not None:
        counted = counted & ~left_out[rows]
    area = found.area[rows].astype(np.float64)
    total = float(area[counted].sum())
    wall = float(area[found.wall[rows]].sum())
    if total <= 0:
        return float("nan"), float("nan"), 0.0
    deviation = found.deviation[rows][counted].astype(np.float64)
    weight = area[counted] / total
    return float(weight @ np.maximum(-deviation, 0)), float(weight @ np.maximum(deviation, 0)), total / max(wall, 1e-12)
