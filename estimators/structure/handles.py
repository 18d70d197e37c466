"""The handle of a valve: where its stem points, along what its lever lies, and so whether it is open (beyond the paper's
Sec. 3.4)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estimators.structure.types import Array

HEIGHTS = (0.07, 0.20)
"""Above the axis (m): between these a handle lies and no body."""
_REACH = 0.26
_LEAST = 12


@dataclass(frozen=True)
class Handle:
    """``stem`` (3,): unit vector from the pipe's axis to the handle. ``lever`` (3,): along the handle, None where it is too
    short to tell. ``is_open``: the lever lies along the pipe (of a three-way valve: along its branch); None where that is
    not sure."""

    stem: Array
    lever: Array | None
    is_open: bool | None


NONE, LOW, HIGH = range(3)
"""What stands above the middle of an object: nothing, the handle of a ball or three-way valve, that of a butterfly valve."""
_PROUD, _TALL, _BESIDE, _FEW = 0.072, 0.13, 0.06, 6


def handle_height(cloud: Array, position: Array, pipes: Array) -> int | None:
    """How high something stands above the middle of an object whose ``cloud`` (N, 3) lies about ``position``; None where no
    pipe tells its axis. What lies along one of the ``pipes`` (n, 3) that leave it is the pipe's, or a port across from it."""
    if not len(pipes):
        return None
    cosines = pipes @ pipes.T
    axis = pipes[np.unravel_index(int(np.argmin(cosines)), cosines.shape)[0]]
    relative = cloud - position
    along = relative @ axis
    distance = np.linalg.norm(relative - along[:, None] * axis, axis=1)
    above = np.abs(along) < _BESIDE
    for pipe in pipes[np.abs(pipes @ axis) < 0.5]:
        out = relative @ pipe
        above &= np.linalg.norm(relative - out[:, None] * pipe, axis=1) > _BESIDE
    if (above & (distance > _TALL)).sum() >= _FEW:
        return HIGH
    return LOW if (above & (distance > _PROUD)).sum() >= _FEW else NONE


def find_handle(cloud: Array, position: Array, axis: Array, free: Array) -> Handle | None:
    """The handle in an object's fused ``cloud`` (N, 3) at ``position`` on a pipe along ``axis``; None where none stands out.

    ``free`` (n, 3): directions in which other pipes leave, where no handle can be.
    """
    relative = cloud - position
    along = relative @ axis
    off = relative - along[:, None] * axis
    distance = np.linalg.norm(off, axis=1)
    high = (distance > HEIGHTS[0]) & (distance < HEIGHTS[1]) & (np.abs(along) < _REACH)
    for pipe in free:
        out = relative @ pipe
        side = np.linalg.norm(relative - out[:, None] * pipe, axis=1)
        high &= ~((out > 0) & (side < 0.06))
    if high.sum() < _LEAST:
        return None
    first = np.cross(axis, np.eye(3)[int(np.argmin(np.abs(axis)))])
    first /= np.linalg.norm(first)
    second = np.cross(axis, first)
    middle = high & (np.abs(along) < 0.06)
    if middle.sum() < _LEAST // 2:
        return None
    turn = np.arctan2(off[middle] @ second, off[middle] @ first)
    mean = np.array([np.cos(turn).mean(), np.sin(turn).mean()])
    if np.linalg.norm(mean) < 0.6:  # all around: no handle but a thick body
        return None
    stem = (mean[0] * first + mean[1] * second) / np.linalg.norm(mean)
    above = off @ stem
    top = high & (above > HEIGHTS[0])
    if top.sum() < _LEAST:
        return None
    across = np.cross(axis, stem)
    flat = np.column_stack([along[top], relative[top] @ across])
    spread = flat - np.median(flat, axis=0)
    values, vectors = np.linalg.eigh(spread.T @ spread / len(spread))
    if values[1] < 0.02**2 or values[1] < 2.5 * values[0]:
        return Handle(stem, None, None)
    direction = vectors[:, 1]
    lever = direction[0] * axis + direction[1] * across
    turned = abs(float(direction[0]))
    is_open = True if turned > 0.85 else (False if turned < 0.5 else None)
    return Handle(stem, lever, is_open)
