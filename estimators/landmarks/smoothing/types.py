"""What the smoother takes and gives: a run, what is known beside it, and the smoothed map."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


@dataclass(frozen=True)
class Known:
    """A number and its standard deviation."""

    value: float
    std: float


@dataclass(frozen=True)
class Frames:
    """The frames of a run in their order, ``n`` of them.

    ``time_s`` (n,); ``encoder`` (n,) metres as counted by the tether, nan where it gave none; ``centre`` (n, 2) focus of
    expansion (px); ``axis`` (n, 2) the pipe's axis as seen from the camera, to the right and down, in *radii of the pipe*
    (``View.axis`` over the radius; zero where nothing is known).
    """

    time_s: Array
    encoder: Array
    centre: Array
    axis: Array


@dataclass(frozen=True)
class Sightings:
    """``m`` sightings of landmarks: ``landmark`` (m,) ids, ``frame`` (m,) index into ``Frames``, ``pixels`` (m, 2), ``std``
    (m,) of one coordinate (px)."""

    landmark: Indices
    frame: Indices
    pixels: Array
    std: Array


@dataclass(frozen=True)
class RingSightings:
    """``r`` sightings of pipe joints: ``joint`` (r,) ids, ``frame`` (r,) index into ``Frames``, ``radius_px`` (r,) of the ring
    along u, ``std`` (r,) (px). A ring is a landmark without angle."""

    joint: Indices
    frame: Indices
    radius_px: Array
    std: Array


NO_RINGS = RingSightings(np.empty(0, np.int64), np.empty(0, np.int64), np.empty(0), np.empty(0))


@dataclass(frozen=True)
class Run:
    """All that was seen in a run. ``aspect`` is fy / fx; ``labels`` the class of each landmark id, where it is known;
    ``suspected`` the times (s) at which a self-check saw the picture and the tether disagree."""

    frames: Frames
    sightings: Sightings
    rings: RingSightings = NO_RINGS
    aspect: float = 1.0
    labels: dict[int, str] = field(default_factory=dict)
    suspected: tuple[float, ...] = ()


@dataclass(frozen=True)
class Lateral:
    """A connection (or any landmark) whose chainage is known, from a plan or an earlier survey: by its id in this run, or by
    its class, when the nearest of that class is taken if it agrees."""

    chainage: float
    std: float
    landmark: int | None = None
    label: str | None = None


@dataclass(frozen=True)
class Constraints:
    """What is known beside the run; None for what is not.

    ``focal_radius`` fx * R (px m); ``scale`` metres travelled per metre counted; ``start`` the camera's chainage in the first
    frame (None: the first encoder reading, to 1 cm); ``length`` its way from the first frame to the last, the length from node
    to node; ``laterals`` known landmarks.
    """

    focal_radius: Known | None = None
    scale: Known | None = None
    start: Known | None = None
    length: Known | None = None
    laterals: tuple[Lateral, ...] = ()


@dataclass(frozen=True)
class Noise:
    """How a run goes wrong.

    ``scale_std`` of an uncalibrated tether; ``drift`` of tether against way (m per sqrt m); ``slip_rate`` expected slips per
    metre, known as from ``slip_experience`` slips seen, and ``slip_std`` (m) their size; ``centre_std`` (px) of the focus of
    expansion and ``centre_memory`` (m) over which its error stays alike; ``axis_std`` (radii) and ``axis_memory`` (m) of the
    camera's offset the same; ``roll_std`` (rad) of the crawler, which nothing here sees: it goes into every angle's variance;
    ``ring_share`` the share by which all rings of a run, and apart from them all landmarks, may lie further from the axis than
    the wall or nearer, and ``landmark_share`` each landmark beside that; ``outliers`` the share of
    sightings that are something else, ``outlier_span`` (px) the width over which those lie.
    """

    scale_std: float = 0.05
    drift: float = 0.005
    slip_rate: float = 0.1
    slip_experience: float = 2.0
    slip_std: float = 0.3
    centre_std: float = 4.0
    centre_memory: float = 0.5
    axis_std: float = 0.03
    axis_memory: float = 4.0
    roll_std: float = 0.02
    ring_share: float = 0.015
    landmark_share: float = 0.03
    outliers: float = 0.05
    outlier_span: float = 400.0


@dataclass(frozen=True)
class SmoothedLandmark:
    """``covariance`` (2, 2) of [chainage (m), angle (rad)]; ``used`` is how many of its ``sightings`` agree with it."""

    id: int
    chainage: float
    angle: float
    covariance: Array
    sightings: int
    used: float


@dataclass(frozen=True)
class SmoothedJoint:
    """One pipe joint: ``chainage`` (m), its ``std``, and how many of its ``sightings`` agree with it."""

    id: int
    chainage: float
    std: float
    sightings: int
    used: float


@dataclass(frozen=True)
class Slip:
    """Between ``start_s`` and ``end_s`` the crawler went ``metres`` further than the tether counted (negative: the tether ran
    without it), near ``chainage``. ``probability`` that anything happened at all."""

    start_s: float
    end_s: float
    chainage: float
    metres: float
    std: float
    probability: float


@dataclass(frozen=True)
class Smoothed:
    """The map after smoothing.

    ``positions`` (n,) and ``position_std`` (n,) of the camera per frame (m); ``scale`` metres per metre counted;
    ``focal_radius`` fx * R (px m); ``noise_ratio`` how much larger the scatter of the sightings was than they claimed;
    ``converged`` False where the iterations ran out: then it is not to be trusted.
    """

    positions: Array
    position_std: Array
    landmarks: tuple[SmoothedLandmark, ...]
    joints: tuple[SmoothedJoint, ...]
    scale: Known
    focal_radius: Known
    slips: tuple[Slip, ...]
    noise_ratio: float
    iterations: int
    converged: bool
