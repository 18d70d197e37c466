"""Smoothing of the whole way: what comes later tells where the vehicle was before."""

from __future__ import annotations

import numpy as np

from device.structure.database import shipped_knowledge
from estimators.structure.mapper import StructureMapper
from estimators.structure.objects_map import View
from estimators.structure.types import Array, Parts, Sighting
from estimators.structure.vehicle import SensorMount

MOUNT = SensorMount(np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]]), np.array([0.3, 0, 0]))
POINTS = [np.array([2.0, 1, 4]), np.array([2.0, -1, 4]), np.array([2.5, 0, 3.2]), np.array([2.2, 0.3, 3.8])]


def _place(time_s: float) -> Array:
    """Sideways, faster and slower: what no model of constant velocity foresees."""
    return np.array([0.0, -1.0 + 0.05 * time_s + 0.25 * np.sin(time_s / 4), 3.5])


def _speed(time_s: float) -> Array:
    return np.array([0.0, 0.05 + 0.0625 * np.cos(time_s / 4), 0.0])


def _survey() -> tuple[StructureMapper, Array]:
    """A way of 40 s in whose middle neither DVL nor points are there; the mapper and the true positions at the scans."""
    rng = np.random.default_rng(3)
    mapper = StructureMapper(0.0, _place(0.0), np.zeros(3), MOUNT, shipped_knowledge(), rng)
    truth = []
    for step in range(1, 401):
        time_s = step * 0.1
        blind = 12.0 < time_s < 28.0
        mapper.attitude(time_s, rng.normal(0, 0.003, 3), rng.normal(0, 0.002, 3), 0.003)
        if step % 2 == 0 and not blind:
            mapper.velocity(time_s, _speed(time_s) + rng.normal(0, 0.01, 3), 0.01)
        if step % 3 == 0:
            mapper.depth(time_s, 3.5 + rng.normal(0, 0.02), 0.02)
        if step % 20 == 0:
            origin = _place(time_s) + MOUNT.offset
            seen = [] if blind else POINTS
            sightings = [
                Sighting(
                    (p - origin) @ MOUNT.rotation + rng.normal(0, 0.005, 3), np.eye(3) * 25e-6, np.zeros((0, 3)), p[None], "end"
                )
                for p in seen
            ]
            mapper.add_parts(Parts((), tuple(sightings)))
            truth.append(_place(time_s))
    return mapper, np.array(truth)


def test_what_was_seen_later_mends_the_way_before() -> None:
    mapper, truth = _survey()
    filtered = np.array(mapper._way.states[1:])[:, :3] - truth
    points = {number: feature.point.copy() for number, feature in mapper.slam.features.items() if feature.point is not None}
    smooth = np.array(mapper.smooth())[:, :3] - truth
    blind = slice(6, 13)
    assert np.abs(filtered[blind]).max() > 0.1, "the filter drifts where nothing is seen"
    assert np.abs(smooth[blind]).max() < 0.6 * np.abs(filtered[blind]).max()
    assert np.sqrt((smooth**2).sum(axis=1).mean()) < 0.6 * np.sqrt((filtered**2).sum(axis=1).mean())
    for number, before in points.items():
        after = mapper.slam.features[number].point
        assert after is not None
        assert np.linalg.norm(after - before) < 0.03


def test_smoothing_twice_changes_nothing_more() -> None:
    mapper, _ = _survey()
    first = np.array(mapper.smooth())
    np.testing.assert_allclose(np.array(mapper.smooth()), first, atol=2e-3)


def test_what_was_seen_of_an_object_moves_with_it() -> None:
    mapper, _ = _survey()
    handle = np.array([[0.0, 0.0, -0.1], [0.05, 0.0, -0.1]])
    before = {n: f.point.copy() for n, f in mapper.slam.features.items() if f.point is not None}
    for number, point in before.items():
        mapper.objects[number].views = [View(np.zeros(3), point + handle)]
    mapper.smooth()
    for number, point in before.items():
        after = mapper.slam.features[number].point
        assert after is not None
        assert np.linalg.norm(after - point) > 1e-5
        np.testing.assert_allclose(mapper.objects[number].views[0].cloud - after, handle, atol=1e-12)


def test_one_wrong_sighting_hardly_counts() -> None:
    mapper, truth = _survey()
    number, spot = mapper._way.seen[2][0]
    mapper._way.seen[2][0] = (number, type(spot)(spot.position + 0.5, spot.covariance))
    smooth = np.array(mapper.smooth())[:, :3] - truth
    assert np.abs(smooth[2]).max() < 0.02
