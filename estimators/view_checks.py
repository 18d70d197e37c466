"""What hinders the survey, read from picture, flow and counter: each check gives its code, whether it fails, and numbers.

How far the picture moved is told in ``expansion``: the motion (px) of a wall point whose distance from the focus of expansion
is a quarter of the picture's diagonal. It comes from the fit of ``foe``, so that a camera that pans, text laid over the picture
and water that flows do not count as driving.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

from estimators.flow import Flow
from estimators.foe import Foe

Array = NDArray[np.float64]
Gray = NDArray[np.uint8]

DARK_LEVEL = 40.0
"""Grey level that the brightest tenth of a lit wall exceeds: the middle of the picture is always dark."""
BRIGHT_LEVEL, BRIGHT_SHARE = 250, 0.25
"""Share of the picture without drawing from which it is over-exposed."""
SNOW_CORRELATION = 0.5
"""Neighbouring pixels of a picture are more alike than this; those of snow are not."""
FLAT_STD = 2.5
"""Grey levels of a blank screen; the darkest pipe with a light in it has more."""
LOST_SHARE = 0.6
"""Share of textured points that a fast drive loses."""
FEWEST = 30
"""Textured points without which nothing is said about flow."""
FAR_OFF = 0.4
"""Of the radius."""
LOOKS_ASIDE = 0.2
"""Of the picture's diagonal, from its middle to the focus of expansion."""
DIRT_SHARE = 0.03
"""Share of the picture that stands while the rest moves from which the lens is dirty."""
MOST_PX_PER_METRE, LEAST_PX_PER_METRE = 1500.0, 100.0
"""Expansion for each metre, from a narrow pipe to a wide one, where it has not been learnt."""


@dataclass(frozen=True)
class Check:
    """``code`` as the prompts have it, whether it is ``failed``, and the ``numbers`` that say why."""

    code: str
    failed: bool
    numbers: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Way:
    """The last seconds as counter and picture tell them: ``travel`` (m), the counter's step ``quantum`` (m), ``expansion`` (px)
    with the sign of the motion, and how much of that a metre makes, None where it is not known."""

    travel: float
    quantum: float
    expansion: float
    px_per_metre: float | None = None


def expansion(foe: Foe, shape: tuple[int, ...]) -> float:
    """Motion (px) of a wall point a quarter of the diagonal of ``shape`` (H, W) away from the focus of expansion."""
    return foe.rate * (0.25 * float(np.hypot(shape[0], shape[1]))) ** 2


def slip(way: Way) -> Check:
    """The picture moves by more than the counter can have missed: the tether slips."""
    most = 3.0 * way.px_per_metre if way.px_per_metre else MOST_PX_PER_METRE
    explained = 12.0 + most * (abs(way.travel) + way.quantum)
    return Check("slip", abs(way.expansion) > explained, {"expansion_px": way.expansion, "explained_px": explained})


def image_stands(way: Way) -> Check:
    """The counter runs and the picture does not: the cable is pulled, or the crawler's wheels turn on the spot."""
    least = way.px_per_metre or LEAST_PX_PER_METRE
    travel = abs(way.travel) - way.quantum
    expected = least * max(travel, 0.0)
    failed = travel > 0.05 and abs(way.expansion) < 0.2 * expected
    return Check("image_stands", failed, {"expansion_px": way.expansion, "expected_px": expected, "travel_m": way.travel})


def too_fast(flow: Flow, shape: tuple[int, ...]) -> Check:
    """The flow is too long to be followed, or most textured points are not found again. ``shape`` (H, W) of the picture."""
    lost = 1 - len(flow.points) / flow.tried if flow.tried else 0.0
    longest = float(np.quantile(np.hypot(*flow.motion.T), 0.9)) if len(flow.motion) else 0.0
    limit = 0.055 * float(shape[1])
    failed = flow.tried >= FEWEST and (lost > LOST_SHARE or longest > limit)
    return Check("too_fast", failed, {"lost_share": lost, "longest_px": longest, "limit_px": limit})


def too_dark(gray: Gray) -> Check:
    """Even the lit part of the picture (H, W) is dark."""
    level = float(np.percentile(gray[::8, ::8], 90))
    return Check("too_dark", level < DARK_LEVEL, {"level": level})


def too_bright(gray: Gray) -> Check:
    """Much of the picture (H, W) is white."""
    share = float((gray[::8, ::8] >= BRIGHT_LEVEL).mean())
    return Check("too_bright", share > BRIGHT_SHARE, {"share": share})


