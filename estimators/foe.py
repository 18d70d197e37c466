"""The focus of expansion from optical flow (CCTV paper, eqs. 6 and 7), and how it is followed from picture to picture.

The paper solves eq. 7 on the inliers of RANSAC: there long flows count for more than they know, and a camera that pitches moves
every point by nearly the same amount, which shifts the answer. In a pipe more is known: a wall point at the distance rho from
the focus of expansion is at the depth f R / rho, so it moves by k rho (p - c), k = travel / (f R). Fitted with a common
shift (pitch and yaw), a roll, and the slope that a camera off the axis brings, this gives a centre that pitching does not move.
``paper_foe`` is the paper's way, kept to compare and to start from.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from estimators.flow import Flow

Array = NDArray[np.float64]

FEWEST = 12
"""Flows without which no centre is given."""


@dataclass(frozen=True)
class Foe:
    """``centre`` (2,) px with ``covariance`` (2, 2), and the ``inlier_share`` of the ``count`` flows that agree.

    ``rate`` is k of the module's text (1/px): the travel between both pictures over f R. ``shift`` (2,) px is the common motion
    by pitch and yaw, ``slope`` (2,) the axis offset over the radius as far as flow tells. The paper's way leaves them 0.
    """

    centre: Array
    covariance: Array
    inlier_share: float
    count: int
    rate: float = 0.0
    shift: tuple[float, float] = (0.0, 0.0)
    slope: tuple[float, float] = (0.0, 0.0)


@dataclass(frozen=True)
class FoeConfig:
    """Noise, priors and limits of the fit."""

    still: float = 0.25
    """Median motion (px) below which the camera stands."""
    noise: float = 0.12
    """What a flow errs by at least (px), and in the paper's way."""
    most_noise: float = 1.2
    """What it may err by on a smooth wall in a noisy picture (px)."""
    gate: float = 3.0
    """Of an inlier, in standard deviations."""
    trials: int = 150
    """Of RANSAC."""
    shift_std: float = 0.4
    """Prior of the common shift (px a picture)."""
    roll_std: float = 0.003
    """Prior of the roll (rad a picture)."""
    slope_std: float = 0.15
    """Prior of the axis offset over the radius."""
    least_share: float = 0.35
    """Inliers below which the camera turns, or nothing is to be seen."""
    plenty: float = 0.5
    """Share of inliers that asks for no second opinion."""
    least_expansion: float = 3.0
    """What the expansion must exceed, in its standard deviations: else the camera stands, or only turns."""
    most_turn: float = 0.6
    """Share of the common shift in all motion above which the camera turns."""
    alike: float = 1.0
    """How many neighbouring flows err as one."""
    aspect: float = 1.0
    """fx / fy: see ``video_aspect`` where the camera is not known."""


def video_aspect(width: int, height: int) -> float:
    """fx / fy of a camera that is not known, by the size of its picture (px): the sizes of analogue video (PAL, NTSC and
    halves of them) hold 4 : 3 in pixels that are not square, all others are taken as square."""
    analogue = (width, height) in {(w, h) for w in (704, 720) for h in (576, 480)} | {(352, 288), (352, 240)}
    return 0.75 * width / height if analogue else 1.0


def paper_foe(flow: Flow, rng: np.random.Generator, config: FoeConfig | None = None) -> Foe | None:
    """Eqs. 6 and 7: RANSAC over pairs of lines of motion, then plain least squares on the inliers. None with too few."""
    config = config or FoeConfig()
    moving = np.hypot(*flow.motion.T) > config.still if len(flow.motion) else np.zeros(0, bool)
    if np.count_nonzero(moving) < FEWEST:
        return None
    points, motion = flow.points[moving], flow.motion[moving]
    rows, rhs = _lines(points, motion)
    pairs = rng.integers(0, len(points), (config.trials, 2))
    a, b = rows[pairs[:, 0]], rows[pairs[:, 1]]
    determinant = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    good = np.abs(determinant) > 0.05 * np.hypot(*a.T) * np.hypot(*b.T)
    if not good.any():
        return None
    first, second = rhs[pairs[good, 0]], rhs[pairs[good, 1]]
    u = (first * b[good, 1] - a[good, 1] * second) / determinant[good]
    v = (a[good, 0] * second - first * b[good, 0]) / determinant[good]
    # a flow agrees where the motion across its line to the centre is no more than noise
    across = np.abs(np.outer(u, rows[:, 0]) + np.outer(v, rows[:, 1]) - rhs)
    away = np.hypot(u[:, None] - points[:, 0], v[:, None] - points[:, 1])
    agree = across < config.gate * config.noise * away
    inliers = agree[int(np.argmax(agree.sum(axis=1)))]
    if np.count_nonzero(inliers) < FEWEST:
        return None
    centre, *_ = np.linalg.lstsq(rows[inliers], rhs[inliers], rcond=None)
    left = rows[inliers] @ centre - rhs[inliers]
    spread = np.linalg.inv(rows[inliers].T @ rows[inliers])
    covariance = np.asarray(float(left @ left) / len(left) * spread, np.float64)
    return Foe(np.asarray(centre, np.float64), covariance, float(inliers.mean()), len(points))


