"""The least-squares problem of a run: its unknowns, its sightings' residuals and Jacobian, and the prior.

Unknowns, in this order: log of f*R; metres per metre counted; the tether's slack at each knot; chainage and angle of each
landmark; chainage of each joint; error of the focus of expansion per stretch; error of the axis offset per stretch (radii); log
of how much wider rings look than the pipe is, for what shows of a joint is its gap, now this edge of it and now that; the same
of all landmarks, and of each, for a deposit stands into the pipe and of a hole the far edge shows.
The camera of frame i is at x_i = start + scale (count_i - count_0) + slack_i, and a landmark at (l, theta) is seen at
c + f*R [a_x + h cos theta, aspect (a_y + h sin theta)] / (l - x_i): eq. 5 of the CCTV paper with the axis offset a and the
landmark's distance h from the axis (radii).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import sparse

from estimators.landmarks.smoothing.initial import first_guess
from estimators.landmarks.smoothing.knots import Knots, knots_of, nodes_along
from estimators.landmarks.smoothing.types import Array, Constraints, Indices, Known, Noise, Run

NEAREST = 0.05
"""Depth (m) below which the projection goes on without its pole: a trial step may put a landmark beside the camera."""
LOOSE_WAY, LOOSE_ANGLE, LOOSE_LOG = 50.0, 10.0, 1.5
"""Standard deviations (m, rad, -) of what is not known at all: they keep the system regular, and tell where
nothing was seen."""
START_STD = 0.01

Sparse = Any


@dataclass(frozen=True)
class Layout:
    """Where each unknown stands in the state vector."""

    slack: int
    landmarks: int
    joints: int
    centres: int
    axes: int
    ring_share: int
    landmark_share: int
    landmark_shares: int
    size: int
    landmark_ids: Indices
    joint_ids: Indices

    log_focal = 0
    scale = 1


@dataclass(frozen=True)
class System:
    """The problem of one run. ``initial`` (size,) state; ``prior`` (p, size) sparse rows with ``prior_value`` (p,) of unit
    weight; ``increments`` (K - 1, size) picks the slack's increments."""

    run: Run
    knots: Knots
    layout: Layout
    initial: Array
    prior: Sparse
    prior_value: Array
    increments: Sparse
    landmark: Indices
    joint: Indices
    centre_node: Indices
    axis_node: Indices

    def positions(self, state: Array) -> Array:
        """Camera along the pipe (n,) in each frame."""
        knots, slack = self.knots, state[self.layout.slack : self.layout.landmarks]
        counted = knots.encoder - knots.encoder[0]
        return np.asarray(
            state[1] * counted + (1 - knots.share) * slack[knots.left] + knots.share * slack[knots.right], dtype=np.float64
        )

    def residuals(self, state: Array) -> tuple[Array, Array]:
        """(m, 2) of the sightings and (r,) of the rings: predicted minus seen, in standard deviations."""
        run, layout = self.run, self.layout
        seen, focal = run.sightings, np.exp(state[0])
        x = self.positions(state)
        depth, _ = _depth(state[layout.landmarks + 2 * self.landmark] - x[seen.frame])
        angle = state[layout.landmarks + 2 * self.landmark + 1]
        across = self._across(state, self._height(state), angle)
        centre = run.frames.centre[seen.frame] + state[layout.centres + 2 * self.centre_node[:, None] + np.arange(2)]
        pixels = centre + focal * np.array([1.0, run.aspect]) * across / depth[:, None]
        ring_depth, _ = _depth(state[layout.joints + self.joint] - x[run.rings.frame])
        ring_focal = focal * np.exp(state[layout.ring_share])
        return (pixels - seen.pixels) / seen.std[:, None], (ring_focal / ring_depth - run.rings.radius_px) / run.rings.std

    def jacobian(self, state: Array) -> Sparse:
        """(2 m + r, size): rows of the u's, then of the v's, then of the rings."""
        run, layout, knots = self.run, self.layout, self.knots
        seen, rings, focal = run.sightings, run.rings, np.exp(state[0])
        x = self.positions(state)
        counted = knots.encoder - knots.encoder[0]
        depth, slope = _depth(state[layout.landmarks + 2 * self.landmark] - x[seen.frame])
        angle = state[layout.landmarks + 2 * self.landmark + 1]
        height = self._height(state)
        across = self._across(state, height, angle)
        outwards = height[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        turned = height[:, None] * np.stack([-np.sin(angle), np.cos(angle)], axis=1)
        blocks = []
        for axis, aspect in enumerate((1.0, run.aspect)):
            by_depth = -focal * aspect * across[:, axis] / depth**2 * slope
            values = np.stack(
                [
                    focal * aspect * across[:, axis] / depth,
                    -by_depth * counted[seen.frame],
                    -by_depth * (1 - knots.share[seen.frame]),
                    -by_depth * knots.share[seen.frame],
                    by_depth,
                    focal * aspect * turned[:, axis] / depth,
                    np.ones_like(depth),
                    focal * aspect / depth,
                    focal * aspect * outwards[:, axis] / depth,
                    focal * aspect * outwards[:, axis] / depth,
                ],
                axis=1,
            )
            columns = np.stack(
                [
                    np.zeros_like(self.landmark),
                    np.ones_like(self.landmark),
                    layout.slack + knots.left[seen.frame],
                    layout.slack + knots.right[seen.frame],
                    layout.landmarks + 2 * self.landmark,
                    layout.landmarks + 2 * self.landmark + 1,
                    layout.centres + 2 * self.centre_node + axis,
                    layout.axes + 2 * self.axis_node + axis,
                    np.full_like(self.landmark, layout.landmark_share),
                    layout.landmark_shares + self.landmark,
                ],
                axis=1,
            )
            blocks.append(_rows(values / seen.std[:, None], columns, layout.size))
        depth, slope = _depth(state[layout.joints + self.joint] - x[rings.frame])
        focal = focal * np.exp(state[layout.ring_share])
        by_depth = -focal / depth**2 * slope
        values = np.stack(
            [
                focal / depth,
                -by_depth * counted[rings.frame],
                -by_depth * (1 - knots.share[rings.frame]),
                -by_depth * knots.share[rings.frame],
                by_depth,
                focal / depth,
            ],
            axis=1,
        )
        columns = np.stack(
            [
                np.zeros_like(self.joint),
                np.ones_like(self.joint),
                layout.slack + knots.left[rings.frame],
                layout.slack + knots.right[rings.frame],
                layout.joints + self.joint,
                np.full_like(self.joint, layout.ring_share),
            ],
            axis=1,
        )
        blocks.append(_rows(values / rings.std[:, None], columns, layout.size))
        return sparse.vstack(blocks, format="csr")

    def _height(self, state: Array) -> Array:
        """(m,) how far from the pipe's axis the sighted points lie, in radii."""
        share = state[self.layout.landmark_share] + state[self.layout.landmark_shares + self.landmark]
        return np.asarray(np.exp(share), dtype=np.float64)

    def _across(self, state: Array, height: Array, angle: Array) -> Array:
        """(m, 2) where the sighted points lie across the camera's axis, in radii."""
        run = self.run
        error = state[self.layout.axes + 2 * self.axis_node[:, None] + np.arange(2)]
        outwards = height[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        across: Array = run.frames.axis[run.sightings.frame] + error + outwards
        return across


def build(run: Run, constraints: Constraints, noise: Noise) -> System:
    """The system of a run of at least one frame."""
    knots = knots_of(run)
    seen, rings = run.sightings, run.rings
    landmark_ids, landmark = np.unique(seen.landmark, return_inverse=True)
    joint_ids, joint = np.unique(rings.joint, return_inverse=True)
    centre_cell, centre_way = nodes_along(knots.way, noise.centre_memory / 2)
    axis_cell, axis_way = nodes_along(knots.way, noise.axis_memory / 4)
    slack = 2
    landmarks = slack + len(knots.frame)
    joints = landmarks + 2 * len(landmark_ids)
    centres = joints + len(joint_ids)
    axes = centres + 2 * len(centre_way)
    ring_share = axes + 2 * len(axis_way)
    share = ring_share + 1
    size = share + 1 + len(landmark_ids)
    layout = Layout(slack, landmarks, joints, centres, axes, ring_share, share, share + 1, size, landmark_ids, joint_ids)

    start = constraints.start or Known(float(knots.encoder[0]), START_STD)
    scale = constraints.scale or Known(1.0, noise.scale_std)
    x = start.value + scale.value * (knots.encoder - knots.encoder[0])
    focal, states, chainages = first_guess(run, x, landmark, joint, constraints.focal_radius)
    log_std = LOOSE_LOG if constraints.focal_radius is None else constraints.focal_radius.std / focal
    initial = np.zeros(layout.size)
    initial[0], initial[1] = np.log(focal), scale.value
    initial[slack:landmarks] = start.value
    initial[landmarks:joints] = states.ravel()
    initial[joints:centres] = chainages

    rows = _Rows(layout.size)
    rows.add([0], [1.0], initial[0], log_std)
    rows.add([1], [1.0], scale.value, scale.std)
    rows.add([layout.ring_share], [1.0], 0.0, max(noise.ring_share, 1e-6))
    rows.add([layout.landmark_share], [1.0], 0.0, max(noise.ring_share, 1e-6))
    for k in range(len(landmark_ids)):
        rows.add([layout.landmark_shares + k], [1.0], 0.0, max(noise.landmark_share, 1e-6))
    rows.add([slack], [1.0], start.value, max(start.std, 1e-4))
    for k in range(len(landmark_ids)):
        rows.add([landmarks + 2 * k], [1.0], initial[landmarks + 2 * k], LOOSE_WAY)
        rows.add([landmarks + 2 * k + 1], [1.0], initial[landmarks + 2 * k + 1], LOOSE_ANGLE)
    for k in range(len(joint_ids)):
        rows.add([joints + k], [1.0], chainages[k], LOOSE_WAY)
    for first, way, std, memory in (
        (centres, centre_way, noise.centre_std, noise.centre_memory),
        (axes, axis_way, noise.axis_std, noise.axis_memory),
    ):
        for side in range(2):
            rows.walk(first + side, way, std, memory)
    if constraints.length is not None:
        counted = knots.encoder[-1] - knots.encoder[0]
        columns, values = [1, slack, landmarks - 1], [counted, -1.0, 1.0]
        rows.add(columns, values, constraints.length.value, max(constraints.length.std, 1e-4))
    for lateral in constraints.laterals:
        for place, name in enumerate(landmark_ids.tolist()):
            if name == lateral.landmark:
                rows.add([landmarks + 2 * place], [1.0], lateral.chainage, max(lateral.std, 1e-4))
    prior, prior_value = rows.done()

    steps = np.arange(len(knots.frame) - 1)
    increments = sparse.csr_matrix(
        (
            np.concatenate([-np.ones(len(steps)), np.ones(len(steps))]),
            (np.concatenate([steps, steps]), np.concatenate([slack + steps, slack + steps + 1])),
        ),
        shape=(len(steps), layout.size),
    )
    return System(
        run,
        knots,
        layout,
        initial,
        prior,
        prior_value,
        increments,
        landmark,
        joint,
        centre_cell[seen.frame],
        axis_cell[seen.frame],
    )


class _Rows:
    """Linear rows value . state = target, each divided by its standard deviation."""

    def __init__(self, size: int) -> None:
        self.size = size
        self.row: list[int] = []
        self.column: list[int] = []
        self.value: list[float] = []
        self.target: list[float] = []

    def add(self, columns: list[int], values: list[float], target: float, std: float) -> None:
        for column, value in zip(columns, values, strict=True):
            self.row.append(len(self.target))
            self.column.append(column)
            self.value.append(value / std)
        self.target.append(target / std)

    def walk(self, first: int, way: Array, std: float, memory: float) -> None:
        """An error of ``std`` that is forgotten over ``memory`` metres (a first-order Gauss-Markov process), every second
        unknown from ``first``."""
        std = max(std, 1e-6)
        self.add([first], [1.0], 0.0, std)
        for k in range(1, len(way)):
            kept = float(np.exp(-(way[k] - way[k - 1]) / memory))
            self.add([first + 2 * k - 2, first + 2 * k], [-kept, 1.0], 0.0, std * float(np.sqrt(1 - kept**2)))

    def done(self) -> tuple[Sparse, Array]:
        shape = (len(self.target), self.size)
        return sparse.csr_matrix((self.value, (self.row, self.column)), shape=shape), np.array(self.target)


def _depth(depth: Array) -> tuple[Array, Array]:
    """Depth kept positive, and its slope: the same from ``NEAREST`` on, falling off exponentially below."""
    low = NEAREST * np.exp(np.minimum(depth / NEAREST, 1.0) - 1)
    # twenty e-folds behind the camera are far enough to be refused
    low = np.maximum(low, NEAREST * np.exp(-20))
    near = depth < NEAREST
    return np.where(near, low, depth), np.where(near, low / NEAREST, 1.0)


def _rows(values: Array, columns: Indices, size: int) -> Sparse:
    count, width = values.shape
    return sparse.csr_matrix((values.ravel(), columns.ravel(), np.arange(count + 1) * width), shape=(count, size))
