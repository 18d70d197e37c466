"""One drive from pictures and positions to a map: the one way that the live survey and ``borescout map`` both go.

picture -> flow, focus of expansion, joints -> view -> detector -> mapper        (each picture)
all detections, the mapper's landmarks -> refined landmarks                      (at the end)
their sightings, joints, tether -> smoother -> map                               (then)
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from device.landmarks.detectors import Detector
from device.landmarks.looking import Look, Looking
from device.landmarks.overlay import Mark, Scene
from device.landmarks.smoothing import Mapped, smooth_drive
from drivers.grabber.base import VideoFrame
from estimators.landmarks.mapper import Mapper, MapperConfig
from estimators.landmarks.projection import PipeCamera, View
from estimators.landmarks.refine import Refined, refine, same_ids
from estimators.landmarks.smoothing import Known
from estimators.landmarks.types import Evidence, Landmark, Observation
from estimators.odometry import Position
from estimators.rings import FocalRadius

Image = NDArray[np.uint8]

_ANY_FOCAL = (100.0, 100.0)
"""Where nothing tells f * R the smoother finds it; it only wants to know the pixels' aspect."""
_USUAL_DIAGONAL = math.hypot(720, 576)
MIN_THUMBNAIL, MAX_THUMBNAIL = 64, 240
SURE_SHARE = 0.05
"""Landmarks are mapped once the joints tell f * R to this share."""
MOST_REFINED = 20_000
"""Of a longer drive only some of the pictures are looked at again, evenly."""
UNSURE_PX = 30.0
"""A centre that rings of the whole drive tell no better is as good as the dark at the end of the pipe."""
LEAST_RATE = 5.0
"""Pictures a second below which flow cannot follow the wall."""
CALIBRATED_SHARE = 0.01
"""Standard deviation, as a share, of an f * R that comes from a stated focal length and a nominal radius."""


@dataclass(frozen=True)
class PipelineSetup:
    """What is known before the drive: ``focal`` (fx, fy) and ``centre`` (px), ``radius`` (m); None for what is not.

    ``focal_radius`` is f * R (px m) where somebody states that instead.
    """

    focal: tuple[float, float] | None = None
    centre: tuple[float, float] | None = None
    radius: float | None = None
    focal_radius: float | None = None
    sparse: bool = False
    """Pictures come more than some tenths of a second apart."""
    mapper: MapperConfig | None = None

    @property
    def known_focal_radius(self) -> Known | None:
        """f * R, where it is known before the drive."""
        if self.focal_radius is not None:
            return Known(self.focal_radius, CALIBRATED_SHARE * self.focal_radius)
        if self.focal is not None and self.radius is not None:
            value = self.focal[0] * self.radius
            return Known(value, CALIBRATED_SHARE * value)
        return None

    @property
    def known_rings(self) -> FocalRadius | None:
        """The same as the size of rings tells it: sqrt(fx fy) R."""
        known = self.known_focal_radius
        if known is None:
            return None
        aspect = 1.0 if self.focal is None else self.focal[1] / self.focal[0]
        return FocalRadius(math.sqrt(aspect) * known.value, math.sqrt(aspect) * known.std, known=True)

    def camera(self, width: int, height: int, found: float | None = None, aspect: float = 1.0) -> PipeCamera | None:
        """The camera for a picture of this size; ``found`` is fx * R as the joints tell it, ``aspect`` fy / fx. None where
        nothing tells f * R."""
        if self.focal is not None and self.radius is not None:
            return PipeCamera(self.focal[0], self.focal[1], self.radius, width, height)
        focal_radius = self.focal_radius if self.focal_radius is not None else found
        if focal_radius is None:
            return None
        if self.focal is not None:
            aspect = self.focal[1] / self.focal[0]
        return PipeCamera(focal_radius, aspect * focal_radius, 1.0, width, height)  # lengths on the wall in radii


@dataclass(frozen=True)
class Step:
    """What came of one picture. ``view`` is None where nobody knows where it was taken."""

    time_s: float
    number: int
    position: Position | None
    view: View | None
    look: Look
    prompts: tuple[str, ...] = ()
    seen: Observation | None = None


@dataclass
class _Cut:
    """A landmark's best picture so far."""

    frame: int
    image: Image = field(repr=False)

    def jpeg(self) -> bytes:
        _, data = cv2.imencode(".jpg", self.image, [cv2.IMWRITE_JPEG_QUALITY, 85])
        return data.tobytes()


