"""Slips: the tether's slack between two knots is nearly always nothing and seldom a lot.

Such a spike-and-slab prior has no normal distribution; expectation propagation (Minka 2001) stands in for each interval's prior
the normal distribution that, together with all the rest of the run, has the mean and variance the true prior would give. Where
nothing is in view the rest says nothing and the whole variance of the prior stays: a slip there cannot be seen, and the map
says so by its covariance.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estimators.landmarks.smoothing.knots import Knots
from estimators.landmarks.smoothing.types import Array, Noise, Run, Slip

STANDING_SPEED = 0.02
"""A crawler whose tether stands counts as going so fast (m/s) when slips are expected by the metre."""
SMALLEST = 2e-4
"""Standard deviation (m) of an interval at rest: keeps the system regular."""
DAMPING = 0.8
UPDATES = 3
"""At most so many updates per interval and call."""
SETTLED = 0.01
PATIENCE = 3.0
FURTHEST = 3.0
"""Where the mean of a stand-in may lie, in standard deviations of a slip."""
SUSPECTED = 0.5
LIKELY = 0.5


@dataclass(frozen=True)
class SlipPrior:
    """Per interval (K - 1,): variance without a slip, variance with one, and its chance."""

    spike: Array
    slab: Array
    chance: Array

    @property
    def variance(self) -> Array:
        return (1 - self.chance) * self.spike + self.chance * self.slab


@dataclass(frozen=True)
class Sites:
    """The normal stand-in of each interval's prior: ``precision`` and ``precision * mean`` (K - 1,); ``slipped`` the chance of
    a slip after all is seen; ``visits`` how often it was set: two that cannot agree come to rest by ever smaller steps."""

    precision: Array
    shift: Array
    slipped: Array
    visits: Array


def slip_prior(run: Run, knots: Knots, noise: Noise) -> SlipPrior:
    way, time = np.diff(knots.way[knots.frame]), np.diff(run.frames.time_s[knots.frame])
    chance = 1 - np.exp(-noise.slip_rate * (way + STANDING_SPEED * np.maximum(time, 0.0)))
    ends = run.frames.time_s[knots.frame]
    for moment in run.suspected:
        hit = (ends[:-1] <= moment) & (moment <= ends[1:])
        chance = np.where(hit, np.maximum(chance, SUSPECTED), chance)
    chance = np.where(knots.gap, np.maximum(chance, SUSPECTED), chance)
    spike = noise.drift**2 * way + SMALLEST**2
    return SlipPrior(spike, spike + noise.slip_std**2, np.minimum(chance, 0.99))


def start_sites(prior: SlipPrior) -> Sites:
    """Mean and variance of the prior itself: what it says before anything is seen."""
    return Sites(1 / prior.variance, np.zeros_like(prior.spike), prior.chance, np.zeros_like(prior.spike))


def update_sites(sites: Sites, prior: SlipPrior, mean: Array, covariance: Array) -> Sites:
    """Expectation propagation on the slack's increments (K - 1,), of present ``mean`` and ``covariance``, all else being normal.

    The interval whose prior fits worst is always next: a clear slip is settled before its neighbours share it.
    """
    mean, covariance = mean.copy(), covariance.copy()
    precision, shift, visits = sites.precision.copy(), sites.shift.copy(), sites.visits.copy()
    for _ in range(UPDATES * len(mean)):
        spread = np.maximum(np.diag(covariance), 1e-14)
        wanted_precision, wanted_shift, _ = _moments(prior, mean, spread, precision, shift)
        more, further = wanted_precision - precision, wanted_shift - shift
        new_spread = spread / (1 + more * spread)
        new_mean = new_spread * (mean / spread + further)
        change = np.abs(new_mean - mean) / np.sqrt(spread) + np.abs(np.log(new_spread / spread))
        part = DAMPING / (1 + visits / PATIENCE)
        change *= part
        k = int(np.argmax(change))
        if change[k] < SETTLED:
            break
        more_k, further_k = part[k] * more[k], part[k] * further[k]
        visits[k] += 1
        column = covariance[:, k] / (1 + more_k * spread[k])
        mean = mean + column * (further_k - more_k * mean[k])
        covariance = covariance - np.outer(column * more_k, covariance[:, k])
        precision[k] += more_k
        shift[k] += further_k
    slipped = _moments(prior, mean, np.maximum(np.diag(covariance), 1e-14), precision, shift)[2]
    return Sites(precision, shift, slipped, visits)


def _moments(prior: SlipPrior, mean: Array, spread: Array, precision: Array, shift: Array) -> tuple[Array, Array, Array]:
    """The normal factor (precision, precision * mean) that each true prior asks for, and the chance of a slip, given the rest
    of the run: the present marginal without the present factor."""
    rest = np.maximum(1 / spread - precision, 1e-6)
    rest_mean = (mean / spread - shift) / rest
    variance = 1 / rest
    none, some = variance + prior.spike, variance + prior.slab
    odds = np.log(prior.chance / (1 - prior.chance)) + 0.5 * np.log(none / some)
    odds += 0.5 * rest_mean**2 * (1 / none - 1 / some)
    slipped = 1 / (1 + np.exp(-np.clip(odds, -500, 500)))
    small, large = rest_mean * prior.spike / none, rest_mean * prior.slab / some
    new_mean = (1 - slipped) * small + slipped * large
    second = (1 - slipped) * (variance * prior.spike / none + small**2)
    second += slipped * (variance * prior.slab / some + large**2)
    new_variance = np.maximum(second - new_mean**2, 1e-14)
    # half slipped, half not is wider than the rest alone, which no normal factor can say: the weakest there is stands in
    new_precision = np.clip(1 / new_variance - rest, 1 / (4 * prior.slab), 1 / prior.spike)
    furthest = FURTHEST * np.sqrt(prior.slab) * new_precision
    new_shift = np.clip(new_mean * (new_precision + rest) - rest * rest_mean, -furthest, furthest)
    return new_precision, new_shift, slipped


def report(
    run: Run, knots: Knots, sites: Sites, prior: SlipPrior, slack: Array, covariance: Array, positions: Array
) -> tuple[Slip, ...]:
    """Slips found: neighbouring intervals that share one are told as one. ``slack`` (K,) with ``covariance`` (K, K)."""
    raised = sites.slipped > np.maximum(3 * prior.chance, 0.02)
    found, k = [], 0
    while k < len(raised):
        if not raised[k]:
            k += 1
            continue
        end = k
        while end + 1 < len(raised) and raised[end + 1]:
            end += 1
        probability = float(1 - np.prod(1 - sites.slipped[k : end + 1]))
        first, last = k, end + 1
        metres = float(slack[last] - slack[first])
        std = float(np.sqrt(max(covariance[first, first] + covariance[last, last] - 2 * covariance[first, last], 0.0)))
        if probability > LIKELY:
            start, stop = int(knots.frame[first]), int(knots.frame[last])
            time = run.frames.time_s
            chainage = float((positions[start] + positions[stop]) / 2)
            found.append(Slip(float(time[start]), float(time[stop]), chainage, metres, std, probability))
        k = end + 1
    return tuple(found)
