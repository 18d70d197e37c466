"""Joints as rings in the reference picture: a gap is narrower than what a window of the match covers, but its edges are seen.

What is seen of a gap between its two edges covers just as much of the unrolled wall as the gap is long, however deep it is: the
ray that passes the near edge and the one that meets the far edge both touch the wall there. It is darker than the wall, or
brighter where its far face looks at the lamp, all the way around at one place of the pipe. Where its floor is as bright as the
wall only the far face stands out, and the gap is longer than that.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from estimators.anomaly.deviation import DeviationMap
from estimators.anomaly.joints import Joint
from estimators.anomaly.rows import row_medians
from estimators.radial_profile.fit import Wall

Floats = NDArray[np.float64]

_ANGLES = 120
_STEP_PX = 0.6
"""Rows of the picture looked at, in pixels of it along the pipe at half of its width."""
_ABOUT_M, _SAMPLES = 0.09, 4
"""How far before and behind a place the wall tells how bright it should be, by the median of so many places on either side: a
ring is shorter than half of that."""
_LEAST = 0.12
"""Share of the wall's brightness by which a ring stands out at least."""
_TIMES_NOISE = 6.0
_SAME_SIGN = 0.75
"""Share of the way around that stands out to the same side."""
_GUARD_M, _COMPARED_M = 0.03, 0.08
"""What a window of the match smears about a joint, and how much of the wall beyond it tells where the pipe stands."""
_SEEN = 0.5
_LONGEST_M, _END_M = 0.06, 0.03
"""Longest gap, and how near to the wall's ends nothing is looked for: what closes the pipe begins with a ring, too."""
_SECTORS, _LEAST_SECTORS = 12, 4
_UNSURE, _UNSURE_M = 0.15, 0.003
"""A gap that is known less well than this (share of it, m; standard deviation) is not told."""
_SMEARED_M = 0.04
"""Rings of deviations shorter than this may be as long as a window of the match has smeared them: they tell no gap."""
_SAME_M = 0.05
"""A joint of the deviations and a ring of the picture this near to each other are one."""


@dataclass(frozen=True)
class Seam:
    """A ring at ``depth`` (m, where the pipe's axis has it) that is ``gap`` (m) long, and how well that is known."""

    depth: float
    gap: float
    gap_std: float