def off_axis(centre: tuple[float, float], shape: tuple[int, ...], axis: tuple[float, float] = (0.0, 0.0)) -> Check:
    """The camera looks aside or rides far off the pipe's axis. ``centre`` (px) is the focus of expansion in the picture of
    ``shape`` (H, W), ``axis`` the pipe's axis as seen from the camera in radii, as rings tell it."""
    aside = float(np.hypot(centre[0] - (shape[1] - 1) / 2, centre[1] - (shape[0] - 1) / 2) / np.hypot(shape[0], shape[1]))
    offset = float(np.hypot(*axis))
    return Check("off_axis", aside > LOOKS_ASIDE or offset > FAR_OFF, {"aside": aside, "offset": offset})


def signal_lost(gray: Gray, previous: Gray | None = None, travel: float = 0.0) -> Check:
    """No picture of a pipe: a blank screen, snow, or one that froze, to the last bit, while the counter ran by ``travel`` (m)
    since ``previous``. A pipe without light is not lost but dark."""
    sample = gray[::8].astype(np.float32)
    level, spread = (float(value.item()) for value in cv2.meanStdDev(sample))
    sample -= np.float32(level)
    alike = float(np.vdot(sample[:, :-1], sample[:, 1:])) / max(float(np.vdot(sample, sample)), 1e-6)
    same = previous is not None and bool(np.array_equal(gray, previous))
    blank = spread < FLAT_STD
    snow = not blank and spread > 15 and alike < SNOW_CORRELATION
    frozen = same and abs(travel) > 0.05
    numbers = {"spread": spread, "alike": alike, "level": level, "frozen": float(frozen)}
    return Check("signal_lost", blank or snow or frozen, numbers)


@dataclass(frozen=True)
class Standing:
    """What of the pictures of a drive stands still, at a quarter of their size: ``signed`` and ``size`` (h, w) are sums over
    ``pictures`` of the brightness's slope along the way of the wall, with and without its sign."""

    signed: NDArray[np.float32]
    size: NDArray[np.float32]
    pictures: int = 1


PICTURES_FOR_DIRT = 15
"""Pictures, each of another place, without which nothing is said about dirt."""
_DIRT_SLOPE = 3.0
"""Grey levels in four pixels: what stands out of noise and compression."""
_TEXT_SLOPE = 45.0
"""What only text laid over the picture has, the sharpest there is."""