def _lines(points: Array, motion: Array) -> tuple[Array, Array]:
    """Rows of A and b of eq. 6."""
    rows = np.stack([-motion[:, 1], motion[:, 0]], axis=1)
    return rows, motion[:, 0] * points[:, 1] - motion[:, 1] * points[:, 0]


def estimate(flow: Flow, rng: np.random.Generator, config: FoeConfig | None = None, around: Array | None = None) -> Foe | None:
    """The focus of expansion of one flow; None while the camera stands, turns, or sees too little.

    ``around`` (2,) is where it was last: the place to start from, unless too little agrees with what is found there.
    """
    config = config or FoeConfig()
    if len(flow.points) < FEWEST or flow.length < config.still:
        return None
    square = np.array([1.0, config.aspect])
    seen = Flow(flow.points * square, flow.motion * square, flow.tried, flow.span)
    found = None if around is None else _fit(seen, around * square, config)
    if found is None or found.inlier_share < config.plenty:
        first = paper_foe(seen, rng, config)
        again = None if first is None else _fit(seen, first.centre, config)
        if found is None or (again is not None and again.inlier_share > found.inlier_share):
            found = again
    if found is None:
        return None
    covariance = found.covariance / np.outer(square, square)
    return replace(
        found, centre=found.centre / square, covariance=covariance, shift=(found.shift[0], found.shift[1] / square[1])
    )


def _fit(flow: Flow, start: Array, config: FoeConfig) -> Foe | None:
    """Robust Gauss-Newton on [c_u, c_v, k, shift_u, shift_v, roll, slope_u, slope_v]."""
    points, motion = np.ascontiguousarray(flow.points.T), np.ascontiguousarray(flow.motion.T)
    x = np.zeros(8)
    x[:2] = start
    d = points - start[:, None]
    away = np.hypot(d[0], d[1])
    x[2] = float(np.median((d * motion).sum(axis=0) / np.maximum(away, 1.0) / np.maximum(away, 10.0) ** 2))
    scale = config.shift_std * flow.span, config.roll_std * flow.span
    prior = np.array([0, 0, 0, scale[0] ** -2, scale[0] ** -2, scale[1] ** -2, config.slope_std**-2, config.slope_std**-2])
    units = np.array([1, 1, 1e-5, 1, 1, 1e-3, 1, 1])  # of the parameters, so that the equations are well scaled
    # long flows err by a share of their length as well
    sigma = np.hypot(config.noise, 0.03 * np.hypot(motion[0], motion[1]))
    information = np.eye(8)
    for step in range(10):
        model, jacobian = _model(points, x)
        residual = motion - model
        scaled = np.hypot(residual[0], residual[1]) / sigma
        spread = _spread(scaled, config)
        loosened = max(1.0, 4.0 - step)  # from a rough start the good ones look bad
        weight = 1 / ((1 + (scaled / (2.0 * loosened * spread)) ** 2) * sigma * spread) ** 2
        design = (jacobian * units[:, None, None]).reshape(8, -1)
        weighted = design * np.concatenate([weight, weight])
        information = weighted @ design.T + np.diag(prior * units**2 + 1e-12)
        change = np.linalg.solve(information, weighted @ residual.ravel() - prior * units * x) * units
        change[:2] = np.clip(change[:2], -60, 60)
        x = x + change
        if np.abs(change[:2]).max() < 0.1 and step >= 3:
            break
    if not np.isfinite(x).all():
        return None
    residual = motion - _model(points, x)[0]
    scaled = np.hypot(residual[0], residual[1]) / sigma
    inliers = scaled < config.gate * _spread(scaled, config)
    share = float(inliers.mean())
    expansion = float(np.median(np.hypot(motion[0] - x[3], motion[1] - x[4])))
    turn = float(np.hypot(x[3], x[4]))
    turning = turn > config.most_turn * (turn + expansion)
    if share < config.least_share or turning or np.count_nonzero(inliers) < FEWEST:
        return None
    covariance = np.asarray(np.linalg.inv(information) * config.alike, np.float64)
    if abs(x[2]) < config.least_expansion * np.sqrt(covariance[2, 2]) * units[2]:
        return None
    return Foe(
        x[:2], covariance[:2, :2], share, points.shape[1], float(x[2]), (float(x[3]), float(x[4])), (float(x[6]), float(x[7]))
    )