def find_seams(picture: NDArray[np.uint8], wall: Wall, found: DeviationMap) -> list[Seam]:
    """Rings of the left picture (H, W), grey, from near to far."""
    place, bright = _unrolled(picture, wall, float(found.depth[0]), float(found.depth[-1]))
    seen = np.isfinite(bright).mean(axis=1) > _SEEN
    reach = int(_ABOUT_M / float(place[len(place) // 2] - place[len(place) // 2 - 1]))
    out = np.expm1(bright - _about(bright, reach))
    inner = seen & (place > place[0] + _END_M) & (place < place[-1] - _END_M)
    if np.count_nonzero(inner) < 2 * reach:
        return []
    seams: list[Seam] = []
    for sign in (-1.0, 1.0):
        line = _strong_part(sign * out)
        noise = 1.4826 * float(np.median(np.abs(line[inner] - np.median(line[inner]))))
        least = float(np.median(line[inner])) + max(_LEAST, _TIMES_NOISE * noise)
        same = (sign * out > 0.3 * _LEAST).sum(axis=1) > _SAME_SIGN * np.isfinite(out).sum(axis=1)
        high = np.where(inner & same, line, 0.0)
        while high.max(initial=0.0) > least:
            row = int(np.argmax(high))
            seam = _measured(place, sign * out, row, found)
            high[np.abs(place - place[row]) < _LONGEST_M] = 0.0
            if seam is not None:
                seams.append(seam)
    return sorted(_apart(seams), key=lambda seam: seam.depth)


def _strong_part(out: Floats) -> Floats:
    """(N,): what the upper half of each row reaches; as noisy as a median."""
    ordered = np.sort(np.nan_to_num(out, nan=-1.0), axis=1)
    return np.asarray(ordered[:, (3 * ordered.shape[1]) // 5], dtype=np.float64)


def with_seams(joints: list[Joint], seams: list[Seam]) -> list[Joint]:
    """``joints`` with the gaps that the picture shows of those that are not displaced, and the joints that only it shows, from
    near to far."""
    nan = float("nan")
    found = [joint if joint.gap >= _SMEARED_M else replace(joint, gap=nan) for joint in joints]
    alone = []
    for seam in seams:
        near = [k for k, joint in enumerate(found) if abs(joint.depth - seam.depth) < _SAME_M]
        if near:
            nearest = min(near, key=lambda k: abs(found[k].depth - seam.depth))
            # of a displaced pipe the face is seen on one side, and nothing on the other
            if np.isnan(found[nearest].offset_std) and not found[nearest].gap > seam.gap:  # nan: not told
                found[nearest] = replace(found[nearest], gap=seam.gap, gap_std=seam.gap_std)
            continue
        half = 0.5 * seam.gap
        alone.append(Joint(seam.depth, seam.depth - half, seam.depth + half, seam.gap, nan, None, None, seam.gap_std))
    return sorted(found + alone, key=lambda joint: joint.depth)


def _unrolled(picture: NDArray[np.uint8], wall: Wall, nearest: float, farthest: float) -> tuple[Floats, Floats]:
    """(place along the pipe's axis (N,) m, logarithm of brightness (N, A), nan outside of the picture). A ring about the axis
    is a row: a camera that looks askew has it at a depth that differs from angle to angle."""
    camera, axis = wall.rig.intrinsics, wall.axis
    radius = float(np.median(wall.coefficients[0]))
    share = _STEP_PX / (camera.fx * radius / nearest) * (camera.width / 960)
    count = max(int(np.log(farthest / nearest) / share), 2)
    place: Floats = nearest * (farthest / nearest) ** ((np.arange(count, dtype=np.float64) + 0.5) / count)
    theta: Floats = (np.arange(_ANGLES, dtype=np.float64) + 0.5) * (2 * np.pi / _ANGLES) - np.pi
    constant, slope = wall.profile(theta)
    away = axis.right * np.cos(theta) + axis.down * np.sin(theta)
    z = place[:, None] - away * (constant + slope * place[:, None])
    around = constant + slope * z
    middle_x, middle_y = axis.at(z)
    x = (middle_x + around * np.cos(theta)) / z * camera.fx + camera.ppx
    y = (middle_y + around * np.sin(theta)) / z * camera.fy + camera.ppy
    inside = (x > 1) & (x < camera.width - 2) & (y > 1) & (y < camera.height - 2)
    grey = cv2.remap(picture, x.astype(np.float32), y.astype(np.float32), cv2.INTER_LINEAR).astype(np.float64)
    return place, np.where(inside, np.log(grey + 4.0), np.nan)


def _about(bright: Floats, reach: int) -> Floats:
    """How bright the wall is about each cell (N, A): the median of places before and behind it along the pipe."""
    step = max(reach // _SAMPLES, 1)
    padded = np.pad(bright, ((step * _SAMPLES, step * _SAMPLES), (0, 0)), mode="edge")
    shifted = np.stack([padded[k : k + len(bright)] for k in range(0, 2 * step * _SAMPLES + 1, step)])
    return np.asarray(np.sort(shifted, axis=0)[len(shifted) // 2], dtype=np.float64)


def _measured(place: Floats, out: Floats, row: int, found: DeviationMap) -> Seam | None:
    """The ring at ``row``: in each sector around the pipe from where it rises to half of its height to where it falls to it.
    Where the pipe before or behind it stands off the fitted wall, its edge is seen at another place than it is: by as much
    nearer or farther as its radius is smaller or larger."""
    near = np.flatnonzero(np.abs(place - place[row]) < _LONGEST_M)
    before, behind = _standing(found, float(place[row]), out.shape[1])
    lengths, middles = [], []
    for columns in np.array_split(np.arange(out.shape[1]), _SECTORS):
        part = out[np.ix_(near, columns)]
        if np.isfinite(part).mean() < _SEEN:
            continue
        line = np.nan_to_num(row_medians(part))
        top = int(np.argmax(np.where(np.abs(near - row) <= 6, line, -np.inf)))
        height = line[top]
        if not height > 0.7 * _LEAST:
            continue
        first, last = _half(line, top, -1, height), _half(line, top, 1, height)
        if first is None or last is None:
            continue
        edges = np.interp([first, last], np.arange(len(near)), place[near])
        edges *= 1.0 + np.array([before[columns].mean(), behind[columns].mean()])
        lengths.append(float(edges[1] - edges[0]))
        middles.append(float(edges.mean()))
    if len(lengths) < _LEAST_SECTORS:
        return None
    gap = float(np.median(lengths))
    if gap <= 0:
        return None
    spread = 1.4826 * float(np.median(np.abs(np.array(lengths) - gap)))
    row_m = float(place[row] - place[max(row - 1, 0)])
    std = float(np.hypot(1.25 * spread / np.sqrt(len(lengths)), row_m))
    return Seam(float(np.median(middles)), gap, std) if std < max(_UNSURE * gap, _UNSURE_M) else None


def _standing(found: DeviationMap, place: float, angles: int) -> tuple[Floats, Floats]:
    """(A,) twice: how far the wall before and behind a place stands off the fitted one, as shares of its radius."""
    away, sides = found.depth - place, []
    for sign in (-1.0, 1.0):
        rows = (sign * away > _GUARD_M) & (sign * away < _GUARD_M + _COMPARED_M)
        part = row_medians((found.deviation[rows] / found.radius[rows]).T)
        part = np.nan_to_num(part)
        column = ((np.arange(angles) + 0.5) * len(part) / angles).astype(int)
        sides.append(part[column])
    return sides[0], sides[1]


def _half(line: Floats, top: int, way: int, height: float) -> float | None:
    """Where ``line`` falls to half of ``height`` going ``way`` from ``top``, with its fraction; None where it does not."""
    row = top
    while 0 <= row + way < len(line):
        if line[row + way] < 0.5 * height:
            return row + way * float((line[row] - 0.5 * height) / (line[row] - line[row + way]))
        row += way
    return None


def _apart(seams: list[Seam]) -> list[Seam]:
    """Of rings that touch (a dark floor and a bright face of one gap) one from the first edge to the last."""
    merged: list[Seam] = []
    for seam in sorted(seams, key=lambda one: one.depth):
        last = merged[-1] if merged else None
        if last is not None and seam.depth - last.depth < 0.6 * (seam.gap + last.gap) + 0.004:
            first, stop = last.depth - last.gap / 2, seam.depth + seam.gap / 2
            merged[-1] = Seam((first + stop) / 2, stop - first, float(np.hypot(last.gap_std, seam.gap_std)))
        else:
            merged.append(seam)
    return merged
