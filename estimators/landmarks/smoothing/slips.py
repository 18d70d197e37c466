"""Slips: the tether's slack between two knots is nearly always next to nothing and seldom a lot (a spike-and-slab prior).

Given which intervals slipped, all else is linear and normal, so the question is only *which*. The best answer is found by
climbing, and all answers worth considering are weighed by a Markov chain over them that is never refused a step (Zanella 2020,
with Barker's rates): each set of slips counts by the time the chain stays with it, with its exact mean and covariance. Where
nothing is in view all answers stay open, and the map says so by its covariance.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimators.landmarks.smoothing.knots import Knots
from estimators.landmarks.smoothing.types import Array, Noise, Run, Slip

Flags = NDArray[np.bool_]

STANDING_SPEED = 0.02
"""A crawler whose tether stands counts as going so fast (m/s) when slips are expected by the metre."""
SMALLEST = 5e-4
"""Standard deviation (m) of an interval at rest: keeps the system regular."""
SUSPECTED = 0.5
LIKELY = 0.5
CLIMBS = 40
LONG = 300.0
"""Time after which the chain has seen enough: an interval that may have slipped or not is asked about once in a unit."""
STEPS, FEWEST, WORK = 2000, 300, 3e8
"""Steps of the chain, fewer where there are many intervals: their number times the intervals' square is no more than WORK."""


@dataclass(frozen=True)
class SlipPrior:
    """Per interval (K - 1,): variance without a slip, variance with one, and its chance."""

    spike: Array
    slab: Array
    chance: Array

    def variance(self, slipped: Flags) -> Array:
        return np.where(slipped, self.slab, self.spike)


@dataclass(frozen=True)
class Slack:
    """The slack's increments after all is seen: ``mean`` (K - 1,), ``covariance`` (K - 1, K - 1), chance of each slip."""

    mean: Array
    covariance: Array
    chance: Array


def slip_prior(run: Run, knots: Knots, noise: Noise) -> SlipPrior:
    ends = run.frames.time_s[knots.frame]
    way, time = np.diff(knots.way[knots.frame]), np.maximum(np.diff(ends), 0.0)
    chance = 1 - np.exp(-noise.slip_rate * (way + STANDING_SPEED * time))
    for moment in run.suspected if len(chance) else ():
        k = int(np.clip(np.searchsorted(ends, moment, side="right") - 1, 0, len(chance) - 1))
        chance[k] = max(chance[k], SUSPECTED)
    chance = np.where(knots.gap, np.maximum(chance, SUSPECTED), chance)
    spike = noise.drift**2 * way + SMALLEST**2
    return SlipPrior(spike, spike + noise.slip_std**2, np.clip(chance, 1e-9, 0.99))


def learned(prior: SlipPrior, chance: Array, noise: Noise) -> SlipPrior:
    """``prior`` with the rate of slips that this run shows by the ``chance`` of each. What nothing was seen of keeps the rate
    that was believed before."""
    ratio = (noise.slip_experience + chance.sum()) / (noise.slip_experience + prior.chance.sum())
    return SlipPrior(prior.spike, prior.slab, np.clip(prior.chance * np.clip(ratio, 0.3, 3.0), 1e-9, 0.99))


def climb(prior: SlipPrior, slipped: Flags, mean: Array, free: Array) -> tuple[Flags, Array]:
    """The likeliest set of slips near ``slipped``, and the chance of each given the others. ``mean`` (K - 1,) is that of the
    increments under ``slipped``, ``free`` (K - 1, K - 1) their covariance were all of them slips."""
    state = _State(prior, slipped, mean, free)
    for _ in range(CLIMBS):
        gain = np.where(state.slipped, -1.0, 1.0) * state.odds()
        k = int(np.argmax(gain))
        if gain[k] <= 0:
            break
        state.flip(k)
    return state.slipped, 1 / (1 + np.exp(-state.odds()))