def standing(gray: Gray, centre: tuple[float, float], before: Standing | None = None) -> Standing:
    """Take in one picture (H, W) of a drive, some pixels of motion after the last one taken in.

    Only the slope outwards from ``centre`` (px) counts: a water line or a crack along the pipe stands in the picture of a
    clean lens too. What is larger than a tenth of the picture, the lamp's light and the dark end, is taken off before.
    """
    small = cv2.resize(gray, None, fx=0.25, fy=0.25, interpolation=cv2.INTER_AREA).astype(np.float32)
    fine = cv2.GaussianBlur(small, (0, 0), 1.0) - cv2.blur(small, (small.shape[1] // 10,) * 2)
    across = cv2.Sobel(fine, cv2.CV_32F, 1, 0, scale=0.25)
    down = cv2.Sobel(fine, cv2.CV_32F, 0, 1, scale=0.25)
    u = np.arange(small.shape[1], dtype=np.float32) - np.float32((centre[0] - 1.5) / 4)
    v = np.arange(small.shape[0], dtype=np.float32)[:, None] - np.float32((centre[1] - 1.5) / 4)
    away = np.sqrt(u * u + v * v)
    slope = np.asarray((across * u + down * v) / np.maximum(away, 1.0), np.float32)
    # near the centre nothing moves
    slope[away < 0.15 * np.hypot(*small.shape)] = 0
    if before is None or before.signed.shape != slope.shape:
        return Standing(slope, np.abs(slope))
    return Standing(before.signed + slope, before.size + np.abs(slope), before.pictures + 1)


def dirty_lens(seen: Standing, text: NDArray[np.bool_] | None = None) -> Check:
    """Structure that stands while the wall moves. ``text`` (h, w) are the quarter-size pixels known to be laid over the
    picture; text is known by its sharpness too."""
    mean, size = np.abs(seen.signed) / seen.pictures, seen.size / seen.pictures
    stands = (mean > _DIRT_SLOPE) & (mean > 0.75 * size)
    sharp = stands & (mean > _TEXT_SLOPE)
    if text is not None:
        sharp |= text
    overlay = cv2.dilate(sharp.astype(np.uint8), np.ones((25, 41), np.uint8)) > 0
    stands &= ~overlay
    # a spot has an edge all around: what it covers counts
    covered = cv2.morphologyEx(stands.astype(np.uint8), cv2.MORPH_CLOSE, np.ones((7, 7), np.uint8))
    share = float(covered.mean())
    return Check("dirty_lens", seen.pictures >= PICTURES_FOR_DIRT and share > DIRT_SHARE, {"share": share})


@dataclass(frozen=True)
class WatchConfig:
    """``window`` (s) that counter and picture are compared over, ``hold`` (s) that a check fails before it is told, ``stride``
    (px of expansion) between two pictures for dirt, and ``memory``, the pictures after which dirt is judged anew."""

    window: float = 2.0
    hold: float = 1.0
    stride: float = 6.0
    memory: int = 60


@dataclass(frozen=True)
class _Moment:
    time: float
    chainage: float
    moved: float


class Watch:
    """The checks over the pictures of one drive: what has to last, or to be compared over seconds, is kept here."""

    def __init__(self, config: WatchConfig | None = None) -> None:
        self._config = config or WatchConfig()
        self._way: deque[_Moment] = deque()
        self._ratios: deque[float] = deque(maxlen=40)
        self._moved = 0.0
        self._failing: dict[str, float] = {}
        self._first_alike: tuple[Gray, float] | None = None
        self._standing: Standing | None = None
        self._taken = 0.0
        self._dirt: Check | None = None
        self._fast: Check | None = None

    def add(
        self,
        gray: Gray,
        time_s: float,
        flow: Flow | None,
        foe: Foe | None,
        centre: tuple[float, float],
        chainage: float | None = None,
        quantum: float = 0.0,
        axis: tuple[float, float] = (0.0, 0.0),
    ) -> tuple[Check, ...]:
        """One picture (H, W): the checks that fail and are to be told, the weightiest first.

        ``flow`` and ``foe`` are those of this picture, also while the counter stands, None where there are none; ``centre`` is
        the follower's. ``chainage`` is what the counter says, None where it is silent, and ``quantum`` (m) its step.
        """
        lost = signal_lost(gray, *self._since(gray, chainage))
        if self._held(lost, time_s):
            self._way.clear()
            return (lost,)
        checks = [too_dark(gray), too_bright(gray)]
        if flow is not None:
            self._fast = too_fast(flow, gray.shape)
        if foe is not None:
            self._clean(gray, foe, centre)
        # what flow told holds until it tells again
        checks += [check for check in (self._fast, self._dirt) if check is not None]
        checks += [off_axis(centre, gray.shape, axis)]
        told = [check for check in checks if self._held(check, time_s)]
        return (*self._compared(time_s, flow, foe, chainage, quantum, gray.shape), *told)

    def _since(self, gray: Gray, chainage: float | None) -> tuple[Gray | None, float]:
        """The picture that this one may be a copy of, and how far the counter ran since it came first."""
        where = 0.0 if chainage is None else chainage
        if self._first_alike is None or not np.array_equal(self._first_alike[0], gray):
            self._first_alike = (gray.copy(), where)
            return None, 0.0
        return self._first_alike[0], where - self._first_alike[1]

    def _held(self, check: Check, time_s: float) -> bool:
        if not check.failed:
            self._failing.pop(check.code, None)
            return False
        return time_s - self._failing.setdefault(check.code, time_s) >= self._config.hold

    def _compared(
        self,
        time_s: float,
        flow: Flow | None,
        foe: Foe | None,
        chainage: float | None,
        quantum: float,
        shape: tuple[int, ...],
    ) -> tuple[Check, ...]:
        """Slip and its opposite over the window; nothing where the picture's motion is not known throughout it."""
        if chainage is None or (flow is not None and foe is None and (flow.length > 1.0 or len(flow.points) < FEWEST)):
            self._way.clear()
            return ()
        if foe is not None:
            self._moved += expansion(foe, shape)
        self._way.append(_Moment(time_s, chainage, self._moved))
        while len(self._way) > 1 and time_s - self._way[1].time >= self._config.window:
            self._way.popleft()
        first = self._way[0]
        if time_s - first.time < self._config.window:
            return ()
        travel, moved = chainage - first.chainage, self._moved - first.moved
        usual = float(np.median(self._ratios)) if len(self._ratios) == self._ratios.maxlen else None
        way = Way(travel, quantum, moved, usual)
        failed = tuple(check for check in (slip(way), image_stands(way)) if check.failed)
        if not failed and abs(travel) > max(2 * quantum, 0.1) and moved:
            self._ratios.append(abs(moved / travel))
        return failed

    def _clean(self, gray: Gray, foe: Foe, centre: tuple[float, float]) -> None:
        self._taken += abs(expansion(foe, gray.shape))
        if self._standing is None or self._taken > self._config.stride:
            self._standing, self._taken = standing(gray, centre, self._standing), 0.0
            if self._standing.pictures >= PICTURES_FOR_DIRT:
                self._dirt = dirty_lens(self._standing)
            if self._standing.pictures >= self._config.memory:
                self._standing = None
