"""Which detection belongs to which track: gating by Mahalanobis distance, global nearest neighbour (CCTV paper, eqs. 14, 18).

Gating and costs are linear in detections x tracks. The assignment is solved per connected component of gated pairs: those are
small however many tracks there are.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from estimators.landmarks.projection import NEAREST, PipeCamera, View, back_project

Array = NDArray[np.float64]
Index = NDArray[np.intp]

GATE = 9.21
"""Chi-squared of two degrees of freedom at 99 % (below eq. 18)."""


@dataclass(frozen=True)
class Gated:
    """Every pair of detection and track (m, n): squared Mahalanobis distance, ln |S|, and where on the track's extent
    (m from its chainage) the detection was looked for. Pairs outside the gate have an infinite distance."""

    distance2: Array
    log_det: Array
    offset: Array


def gate(
    camera: PipeCamera,
    view: View,
    states: Array,
    covariances: Array,
    pixels: Array,
    extents: tuple[Array, Array],
    noise: tuple[float, float, float],
    threshold: float = GATE,
) -> Gated:
    """Mahalanobis distances of ``pixels`` (m, 2) to ``states`` (n, 2), ``covariances`` (n, 2, 2) (eqs. 12, 14, 18).

    ``extents`` are the metres (n,), (n,) by which each track reaches below and above its chainage (<= 0, >= 0): a detection is
    compared with the nearest point of the extent. ``noise`` is (pixel_std, centre_std, position_std).
    """
    m, n = len(pixels), len(states)
    if m == 0 or n == 0:
        return Gated(np.full((m, n), np.inf), np.zeros((m, n)), np.zeros((m, n)))
    pixel_std, centre_std, position_std = noise
    below, above = extents
    if np.any(above > below):
        seen = np.nan_to_num(back_project(camera, view, pixels)[:, 0], nan=view.position + 1e3)
        offset = np.clip(seen[:, None] - states[None, :, 0], below[None], above[None])
    else:
        offset = np.zeros((1, n))
    # Written out rather than through jacobian() and 2 x 2 products: this is the one step that sees all pairs.
    depth = states[None, :, 0] + offset - view.position
    ahead = depth > NEAREST
    depth = np.where(ahead, depth, 1.0)
    cos, sin = np.cos(states[:, 1]), np.sin(states[:, 1])
    x = camera.fx * (view.axis[0] + camera.radius * cos) / depth
    y = camera.fy * (view.axis[1] + camera.radius * sin) / depth
    du = pixels[:, :1] - view.centre[0] - x
    dv = pixels[:, 1:] - view.centre[1] - y
    along_u, along_v = -x / depth, -y / depth
    round_u, round_v = -camera.fx * camera.radius * sin / depth, camera.fy * camera.radius * cos / depth
    p_ll = covariances[:, 0, 0] + position_std**2
    p_lt, p_tt = covariances[:, 0, 1], covariances[:, 1, 1]
    white = pixel_std**2 + centre_std**2
    s_uu = along_u**2 * p_ll + 2 * along_u * round_u * p_lt + round_u**2 * p_tt + white
    s_vv = along_v**2 * p_ll + 2 * along_v * round_v * p_lt + round_v**2 * p_tt + white
    s_uv = along_u * along_v * p_ll + (along_u * round_v + along_v * round_u) * p_lt + round_u * round_v * p_tt
    det = s_uu * s_vv - s_uv**2
    distance2 = (s_vv * du**2 - 2 * s_uv * du * dv + s_uu * dv**2) / det
    distance2 = np.where(ahead & (distance2 < threshold), distance2, np.inf)
    return Gated(distance2, np.broadcast_to(np.log(det), (m, n)), np.broadcast_to(offset, (m, n)))


def components(gated: NDArray[np.bool_]) -> list[tuple[Index, Index]]:
    """Groups of detections and tracks that hang together through ``gated`` (m, n) pairs: (rows, columns) of each group."""
    groups: list[tuple[Index, Index]] = []
    free = np.asarray(gated.any(axis=1), dtype=bool)
    for row in np.flatnonzero(free):
        if not free[row]:
            continue
        rows = np.zeros(len(gated), dtype=bool)
        rows[row] = True
        columns = np.asarray(gated[row], dtype=bool)
        while True:
            wider = np.asarray(gated[:, columns].any(axis=1), dtype=bool)
            if int(wider.sum()) == int(rows.sum()):
                break
            rows, columns = wider, np.asarray(gated[wider].any(axis=0), dtype=bool)
        free &= ~rows
        groups.append((np.flatnonzero(rows), np.flatnonzero(columns)))
    return groups


def assign(cost: Array) -> tuple[Index, Index]:
    """Pairs (rows, columns) of least total ``cost`` (m, n), each row and column used at most once.

    A pair costs less than nothing when it is likelier than leaving both alone; pairs of no gain, or with an infinite cost, are
    never made. Global nearest neighbour by ``linear_sum_assignment``, one connected component at a time.
    """
    useful = cost < 0
    rows: list[int] = []
    columns: list[int] = []
    for group_rows, group_columns in components(useful):
        if len(group_rows) == 1:
            rows.append(int(group_rows[0]))
            columns.append(int(group_columns[np.argmin(cost[group_rows[0], group_columns])]))
            continue
        block = cost[np.ix_(group_rows, group_columns)]
        chosen_rows, chosen_columns = linear_sum_assignment(np.minimum(np.where(np.isfinite(block), block, 0.0), 0.0))
        for i, j in zip(chosen_rows, chosen_columns, strict=True):
            if block[i, j] < 0:
                rows.append(int(group_rows[i]))
                columns.append(int(group_columns[j]))
    return np.asarray(rows, dtype=np.intp), np.asarray(columns, dtype=np.intp)
