"""The mapper on one screen: Algorithm 1 of the CCTV paper, one frame at a time.

predict where each track should be seen -> gate and assign -> update, weigh, extend -> start candidates -> confirm, drop, merge
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from estimators.detections import CLASSES
from estimators.landmarks import association, belief, ekf
from estimators.landmarks.extent import grow, turn_towards, wall_patches
from estimators.landmarks.projection import NEAREST, PipeCamera, View, back_project, jacobian, project
from estimators.landmarks.tracks import Seen, Tracks
from estimators.landmarks.types import Evidence, Landmark, Observation, Sighting, Status

Array = NDArray[np.float64]
Index = NDArray[np.intp]

MERGE_EVERY = 4
"""Doubles are looked for in every so many-th frame."""


@dataclass(frozen=True)
class MapperConfig:
    """Settings of the mapper. Lengths in metres, ``pixel_std`` in px.

    ``confirm`` and ``drop`` are log likelihood ratios of existence; ``landmark_rate`` (1/m) and ``false_rate`` (per class and
    frame) are what is expected of a pipe and a detector before anything was seen. ``long_classes`` may reach along the pipe:
    ``reach`` is how far beyond its known extent such a thing is looked for. A sighting counts in full once the crawler has
    moved by ``fresh`` since the last one: standing still, the same error is seen again and again.
    """

    classes: tuple[str, ...] = CLASSES
    long_classes: tuple[str, ...] = ("deposit", "fracture", "roots")
    pixel_std: float = 16.0
    gate: float = association.GATE
    confirm: float = 7.0
    drop: float = -9.0
    least_hits: int = 5
    landmark_rate: float = 0.2
    false_rate: float = 0.1
    errors: belief.Errors = field(default_factory=belief.Errors)
    right_label: float = 0.9
    reach: float = 0.35
    fresh: float = 0.004
    forget: float = 2.0
    least_radius: float = 2.0
    """In standard deviations of a detection: nearer the focus of expansion its depth is a guess, and no track starts."""


class Mapper:
    """Maps landmarks from frames. Feed it frames in order; ask for ``landmarks()`` at any time."""

    def __init__(self, camera: PipeCamera, config: MapperConfig | None = None) -> None:
        self.camera = camera
        self.config = config or MapperConfig()
        self.names: list[str] = list(self.config.classes)
        self.tracks = Tracks(belief=np.zeros((0, len(self.names))))
        self.matched: Index = np.zeros(0, dtype=np.intp)
        """Rows of ``tracks`` that were seen in the last frame."""
        self._confusion = belief.confusion(len(self.names), self.config.right_label)
        self._long_class = self._long_classes()
        self._next_id = 1
        self._frames = 0
        self._false = np.zeros(len(self.names))
        self._view: View | None = None
        self._speed = 0.0
        self._finished = False

    def update(self, seen: Observation) -> None:
        """One frame (the body of Algorithm 1)."""
        moved = 0.0 if self._view is None else abs(seen.view.position - self._view.position)
        self._view = seen.view
        if seen.detections is None:
            return
        self._frames += 1
        self._speed += (moved - self._speed) / min(self._frames, 200)
        labels = np.array([self._label(d.label) for d in seen.detections], dtype=np.intp)
        pixels = np.array([(d.u, d.v) for d in seen.detections], dtype=np.float64).reshape(-1, 2)
        active = self._in_view(seen.view)
        rows, columns, rival, spare = self._associate(seen, pixels, labels, active)
        self.matched = active[columns]
        self._hit(seen, pixels[rows], labels[rows], rival, self.matched, rows)
        unseen = np.ones(len(active), dtype=bool)
        unseen[columns] = False
        self._miss(seen, active[unseen])
        self._start(seen, pixels, labels, spare)
        self._manage(seen)

    def landmarks(self, include_candidates: bool = False, with_sightings: bool = True) -> list[Landmark]:
        """The map so far, along the pipe."""
        rows = [k for k in range(len(self.tracks)) if include_candidates or self.tracks.confirmed[k]]
        return sorted((self._landmark(k, with_sightings) for k in rows), key=lambda landmark: landmark.chainage)

    def finish(self) -> None:
        """The drive is over: candidates are dropped, what was confirmed is passed."""
        self._drop(~self.tracks.confirmed)
        self._finished = True

    # ---- the steps

    def _associate(
        self, seen: Observation, pixels: Array, labels: Index, active: Index
    ) -> tuple[Index, Index, Array, NDArray[np.bool_]]:
        """Pairs (detections, places in ``active``), how well a better founded track without a detection would explain each (ln
        p), and which detections are nobody's."""
        tracks, config = self.tracks, self.config
        long = self._long(active)
        reach = np.where(long, config.reach, 0.0)
        gated = association.gate(
            self.camera,
            seen.view,
            tracks.state[active],
            tracks.covariance[active],
            pixels,
            (tracks.below[active] - reach, tracks.above[active] + reach),
            self._noise(seen),
            config.gate,
        )
        label_given_track = np.einsum("nc,cm->mn", tracks.belief[active], self._confusion[:, labels])
        exists = np.maximum(-np.logaddexp(0.0, -tracks.score[active]), -1.5)
        hit = belief.gaussian(gated.distance2, gated.log_det) + np.log(label_given_track) + exists[None]
        cost = np.log(self._density(labels))[:, None] - hit
        rows, columns = association.assign(cost)
        spare = np.ones(len(pixels), dtype=bool)
        spare[rows] = False
        idle = np.ones(len(active), dtype=bool)
        idle[columns] = False
        score = tracks.score[active]
        better = idle[None] & (score[None] > score[columns][:, None])
        rival = np.where(better, hit[rows], -np.inf).max(axis=1, initial=-np.inf)
        # A long thing may show in several places at once: what lies on it is not another landmark.
        inside = np.isfinite(gated.distance2) & (tracks.confirmed[active] & long)[None] & (label_given_track > 0.3)
        spare &= ~inside.any(axis=1)
        return rows, columns, rival, spare

    def _hit(self, seen: Observation, pixels: Array, labels: Index, rival: Array, rows: Index, which: Index) -> None:
        """Filter, extent, existence and class of the tracks ``rows``, seen at ``pixels`` (eqs. 13 to 17)."""
        if len(rows) == 0:
            return
        tracks, config, camera, view = self.tracks, self.config, self.camera, seen.view
        weight = self._weight(rows, view)
        chainage = np.nan_to_num(back_project(camera, view, pixels)[:, 0], nan=view.position + 1e3)
        offset = np.clip(chainage - tracks.state[rows, 0], tracks.below[rows], tracks.above[rows])
        offset = np.maximum(offset, view.position + 2 * NEAREST - tracks.state[rows, 0])
        shift = np.stack([offset, np.zeros_like(offset)], axis=1)
        pixel_std, centre_std, position_std = self._noise(seen)
        target = tracks.state[rows] + shift
        jac = jacobian(camera, view, target)
        noise = ekf.measurement_noise(jac, pixel_std, centre_std, position_std)
        innovation = pixels - project(camera, view, target)
        spread = jac @ tracks.covariance[rows] @ np.swapaxes(jac, 1, 2) + noise
        distance2 = np.einsum("ni,nij,nj->n", innovation, ekf.inverse2(spread), innovation)
        log_det = np.log(spread[:, 0, 0] * spread[:, 1, 1] - spread[:, 0, 1] ** 2)

        label = self._confusion[:, labels].T
        length = np.hypot(*(self._ends(rows, view, tracks.above) - self._ends(rows, view, tracks.below)).T)
        on_wall = belief.gaussian(distance2, log_det) - np.log1p(length / (2.5 * pixel_std))
        told = np.log(np.einsum("nc,nc->n", tracks.belief[rows], label))
        before = tracks.bursts(rows)
        clutter, going_on, bursts = belief.clutter_evidence(
            config.errors,
            before,
            seen.frame,
            pixels,
            labels,
            self._confusion[before.label, labels],
            self._density(labels),
            pixel_std,
        )
        # The middle of what shows of a long thing may well stay where it is in the picture: no evidence either way.
        on_wall = np.where(self._long(rows), np.maximum(on_wall, going_on), on_wall)
        ratio = np.log(config.errors.stay_seen) + on_wall + told - np.logaddexp(clutter, rival)
        # What lies off the mark may be a false detection where the landmark itself was missed.
        missed = belief.miss_evidence(config.errors, tracks.run[rows])
        tracks.score[rows] += weight * np.maximum(ratio, missed)
        tracks.set_bursts(rows, bursts)
        tracks.belief[rows] = belief.after_label(tracks.belief[rows], label, weight)

        fresh = weight > 0.2
        at = rows[fresh]
        stale = np.maximum(weight[fresh], 0.2)[:, None, None]
        state, covariance = ekf.update(camera, view, target[fresh], tracks.covariance[at], pixels[fresh], noise[fresh] / stale)
        tracks.state[at] = state - shift[fresh]
        tracks.state[at, 1] = ekf.wrap(tracks.state[at, 1])
        moved = np.minimum(np.abs(view.position - tracks.counted_at[at]), 1.0)
        tracks.covariance[at] = covariance + moved[:, None, None] * np.diag(ekf.WANDER)
        stretch = self._long(at) & tracks.confirmed[at]
        grow(camera, view, tracks, at[stretch], chainage[fresh][stretch], pixel_std)
        self._outline(seen, at, which[fresh], pixels[fresh])

        tracks.hits[at] += 1
        tracks.run[rows] = np.where(ratio < missed, tracks.run[rows] + 1, 0)
        tracks.counted_at[at] = view.position
        tracks.hit_at[rows] = view.position
        tracks.last_frame[rows] = seen.frame
        tracks.farthest[rows] = np.maximum(tracks.farthest[rows], tracks.state[rows, 0] - view.position)
        self._note(seen, at, which[fresh])

    def _outline(self, seen: Observation, rows: Index, which: Index, pixels: Array) -> None:
        """Extents along and around the pipe from what the detections ``which`` of the tracks ``rows`` cover on the wall."""
        assert seen.detections is not None
        outlines = [seen.detections[k].outline for k in which]
        drawn = np.array([len(outline) > 0 for outline in outlines], dtype=bool)
        if not drawn.any():
            return
        patches = wall_patches(self.camera, seen.view, [o for o in outlines if o], pixels[drawn])
        rows = rows[drawn]
        turn_towards(self.tracks, rows, patches)
        stretch = self._long(rows) & self.tracks.confirmed[rows]
        for end in (patches.low, patches.high):
            grow(self.camera, seen.view, self.tracks, rows[stretch], end[stretch], self.config.pixel_std)

    def _note(self, seen: Observation, rows: Index, which: Index) -> None:
        """Keep the sightings, and the one that shows the landmark best: large, and well inside the picture."""
        camera = self.camera
        assert seen.detections is not None
        for row, k in zip(rows, which, strict=True):
            d = seen.detections[k]
            self.tracks.sightings[row].append(Seen(seen.frame, seen.time_s, seen.view, d.u, d.v, d.label, d.score, d.area))
            size = thumbnail_size(camera, seen.view, d.u, d.v, d.area)
            border = min(d.u, d.v, camera.width - d.u, camera.height - d.v)
            best = self.tracks.evidence[row]
            if size > best[3] and (border > 0.3 * size or best[3] == 0):
                self.tracks.evidence[row] = (seen.frame, d.u, d.v, size)

    def _miss(self, seen: Observation, rows: Index) -> None:
        """Hold it against the tracks ``rows`` that they were not seen where they should have been."""
        tracks, camera, view = self.tracks, self.camera, seen.view
        if len(rows) == 0:
            return
        expected = project(camera, view, tracks.state[rows])
        margin = self.config.pixel_std
        inside = (expected > margin).all(axis=1) & (expected < (camera.width - margin, camera.height - margin)).all(axis=1)
        inside &= tracks.state[rows, 0] - view.position <= tracks.farthest[rows]
        rows = rows[inside]
        weight = self._weight(rows, view)
        fresh = weight > 0.2
        rows, weight = rows[fresh], weight[fresh]
        tracks.score[rows] += weight * belief.miss_evidence(self.config.errors, tracks.run[rows])
        tracks.misses[rows] += 1
        tracks.run[rows] += 1
        tracks.counted_at[rows] = view.position

    def _start(self, seen: Observation, pixels: Array, labels: Index, spare: NDArray[np.bool_]) -> None:
        """Candidates from the detections that are nobody's (eqs. 19 to 21)."""
        config, camera, view = self.config, self.camera, seen.view
        pixel_std, centre_std, position_std = self._noise(seen)
        away = np.hypot(pixels[:, 0] - view.centre[0], pixels[:, 1] - view.centre[1])
        which = np.flatnonzero(spare & (away > config.least_radius * np.hypot(pixel_std, centre_std)))
        n = len(which)
        if n == 0:
            return
        pixels, labels = pixels[which], labels[which]
        state, covariance = ekf.initial(camera, view, pixels, pixel_std, centre_std, position_std)
        prior = np.full((n, len(self.names)), 1.0 / len(self.names))
        likely = belief.after_label(prior, self._confusion[:, labels].T, np.ones(n))
        area = camera.width * camera.height
        expected = config.landmark_rate * max(self._speed, 1e-4) / area
        frame = np.full(n, seen.frame, dtype=np.int64)
        position = np.full(n, view.position)
        new = Tracks(
            ids=np.arange(self._next_id, self._next_id + n, dtype=np.int64),
            state=state,
            covariance=covariance,
            below=np.zeros(n),
            above=np.zeros(n),
            before=np.zeros(n),
            after=np.zeros(n),
            score=np.clip(np.log(expected / self._density(labels)), -8.0, -2.0),
            belief=likely,
            confirmed=np.zeros(n, bool),
            hits=np.zeros(n, np.int64),
            misses=np.zeros(n, np.int64),
            run=np.zeros(n, np.int64),
            burst_mean=pixels.copy(),
            burst_count=np.ones(n),
            burst_label=labels.astype(np.int64),
            burst_first=frame.copy(),
            burst_last=frame.copy(),
            counted_at=position.copy(),
            hit_at=position.copy(),
            farthest=state[:, 0] - view.position,
            first_frame=frame.copy(),
            last_frame=frame.copy(),
            evidence=np.zeros((n, 4)),
            sightings=[[] for _ in range(n)],
        )
        self._next_id += n
        start = len(self.tracks)
        self.tracks.append(new)
        rows = np.arange(start, start + n)
        self.tracks.hits[rows] = 1
        self._note(seen, rows, which)

    def _manage(self, seen: Observation) -> None:
        """Confirm, drop, merge."""
        tracks, config = self.tracks, self.config
        tracks.confirmed |= (tracks.score > config.confirm) & (tracks.hits >= config.least_hits)
        tracks.confirmed &= tracks.score > config.drop / 2
        forgotten = np.abs(seen.view.position - tracks.hit_at) > config.forget
        gone = tracks.state[:, 0] < seen.view.position + NEAREST
        self._drop(~tracks.confirmed & ((tracks.score < config.drop) | forgotten | gone))
        if self._frames % MERGE_EVERY == 0:
            self._merge(seen)

    def _drop(self, rows: NDArray[np.bool_]) -> None:
        """Forget tracks; what they had seen were false detections."""
        if rows.any():
            likeliest = self.tracks.belief[rows].argmax(axis=1)
            np.add.at(self._false, likeliest, self.tracks.hits[rows])
            self.tracks.keep(~rows)
            self.matched = np.zeros(0, dtype=np.intp)

    def _merge(self, seen: Observation) -> None:
        """One of two tracks of the same thing goes: the one with less evidence. Two seen in the same frame are two."""
        tracks = self.tracks
        near = self._in_view(seen.view)
        if len(near) < 2:
            return
        state, covariance = tracks.state[near], tracks.covariance[near]
        low, high = state[:, 0] + tracks.below[near], state[:, 0] + tracks.above[near]
        long = self._long(near)
        reach = np.where(long[:, None] & long[None], self.config.reach, 0.0)
        gap = np.maximum(np.maximum(low[:, None] - high[None], low[None] - high[:, None]) - reach, 0.0)
        overlap = (gap == 0.0) & (long[:, None] | long[None])
        apart = np.where(long[:, None] | long[None], gap, state[:, None, 0] - state[None, :, 0])
        turn = ekf.wrap(state[:, None, 1] - state[None, :, 1])
        joint = covariance[:, None] + covariance[None] + np.diag([0.02**2, 0.03**2])
        inverse = ekf.inverse2(joint)
        distance2 = inverse[..., 0, 0] * apart**2 + 2 * inverse[..., 0, 1] * apart * turn + inverse[..., 1, 1] * turn**2
        distance2 = np.where(overlap, turn**2 / joint[..., 1, 1], distance2)
        alike = tracks.belief[near] @ tracks.belief[near].T > 0.4
        both = tracks.last_frame[near] == seen.frame
        two = both[:, None] & both[None] & ~(long[:, None] & long[None])
        same = np.triu((distance2 < 2.5) & alike & ~two, 1)
        if not same.any():
            return
        gone = np.zeros(len(tracks), dtype=bool)
        for i, j in zip(*np.nonzero(same), strict=True):
            a, b = int(near[i]), int(near[j])
            if gone[a] or gone[b]:
                continue
            stays, goes = (a, b) if tracks.score[a] >= tracks.score[b] else (b, a)
            if tracks.confirmed[stays] and tracks.confirmed[goes] and long[i] and long[j]:
                chainage = tracks.state[stays, 0]
                low_ = min(chainage + tracks.below[stays], tracks.state[goes, 0] + tracks.below[goes])
                high_ = max(chainage + tracks.above[stays], tracks.state[goes, 0] + tracks.above[goes])
                tracks.below[stays], tracks.above[stays] = low_ - chainage, high_ - chainage
            tracks.sightings[stays] = sorted(
                tracks.sightings[stays] + tracks.sightings[goes], key=lambda sighting: sighting.frame
            )
            tracks.hits[stays] = len({sighting.frame for sighting in tracks.sightings[stays]})
            tracks.first_frame[stays] = min(tracks.first_frame[a], tracks.first_frame[b])
            tracks.confirmed[stays] |= tracks.confirmed[goes]
            gone[goes] = True
        tracks.hits[gone] = 0
        self._drop(gone)

    # ---- what the steps share

    def _label(self, name: str) -> int:
        """Column of a class; one not heard of before is added."""
        if name not in self.names:
            self.names.append(name)
            self._confusion = belief.confusion(len(self.names), self.config.right_label)
            self._false = np.append(self._false, 0.0)
            self._long_class = self._long_classes()
            self.tracks.widen(len(self.names))
        return self.names.index(name)

    def _long_classes(self) -> Array:
        return np.array([name in self.config.long_classes for name in self.names], dtype=np.float64)

    def _noise(self, seen: Observation) -> tuple[float, float, float]:
        return self.config.pixel_std, seen.centre_std, seen.position_std

    def _density(self, labels: Index) -> Array:
        """False detections per frame and px^2 of each label: what was dropped so far, beside what was expected."""
        rate = (self.config.false_rate * 100.0 + self._false) / (100.0 + self._frames)
        return np.asarray(rate[labels] / (self.camera.width * self.camera.height), dtype=np.float64)

    def _weight(self, rows: Index, view: View) -> Array:
        """How much a frame counts for each track: in full once the crawler has moved on."""
        return np.minimum(np.abs(view.position - self.tracks.counted_at[rows]) / self.config.fresh, 1.0)

    def _long(self, rows: Index) -> NDArray[np.bool_]:
        """Which tracks are likely something long."""
        return np.asarray(self.tracks.belief[rows] @ self._long_class > 0.5, dtype=bool)

    def _ends(self, rows: Index, view: View, reach: Array) -> Array:
        """Pixels (n, 2) of one end of the extents, no nearer than a camera sees."""
        state = self.tracks.state[rows] + np.stack([reach[rows], np.zeros(len(rows))], axis=1)
        state[:, 0] = np.maximum(state[:, 0], view.position + self.camera.radius)
        return project(self.camera, view, state)

    def _in_view(self, view: View) -> Index:
        """Rows of the tracks that may be seen: some part of their extent is ahead and, give or take, in the picture."""
        tracks, camera = self.tracks, self.camera
        if len(tracks) == 0:
            return np.zeros(0, dtype=np.intp)
        long = self._long(np.arange(len(tracks)))
        state = tracks.state.copy()
        state[:, 0] += tracks.above + np.where(long & tracks.confirmed, self.config.reach, 0.0)
        pixels = project(camera, view, state)
        margin = 3 * self.config.pixel_std
        size = np.array([camera.width, camera.height])
        with np.errstate(invalid="ignore"):
            return np.flatnonzero(((pixels > -margin) & (pixels < size + margin)).all(axis=1))

    def _status(self, row: int) -> Status:
        if not self.tracks.confirmed[row]:
            return "candidate"
        if self._finished or self._view is None:
            return "passed"
        return "confirmed" if row in self._in_view(self._view) or self._ahead(row) else "passed"

    def _ahead(self, row: int) -> bool:
        assert self._view is not None
        return bool(self.tracks.state[row, 0] + self.tracks.above[row] > self._view.position + 2 * self.camera.radius)

    def _landmark(self, row: int, with_sightings: bool) -> Landmark:
        tracks = self.tracks
        low, high = (float(tracks.state[row, 0] + reach[row]) for reach in (tracks.below, tracks.above))
        angle = float(tracks.state[row, 1])
        number = int(tracks.ids[row])
        sightings = tuple(
            Sighting(number, s.frame, s.time_s, s.view, s.u, s.v, s.label, s.score) for s in tracks.sightings[row]
        )
        frame, u, v, size = tracks.evidence[row]
        return Landmark(
            id=number,
            label=self.names[int(tracks.belief[row].argmax())],
            status=self._status(row),
            chainage=(low + high) / 2,
            angle=angle,
            covariance=tracks.covariance[row].copy(),
            chainage_from=low,
            chainage_to=high,
            angle_from=angle + float(tracks.before[row]),
            angle_to=angle + float(tracks.after[row]),
            belief=belief.named(self.names, tracks.belief[row], float(tracks.score[row])),
            hits=int(tracks.hits[row]),
            misses=int(tracks.misses[row]),
            first_frame=int(tracks.first_frame[row]),
            last_frame=int(tracks.last_frame[row]),
            evidence=Evidence(int(frame), float(u), float(v), float(size)),
            sightings=sightings if with_sightings else (),
        )


def thumbnail_size(camera: PipeCamera, view: View, u: float, v: float, area: float) -> float:
    """Width (px) of the picture to cut out: twice the component, or half a radius of wall where only its centroid is known."""
    if area > 0:
        return 2.0 * float(np.sqrt(area))
    return 0.5 * float(np.hypot(u - view.centre[0], v - view.centre[1]))
