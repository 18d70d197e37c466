"""The anomaly score of the RADIUS paper, eq. 18, with its outward twin, for the whole wall and for bands of depth."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimators.anomaly.deviation import DeviationMap, Floats, smoothed
from estimators.anomaly.evidence import speaks
from estimators.anomaly.parts import parts_around
from estimators.radial_profile.fit import UNEVEN

_SURE, _LOST = 3.0, 1.0
"""Deviations of noise and unevenness together that nothing sound reaches, and in which what deviates is lost."""

_ENOUGH = 0.1
"""Share of a band's wall that speaks for it."""
_MOST = 0.5
"""A window is matched to what fills this share of it or more: what is smaller is passed over."""
_FINE = 0.04
"""Largest window that shows lost wall, as a share of the squared radius: as a rule the smallest of three. Larger ones flatten
it, since its near edge hides most of it, and may tell nothing of it."""


@dataclass(frozen=True)
class BandScore:
    """Both scores (m) of the wall between two depths (m); nan where less than a tenth was measured, or tells of losses.
    ``sees`` (m2): what is smaller may go unseen in a tenth of what was measured, since windows that large had to tell it; nan
    as well."""

    first: float
    last: float
    inward: float
    outward: float
    measured: float
    sees: float


def score(found: DeviationMap, left_out: NDArray[np.bool_] | None = None) -> tuple[float, float, float]:
    """(inward, outward, told): mean of |min(r - r', 0)| over the measured wall and of max(r - r', 0) over the wall that tells
    of losses, in metres, and the share of the wall that does.

    The paper averages over points; here every patch of wall counts by its area, so that the score does not depend on how near
    the camera stood. The inward score is the paper's otherwise, roughness and noise included; its twin is of ``lost_wall``.
    ``left_out`` (Z, A): cells that are no anomaly, such as joints.
    """
    outward, told = _means(found, lost_wall(found), slice(None), left_out)[1:]
    return plain_score(found, left_out)[0], outward, told


def plain_score(found: DeviationMap, left_out: NDArray[np.bool_] | None = None) -> tuple[float, float]:
    """Both means of all deviations, noise included."""
    return _means(found, found.deviation.astype(np.float64), slice(None), left_out)[:2]


def sure_score(found: DeviationMap, left_out: NDArray[np.bool_] | None = None) -> tuple[float, float]:
    """Both means of the deviations that neither noise nor the unevenness of sound walls may explain."""
    return _means(found, beyond_noise(found), slice(None), left_out)[:2]


def band_scores(found: DeviationMap, length: float, left_out: NDArray[np.bool_] | None = None) -> list[BandScore]:
    """The score of successive bands, each ``length`` (m) of the pipe, from near to far."""
    step = float(found.depth[1] - found.depth[0])
    plain, lost = found.deviation.astype(np.float64), lost_wall(found)
    rows = max(1, round(length / step))
    bands = []
    for start in range(0, len(found.depth), rows):
        part = slice(start, min(start + rows, len(found.depth)))
        inward, _, measured = _means(found, plain, part, left_out)
        outward, told = _means(found, lost, part, left_out)[1:]
        edge = found.depth[part]
        enough = measured >= _ENOUGH
        nan = float("nan")
        bands.append(
            BandScore(
                float(edge[0] - step / 2),
                float(edge[-1] + step / 2),
                inward if enough else nan,
                outward if told >= _ENOUGH else nan,
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
    times = _times(found)
    counted = np.zeros(times.shape, dtype=bool)
    for sign in (-1.0, 1.0):
        for cells in _parts(found, sign * times):
            counted.flat[cells] = True
    return np.where(counted, found.deviation.astype(np.float64), np.where(found.measured, 0.0, np.nan))


def lost_wall(found: DeviationMap) -> NDArray[np.float64]:
    """How far (m) the wall is lost, (Z, A): of what noise cannot explain, and the pictures speak for; nan where a loss was
    neither told nor could be.

    A hole hides most of itself, so that noise, and the best of many answers on a smooth wall, would be all of this score.
    """
    lost = np.zeros(found.deviation.shape, dtype=bool)
    for cells in _parts(found, _times(found)):
        lost.flat[cells] = speaks(found, cells)
    told = found.measured & (lost | (found.patch <= _FINE * found.radius**2))
    return np.where(told, np.where(lost, found.deviation.astype(np.float64), 0.0), np.nan)


def _times(found: DeviationMap) -> Floats:
    """By how many deviations, of noise and of sound walls' unevenness together, each cell (Z, A) lies outwards."""
    smooth, sigma = smoothed(found)
    return np.asarray(np.nan_to_num(smooth) / np.hypot(np.nan_to_num(sigma, nan=1e3), UNEVEN * found.radius), dtype=np.float32)


def _parts(found: DeviationMap, times: Floats) -> Iterator[NDArray[np.intp]]:
    """The cells (flat indices) of each connected part that reaches what nothing sound does, ``times`` (Z, A) its deviations."""
    labels = parts_around(times > _LOST)[0]
    for label in np.unique(labels[(times > _SURE) & (found.gain > 0)]):
        yield np.flatnonzero(labels == label)


def _means(
    found: DeviationMap, deviations: NDArray[np.float64], rows: slice, left_out: NDArray[np.bool_] | None
) -> tuple[float, float, float]:
    """(inwards, outwards) means (m) of the cells with a deviation, and the share of the wall that they are."""
    counted = np.isfinite(deviations[rows])
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