def weigh_all(prior: SlipPrior, slipped: Flags, mean: Array, free: Array, rng: np.random.Generator) -> Slack:
    """The increments over all sets of slips, starting from ``slipped``; ``mean`` and ``free`` as for ``climb``."""
    if len(mean) == 0:
        return Slack(mean, free, prior.chance)
    state = _State(prior, slipped, mean, free)
    steps = int(np.clip(WORK / max(len(mean), 1) ** 2, FEWEST, STEPS))
    total, first, second, chance = 0.0, np.zeros_like(mean), np.zeros_like(free), np.zeros_like(mean)
    for _ in range(steps):
        yes = 1 / (1 + np.exp(-state.odds()))
        rate = np.where(state.slipped, 1 - yes, yes)
        time = 1 / rate.sum()
        now, covariance = state.increments()
        total += time
        first += time * now
        second += time * (covariance + np.outer(now, now))
        chance += time * yes
        if total > LONG:
            break
        chosen = np.searchsorted(np.cumsum(rate), rng.uniform() * rate.sum())
        state.flip(int(min(chosen, len(rate) - 1)))
    mean = first / total
    return Slack(mean, second / total - np.outer(mean, mean), chance / total)


class _State:
    """Increments under one set of slips, as what the rest of the run says of them.

    With variances V of the prior and L of the rest, the rest expects y: ``pull`` is W y and ``weight`` W = (V + L)^-1, both of
    which stay small where nothing is known and exact where V is next to nothing. The covariance itself, V - V W V, does
    neither: an interval at rest that nothing was seen of has one that differs from its prior by less than a double can tell,
    and to free it divides by that difference.
    """

    def __init__(self, prior: SlipPrior, slipped: Flags, mean: Array, free: Array) -> None:
        self.prior, self.slipped = prior, slipped.copy()
        self.pull = mean / prior.variance(slipped)
        wide = prior.slab
        weight = (np.diag(wide) - (free + free.T) / 2) / np.outer(wide, wide)
        rest = np.flatnonzero(~slipped)
        narrower = np.diag(1 / (wide - prior.spike)[rest]) - weight[np.ix_(rest, rest)]
        self.weight = weight + weight[:, rest] @ np.linalg.solve(narrower, weight[rest])

    def increments(self) -> tuple[Array, Array]:
        """Their mean (K - 1,) and covariance (K - 1, K - 1)."""
        variance = self.prior.variance(self.slipped)
        return variance * self.pull, np.diag(variance) - np.outer(variance, variance) * self.weight

    def odds(self) -> Array:
        """ln odds (K - 1,) that each interval slipped, given all that was seen and which others did."""
        prior = self.prior
        wider, share = self._change()
        gain = 0.5 * (wider * self.pull**2 / share - np.log(share))
        odds = np.log(prior.chance / (1 - prior.chance)) + np.where(self.slipped, -gain, gain)
        return np.asarray(np.clip(odds, -300, 300), dtype=np.float64)

    def flip(self, k: int) -> None:
        wider, share = self._change()
        column = self.weight[:, k] * (wider[k] / share[k])
        self.pull = self.pull - column * self.pull[k]
        self.weight = self.weight - np.outer(column, self.weight[:, k])
        self.slipped[k] = not self.slipped[k]

    def _change(self) -> tuple[Array, Array]:
        """By how much (K - 1,) each variance would grow if its interval were flipped, and how much that of what the rest
        expects would be of what it is: no less than the share that its prior would be."""
        before, after = self.prior.variance(self.slipped), self.prior.variance(~self.slipped)
        return after - before, np.maximum(1 + (after - before) * np.diag(self.weight), np.minimum(after / before, 1.0))


def report(run: Run, knots: Knots, slack: Slack, prior: SlipPrior, positions: Array) -> tuple[Slip, ...]:
    """Slips found: neighbouring intervals that may share one are told as one."""
    raised = slack.chance > np.maximum(3 * prior.chance, 0.03)
    # an interval between two raised ones belongs to them
    raised[1:-1] |= raised[:-2] & raised[2:]
    edges = np.flatnonzero(np.diff(np.concatenate([[0], raised.astype(np.int64), [0]])))
    found = []
    for first, last in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
        probability = float(min(slack.chance[first:last].sum(), 1.0))
        if probability < LIKELY:
            continue
        metres = float(slack.mean[first:last].sum())
        std = float(np.sqrt(max(slack.covariance[first:last, first:last].sum(), 0.0)))
        start, stop = int(knots.frame[first]), int(knots.frame[last])
        time = run.frames.time_s
        chainage = float((positions[start] + positions[stop]) / 2)
        found.append(Slip(float(time[start]), float(time[stop]), chainage, metres, std, probability))
    return tuple(found)