class LandmarkPipeline:
    """Feed it the pictures of a drive in their order; ask for the map at any time."""

    def __init__(self, setup: PipelineSetup, detector: Detector, seed: int = 0) -> None:
        self.setup = setup
        self.frames = 0
        """Pictures that were looked at."""
        self._detector = detector
        aspect = None if setup.focal is None else setup.focal[0] / setup.focal[1]
        self._looking = Looking(setup.centre, setup.known_rings, seed, setup.sparse, aspect)
        self._mapper: Mapper | None = None
        self._refined: Refined | None = None
        self._closed = False
        self._camera: PipeCamera | None = None
        self._mapped = 0
        """How many of ``_seen`` the mapper has had: none before f * R is known."""
        self._suspected: list[float] = []
        self._seen: list[Observation] = []
        self._cuts: dict[int, _Cut] = {}
        self._log: list[Any] = []
        self._size = (720, 576)
        self._low, self._high = math.inf, -math.inf
        self._common = 0.0
        """Standard deviation (m) of what all chainages of the drive are off by."""

    def step(self, frame: VideoFrame, position: Position | None) -> Step:
        """One picture, taken at ``position``; None where nobody knows."""
        self.frames += 1
        height, width = frame.image.shape[:2]
        self._size = (width, height)
        gray = np.asarray(cv2.cvtColor(frame.image, cv2.COLOR_BGR2GRAY), dtype=np.uint8)
        look = self._looking.look(gray, self.frames, frame.time_s, position)
        if position is None:
            return Step(frame.time_s, frame.number, None, None, look, look.codes)
        self._common = max(self._common, position.common)
        if self._camera is None:
            self._camera = self.setup.camera(width, height, *self._found())
        radius = 1.0 if self._camera is None else self._camera.radius
        view = View(position.chainage, look.centre, (radius * look.axis[0], radius * look.axis[1]))
        detections = self._detector.detect(frame)
        seen = Observation(self.frames, frame.time_s, view, detections, position.std, look.centre_std)
        self._seen.append(seen)
        self._map(frame.image)
        if "slip" in look.codes or "image_stands" in look.codes:
            self._suspected.append(frame.time_s)
        self._low, self._high = min(self._low, position.chainage), max(self._high, position.chainage)
        self._log.append(_entry(seen))
        return Step(frame.time_s, frame.number, position, view, look, look.codes, seen)

    @property
    def placed(self) -> int:
        """Pictures that were taken at a known place."""
        return len(self._seen)

    def landmarks(self, candidates: bool = False) -> list[Landmark]:
        """The map so far, along the pipe; while the drive goes on without its sightings."""
        return [landmark.less_sure(self._common**2) for landmark in self._own_landmarks(candidates)]

    def _own_landmarks(self, candidates: bool) -> list[Landmark]:
        """As sure as sightings can make them."""
        if self._refined is not None:
            return self._refined.landmarks
        return [] if self._mapper is None else self._mapper.landmarks(candidates, with_sightings=False)

    def thumbnail(self, landmark: int) -> tuple[int, Callable[[], bytes]] | None:
        """The best picture of a landmark: the frame it is from, and what makes a JPEG of it."""
        cut = self._cuts.get(landmark)
        return None if cut is None else (cut.frame, cut.jpeg)

    def joints(self, last: bool = False) -> list[dict[str, Any]]:
        """The pipe joints so far: {"chainage_m", "sightings"}. ``last``: from every ring, however few are new."""
        return _less_sure(self._looking.joints(last), self._common)

    def focal_radius(self) -> dict[str, float] | None:
        """sqrt(fx fy) R (px m): {"value", "sigma"}, None where nothing tells it yet."""
        known = self._looking.solve().focal_radius
        return None if known is None else {"value": round(known.value, 2), "sigma": round(known.sigma, 3)}

    def span(self) -> tuple[float | None, float | None]:
        """The least and the greatest chainage (m) that the crawler has been at."""
        return (None, None) if self._low > self._high else (round(self._low, 3), round(self._high, 3))

    def log_entries(self) -> list[Any]:
        """What is to be kept so that the drive can be mapped again, see ``_entry``; what was not kept yet."""
        return list(self._log)

    def log_was_kept(self, count: int) -> None:
        """The first ``count`` entries are durable."""
        del self._log[:count]

    def scene(self, step: Step, numbers: dict[int, int]) -> Scene:
        """What to draw into the picture of ``step``; ``numbers`` are those that the operator knows landmarks by."""
        assert step.view is not None  # what has no place has no scene
        marks = [
            Mark(f"{numbers.get(found.id, found.id)} {found.label}", found.status, found.chainage, found.angle)
            for found in self.landmarks(candidates=True)
            if found.status != "passed"
        ]
        return Scene(self._camera, step.view, marks, step.look.ellipses)

    def close(self) -> None:
        """No more pictures come: what was only suspected is dropped. Quick, and whoever else looks at the map has to wait."""
        if not self._closed and self._mapper is not None:
            self._mapper.finish()
        self._closed = True

    def finish(self) -> None:
        """The drive is over: after ``close`` every landmark is looked for once more in all pictures. Those that go on keep
        their ids; the mapper's doubles are gone. The map can be read meanwhile."""
        self.close()
        self._looking.solve(last=True)
        if self._mapper is None or self._refined is not None:
            return
        found = self._mapper.landmarks(with_sightings=True)
        again = self._mapped_again(self._mapper) if self.setup.sparse else found
        if again:
            seen = self._seen[:: math.ceil(len(self._seen) / MOST_REFINED)]
            config = self._mapper.config
            names = dict.fromkeys([*config.classes, *(one.label for look in seen for one in look.detections or ())])
            refined = refine(self._mapper.camera, seen, again, config, list(names))
            self._refined = replace(refined, landmarks=same_ids(refined.landmarks, found))

    def _mapped_again(self, mapper: Mapper) -> list[Landmark]:
        """Where stills looked is known once all rings are: the landmarks anew, from ``_seen`` with those centres."""
        centres, radius = self._looking.centres(), mapper.camera.radius
        for k, seen in enumerate(self._seen):
            told = centres.get(seen.frame)
            std = math.inf if told is None else math.sqrt(float(told.covariance[0, 0]))
            if told is not None and std < UNSURE_PX:
                centre, axis = (float(told.centre[0]), float(told.centre[1])), radius * told.lean
                view = replace(seen.view, centre=centre, axis=(float(axis[0]), float(axis[1])))
                self._seen[k] = replace(seen, view=view, centre_std=std)
        again = Mapper(mapper.camera, mapper.config)
        for seen in self._seen:
            again.update(seen)
        again.finish()
        return again.landmarks(with_sightings=True)

    def paused(self) -> None:
        """The next picture does not follow the last one."""
        self._looking.forget()

    def smooth(self, length: float | None = None) -> Mapped | None:
        """The map smoothed over the whole drive, ``length`` (m) from its first picture to its last where it is known. None
        where there is nothing to smooth."""
        camera = self._camera or self.setup.camera(*self._size, *self._found()) or PipeCamera(*_ANY_FOCAL, 1.0, *self._size)
        self.finish()
        landmarks = [] if self._refined is None else self._refined.landmarks
        pixel_std = mapper_config(camera).pixel_std if self._refined is None else self._refined.pixel_std
        mapped = smooth_drive(
            self._seen,
            landmarks,
            self._looking.sightings(),
            camera,
            pixel_std,
            self.setup.known_focal_radius,
            length,
            self._suspected,
        )
        if mapped is None:
            return None
        less_sure = tuple(landmark.less_sure(self._common**2) for landmark in mapped.landmarks)
        return replace(mapped, landmarks=less_sure, joints=_less_sure(mapped.joints, self._common))

    def _found(self) -> tuple[float | None, float]:
        """fx * R as the joints tell it, None where they do not tell it well enough; and fy / fx."""
        aspect = 1.0 / self._looking.aspect
        known = self._looking.solve().focal_radius
        if known is None or known.sigma > SURE_SHARE * known.value:
            return None, aspect
        return known.value / math.sqrt(aspect), aspect

    def _map(self, image: Image) -> None:
        if self._mapper is None:
            if self._camera is None:
                return
            self._mapper = Mapper(self._camera, self.setup.mapper or mapper_config(self._camera))
        for seen in self._seen[self._mapped :]:
            self._mapper.update(seen)
        self._mapped = len(self._seen)
        if self._seen[-1].detections:
            self._cut(self._seen[-1].frame, image)

    def _cut(self, frame: int, image: Image) -> None:
        """Keep what this picture shows better than any before."""
        assert self._mapper is not None  # it has just mapped this frame
        tracks = self._mapper.tracks
        for row in np.flatnonzero(tracks.evidence[:, 0] == frame):
            number = int(tracks.ids[row])
            _, u, v, size = (float(value) for value in tracks.evidence[row])
            self._cuts[number] = _Cut(frame, cut_out(image, Evidence(frame, u, v, size)))
        if len(self._cuts) > 2 * len(tracks) + 50:
            alive = set(tracks.ids.tolist())
            self._cuts = {number: cut for number, cut in self._cuts.items() if number in alive}