def _spread(scaled: Array, config: FoeConfig) -> float:
    """How much larger the noise of this picture is than the least, by the median of ``scaled`` (n,) lengths of residuals."""
    return float(np.clip(np.median(scaled) / np.sqrt(2 * np.log(2)), 1.0, config.most_noise / config.noise))


def _model(points: Array, x: Array) -> tuple[Array, Array]:
    """Motion (2, n) of wall ``points`` (2, n) and its Jacobian (8, 2, n)."""
    d = points - x[:2, None]
    du, dv = d
    rho = np.maximum(np.hypot(du, dv), 1e-6)
    unit = d / rho
    along = x[6] * unit[0] + x[7] * unit[1]
    lean = 1 - along
    expansion = rho * lean * d
    model = x[2] * expansion
    model[0] += x[3] - x[5] * dv
    model[1] += x[4] + x[5] * du
    jacobian = np.empty((8, 2, points.shape[1]))
    # d(rho lean d)/dd = lean (unit d^T + rho I) - d (slope - (slope . unit) unit)^T, and dd/dc = -I
    for k in range(2):
        across = x[6 + k] - along * unit[k]
        jacobian[k] = -x[2] * (lean * unit[k] - across) * d
        jacobian[k, k] -= x[2] * lean * rho
        jacobian[3 + k, k], jacobian[3 + k, 1 - k] = 1, 0
        jacobian[6 + k] = -x[2] * d[k] * d
    jacobian[0, 1] -= x[5]
    jacobian[1, 0] += x[5]
    jacobian[2] = expansion
    jacobian[5, 0], jacobian[5, 1] = -dv, du
    return model, jacobian


@dataclass(frozen=True)
class FollowConfig:
    """How the centre moves and what is believed of a measurement."""

    jolt: float = 0.01
    """Change of the centre's speed (px per picture, each picture)."""
    gate: float = 16.0
    """Square of the normalised innovation above which a measurement is left out."""
    floor: float = 2.0
    """What every measurement errs by (px), whatever its covariance says."""
    common: float = 3.0
    """What all measurements of a stretch err by alike (px), which following does not take away."""
    lost_after: int = 15
    """Measurements left out in a row after which the follower begins anew."""
    wide: float = 60.0
    """Standard deviation (px) before anything was seen."""


class Follower:
    """A Kalman filter of constant velocity on the centre: no lag behind a drift, held while the crawler stands."""

    def __init__(self, centre: tuple[float, float], config: FollowConfig | None = None) -> None:
        """``centre`` (px) is where it is taken to be before anything was seen: the middle of the picture."""
        self._config = config or FollowConfig()
        self._begin(np.asarray(centre, np.float64), self._config.wide)

    def _begin(self, centre: Array, std: float) -> None:
        self._state = np.r_[centre, 0.0, 0.0]
        self._covariance = np.diag([std**2, std**2, 0.3**2, 0.3**2])
        self._rejected = 0

    @property
    def centre(self) -> tuple[float, float]:
        """(u, v) px."""
        return float(self._state[0]), float(self._state[1])

    @property
    def covariance(self) -> Array:
        """(2, 2) of ``centre``."""
        return np.asarray(self._covariance[:2, :2] + self._config.common**2 * np.eye(2), np.float64)

    def update(self, foe: Foe | None, moving: bool, pictures: int = 1) -> tuple[tuple[float, float], Array]:
        """Go on by ``pictures``; what ``foe`` says is taken in while the crawler is ``moving``. (centre, covariance)."""
        if not moving:
            self._state[2:] = 0.0
            return self.centre, self.covariance
        step = np.eye(4)
        step[:2, 2:] = pictures * np.eye(2)
        self._state = step @ self._state
        q, n = self._config.jolt**2, float(pictures)
        noise = q * np.block([[n**3 / 3 * np.eye(2), n**2 / 2 * np.eye(2)], [n**2 / 2 * np.eye(2), n * np.eye(2)]])
        self._covariance = step @ self._covariance @ step.T + noise
        if foe is not None:
            self._take_in(foe)
        return self.centre, self.covariance

    def _take_in(self, foe: Foe) -> None:
        innovation = foe.centre - self._state[:2]
        spread = self._covariance[:2, :2] + foe.covariance + self._config.floor**2 * np.eye(2)
        if innovation @ np.linalg.solve(spread, innovation) > self._config.gate:
            self._rejected += 1
            if self._rejected >= self._config.lost_after:
                self._begin(foe.centre, self._config.wide)
            return
        self._rejected = 0
        gain = self._covariance[:, :2] @ np.linalg.inv(spread)
        self._state = self._state + gain @ innovation
        self._covariance = self._covariance - gain @ self._covariance[:2]
        self._covariance = 0.5 * (self._covariance + self._covariance.T)
