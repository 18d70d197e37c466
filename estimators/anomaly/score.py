"""The anomaly score of the RADIUS paper, eq. 18, with its outward twin, for the whole wall and for bands of depth."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from estimators.anomaly.deviation import DeviationMap, smoothed
from estimators.radial_profile.fit import UNEVEN

_SURE, _LOST = 3.0, 1.0
"""Deviations of noise and unevenness together that nothing sound reaches, and in which what deviates is lost."""

_MOST = 0.5
"""A window is matched to what fills this share of it or more: what is smaller is passed over."""


@dataclass(frozen=True)
class BandScore:
    """Both scores (m) of the wall between two depths (m); nan where less than a tenth was measured. ``sees`` (m2): what is
    smaller may go unseen in a tenth of what was measured, since windows that large had to tell it; nan as well."""

    first: float
    last: float
    inward: float
    outward: float
    measured: float
    sees: float


def score(found: DeviationMap, left_out: NDArray[np.bool_] | None = None) -> tuple[float, float]:
    """(inward, outward): mean of |min(r - r', 0)| and of max(r - r', 0) over the measured wall, in metres.

    The paper averages over points; here every patch of wall counts by its area, so that the score does not depend on how near
    the camera stood. The inward score is the paper's otherwise, roughness and noise included; wall that is lost is so much less
    (a hole hides most of itself) that noise would be all of its twin: that one is of what noise cannot explain.
    ``left_out`` (Z, A): cells that are no anomaly, such as joints.
    """
    return plain_score(found, left_out)[0], sure_score(found, left_out)[1]


def plain_score(found: DeviationMap, left_out: NDArray[np.bool_] | None = None) -> tuple[float, float]:
    """Both means of all deviations, noise included."""
    return _means(found, found.deviation.astype(np.float64), slice(None), left_out)[:2]


def sure_score(found: DeviationMap, left_out: NDArray[np.bool_] | None = None) -> tuple[float, float]:
    """Both means of the deviations that neither noise nor the unevenness of sound walls may explain."""
    return _means(found, beyond_noise(found), slice(None), left_out)[:2]


def band_scores(found: DeviationMap, length: float, left_out: NDArray[np.bool_] | None = None) -> list[BandScore]:
    """The score of successive bands, each ``length`` (m) of the pipe, from near to far."""
    step = float(found.depth[1] - found.depth[0])
    plain, sure = found.deviation.astype(np.float64), beyond_noise(found)
    rows = max(1, round(length / step))
    bands = []
    for start in range(0, len(found.depth), rows):
        part = slice(start, min(start + rows, len(found.depth)))
        inward, _, measured = _means(found, plain, part, left_out)
        outward = _means(found, sure, part, left_out)[1]
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
                _sees(found, part) if enough else nan,
            )
        )
    return bands


def _sees(found: DeviationMap, rows: slice) -> float:
    return _MOST * float(np.percentile(found.patch[rows][found.measured[rows]], 90))


def beyond_noise(found: DeviationMap) -> NDArray[np.float64]:
    """Deviations (Z, A) in metres, 0 where the noise of the match, or the unevenness of sound walls, may explain them: what is
    connected to a place that they cannot explain is counted down to where it is lost in them."""
    smooth, sigma = smoothed(found)
    times = np.nan_to_num(smooth) / np.hypot(np.nan_to_num(sigma, nan=1e3), UNEVEN * found.radius)
    counted = np.zeros(times.shape, dtype=bool)
    for sign in (-1.0, 1.0):
        labels = cv2.connectedComponents((sign * times > _LOST).astype(np.uint8), connectivity=8)[1]
        sure = (sign * times > _SURE) & (found.gain > 0) & (labels > 0)
        counted |= np.isin(labels, np.unique(labels[sure])) & (labels > 0)
    return np.where(counted, found.deviation.astype(np.float64), np.where(found.measured, 0.0, np.nan))


def _means(
    found: DeviationMap, deviations: NDArray[np.float64], rows: slice, left_out: NDArray[np.bool_] | None
) -> tuple[float, float, float]:
    counted = found.measured[rows]
    if left_out is not None:
        counted = counted & ~left_out[rows]
    area = found.area[rows].astype(np.float64)
    total = float(area[counted].sum())
    wall = float(area[found.wall[rows]].sum())
    if total <= 0:
        return float("nan"), float("nan"), 0.0
    deviation = deviations[rows][counted]
    weight = area[counted] / total
    return float(weight @ np.maximum(-deviation, 0)), float(weight @ np.maximum(deviation, 0)), total / max(wall, 1e-12)