def mapper_config(camera: PipeCamera) -> MapperConfig:
    """The mapper's settings for pictures of this size: a detector is off by a share of its picture, not by so many pixels."""
    usual = MapperConfig()
    return replace(usual, pixel_std=usual.pixel_std * math.hypot(camera.width, camera.height) / _USUAL_DIAGONAL)


def _less_sure(joints: list[dict[str, Any]], common: float) -> list[dict[str, Any]]:
    """Joints with an error of standard deviation ``common`` (m) that they all share."""
    return [{**joint, "sigma_chainage_m": round(math.hypot(joint["sigma_chainage_m"], common), 4)} for joint in joints]


def cut_out(image: Image, evidence: Evidence) -> Image:
    """A square of ``image`` around the evidence, a copy; where it would leave the picture it is moved inside."""
    height, width = image.shape[:2]
    side = int(min(np.clip(1.4 * evidence.size, MIN_THUMBNAIL, MAX_THUMBNAIL), height, width))
    left = int(np.clip(evidence.u - side / 2, 0, width - side))
    top = int(np.clip(evidence.v - side / 2, 0, height - side))
    return image[top : top + side, left : left + side].copy()


def _entry(seen: Observation) -> list[Any]:
    """[frame, time_s, position, its std, centre u, v, its std, axis right, down, detections]; a detection is
    [u, v, class, score, area], and there are none (null) where the detector did not look."""
    view = seen.view
    numbers = (seen.time_s, view.position, seen.position_std, *view.centre, seen.centre_std, *view.axis)
    found = seen.detections
    told = None if found is None else [[round(d.u, 1), round(d.v, 1), d.label, round(d.score, 3), d.area] for d in found]
    return [seen.frame, *(round(value, 4) for value in numbers), told]
