"""A recording of N frames to one diameter with its interval, and the proxies of the paper's Table 2."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimators.cylinder import CylinderFit
from estimators.frame import KEPT_SHARE, FrameEstimate

MIN_FRAMES_FOR_SPREAD = 5
"""Below this the spread between frames says nothing, and the resampled fits stand in for it."""
_TO_FULL_SAMPLE = KEPT_SHARE / (1 - KEPT_SHARE)
"""Fits to a share of the blocks differ less from the whole than new data would: variance of the one over the other."""
PROXIES = ("inlier_share", "mse", "radius", "orientation")


@dataclass(frozen=True)
class ErrorModel:
    """What the spread cannot show. ``scale_std``: relative scale error of the camera and its window. ``fit_factor``: how much
    larger the error of the wall's mean radius is than ``CylinderFit.mean_std`` says. ``shape_factor``: how much of
    ``CylinderFit.mean_shift``, by which the circle seems to miss the mean of a wall that is not round, counts as an error of
    the circle. The circle itself is not moved: in the pipes that are round, which are most, the shift is noise."""

    scale_std: float = 0.004
    fit_factor: float = 1.0
    shape_factor: float = 0.8


@dataclass(frozen=True)
class Support:
    """Medians over the frames of what ``CylinderFit`` says of the wall that was seen; ``taper`` without its sign."""

    area: float
    coverage: float
    inlier_count: float
    inside: float
    length: float
    taper: float
    out_of_round: float


NO_SUPPORT = Support(area=0.0, coverage=0.0, inlier_count=0.0, inside=0.0, length=0.0, taper=0.0, out_of_round=0.0)


@dataclass(frozen=True)
class RecordingEstimate:
    """One recording. Metres; ``nan`` where nothing could be fitted.

    ``diameter`` is the median over frames, ``mean`` and ``inlier_weighted_mean`` (eq. 8 over the sum of the *weights*) stand
    beside it.
    ``radius_std`` is the spread of the radius between frames, or between resampled fits where there are few frames.
    ``proxies`` holds (mean, standard deviation) of each of PROXIES. ``sway`` (m) is how far the axis moved across itself
    between frames.
    """

    frames: int
    fitted: int
    diameter: float
    mean: float
    inlier_weighted_mean: float
    radius_std: float
    interval: tuple[float, float]
    proxies: dict[str, tuple[float, float]]
    sway: float
    valid_share: float
    support: Support
    typical: FrameEstimate | None


def combine(frames: Sequence[FrameEstimate], errors: ErrorModel | None = None) -> RecordingEstimate:
    """Combine the frames of one recording (one position, one camera)."""
    errors = errors or ErrorModel()
    nan = float("nan")
    fits = [(frame, frame.fit) for frame in frames if frame.fit is not None]
    valid_share = float(np.mean([frame.valid_share for frame in frames])) if frames else 0.0
    if not fits:
        empty = dict.fromkeys(PROXIES, (nan, nan))
        return RecordingEstimate(len(frames), 0, nan, nan, nan, nan, (nan, nan), empty, nan, valid_share, NO_SUPPORT, None)
    radii = np.array([fit.radius for _, fit in fits])
    shares = np.array([fit.inlier_share for _, fit in fits])
    radius = float(np.median(radii))
    radius_std = _spread(radii, [frame for frame, _ in fits], radius)
    typical, _ = min(fits, key=lambda pair: abs(pair[1].radius - radius))
    proxies = {name: _proxy(name, [frame for frame, _ in fits]) for name in PROXIES}
    proxies["radius"] = (proxies["radius"][0], radius_std)
    return RecordingEstimate(
        frames=len(frames),
        fitted=len(fits),
        diameter=2 * radius,
        mean=2 * float(radii.mean()),
        inlier_weighted_mean=2 * float((radii * shares).sum() / max(shares.sum(), 1e-9)),
        radius_std=radius_std,
        interval=_interval(radius, radius_std, [fit for _, fit in fits], errors),
        proxies=proxies,
        sway=_sway(np.array([fit.axis for _, fit in fits]), np.array([fit.point for _, fit in fits])),
        valid_share=valid_share,
        support=Support(
            area=_median([fit.area for _, fit in fits]),
            coverage=_median([fit.coverage for _, fit in fits]),
            inlier_count=_median([fit.inlier_count for _, fit in fits]),
            inside=_median([fit.inside for _, fit in fits]),
            length=_median([fit.length for _, fit in fits]),
            taper=_median([abs(fit.taper) for _, fit in fits]),
            out_of_round=_median([fit.out_of_round for _, fit in fits]),
        ),
        typical=typical,
    )


def _median(values: Sequence[float]) -> float:
    return float(np.median(values))


def _spread(radii: NDArray[np.float64], frames: Sequence[FrameEstimate], radius: float) -> float:
    """Standard deviation of the radius between frames, or of all resampled fits where there are too few; a failed one counts
    as all wrong."""
    if len(radii) >= MIN_FRAMES_FOR_SPREAD:
        return float(np.std(radii, ddof=1))
    resampled = np.array([np.nan if fit is None else fit.radius for frame in frames for fit in frame.resampled])
    fit_std = float(np.median([frame.fit.radius_std for frame in frames if frame.fit is not None]))
    if len(resampled) == 0:
        return max(fit_std, float(np.std(radii)))
    deviation = np.where(np.isfinite(resampled), resampled - radius, radius)
    return float(np.hypot(np.sqrt(np.mean(deviation**2) * _TO_FULL_SAMPLE), fit_std))


def _proxy(name: str, frames: Sequence[FrameEstimate]) -> tuple[float, float]:
    """Mean of one of PROXIES over the frames, and its standard deviation between them, or between resampled fits where there
    are too few."""
    values = np.array([getattr(frame.fit, name) for frame in frames])
    if len(values) >= MIN_FRAMES_FOR_SPREAD:
        return float(values.mean()), float(np.std(values, ddof=1))
    resampled = np.array([getattr(fit, name) for frame in frames for fit in frame.resampled if fit is not None])
    std = float("nan") if len(resampled) < 2 else float(np.sqrt(_TO_FULL_SAMPLE) * np.std(resampled, ddof=1))
    return float(values.mean()), std


def _interval(radius: float, radius_std: float, fits: Sequence[CylinderFit], errors: ErrorModel) -> tuple[float, float]:
    """95 % interval of the diameter. The frames of one recording share the errors of their fits and of the camera, so only the
    spread between them shrinks with their number."""
    between = radius_std / np.sqrt(len(fits)) if len(fits) >= MIN_FRAMES_FOR_SPREAD else radius_std
    fit = _median([fit.radius_std for fit in fits])
    mean = errors.fit_factor * _median([fit.mean_std for fit in fits])
    shape = errors.shape_factor * _median([fit.mean_shift for fit in fits])
    scale = errors.scale_std * radius
    half = 1.96 * 2 * float(np.linalg.norm([between, fit, mean, shape, scale]))
    return max(2 * radius - half, 0.0), 2 * radius + half


def _sway(axes: NDArray[np.float64], points: NDArray[np.float64]) -> float:
    """Median move (m) of the axis between consecutive frames, seen at 0.5 m: sideways shift and swing together."""
    if len(axes) < 2:
        return 0.0
    at = points + axes * ((0.5 - points[:, 2]) / axes[:, 2])[:, None]
    return float(np.median(np.linalg.norm(np.diff(at, axis=0), axis=1)))
