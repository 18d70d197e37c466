"""The filter: Jacobians against differences, lines and points from anywhere, association, consistency, a map that grows."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from device.structure.told import consistent, warnings
from estimators.structure.coverage import Coverage
from estimators.structure.features import new_line, new_point, observe_line, observe_point
from estimators.structure.graph import final_map
from estimators.structure.jcbb import Candidate, associate, gate
from estimators.structure.mapper import Knowledge, StructureMapper
from estimators.structure.objects_map import ObjectRecord
from estimators.structure.recognition import Views
from estimators.structure.slam import SlamSettings, StructureFilter
from estimators.structure.types import Array, Parts, Segment, Sighting
from estimators.structure.vehicle import SensorMount, advanced, body_rates, rotation_of, rotation_turns, sensor_pose

seeds = st.integers(0, 10_000)


def _across(direction: Array) -> Array:
    first = np.cross(direction, np.eye(3)[int(np.argmin(np.abs(direction)))])
    first /= np.linalg.norm(first)
    return np.array([first, np.cross(direction, first)])


def _segment(start: Array, end: Array, sigma: float = 0.002) -> Segment:
    direction = (end - start) / np.linalg.norm(end - start)
    covariance = np.diag([sigma, sigma, 2 * sigma, 2 * sigma]) ** 2
    return Segment(start, end, _across(direction), covariance, np.arange(0.01, np.linalg.norm(end - start), 0.02))


def _sighting(position: Array) -> Sighting:
    return Sighting(position, np.eye(3) * 1e-4, np.zeros((0, 3)), position[None], "inline")


def _case(seed: int) -> tuple[Array, SensorMount, Segment]:
    rng = np.random.default_rng(seed)
    mount = SensorMount(Rotation.random(random_state=seed).as_matrix(), rng.normal(size=3))
    state = rng.normal(size=9) * np.array([1, 1, 1, 0.5, 0.5, 1.5, 0.2, 0.2, 0.2])
    middle, direction = rng.normal(size=3) + 2 * np.eye(3)[2], rng.normal(size=3)
    return state, mount, _segment(middle - direction, middle + direction)


def _differences(function: Callable[[Array], Array], at: Array, step: float = 1e-6) -> Array:
    columns = [(function(at + step * e) - function(at - step * e)) / (2 * step) for e in np.eye(len(at))]
    return np.array(columns).T


@settings(max_examples=20, deadline=None)
@given(seeds)
def test_jacobians_of_a_line(seed: int) -> None:
    state, mount, segment = _case(seed)
    line, by_vehicle = new_line(sensor_pose(state, mount), segment)

    def world(changed: Array) -> Array:
        other, _ = new_line(sensor_pose(changed, mount), segment)
        return np.concatenate([line.across @ (other.point - line.point), line.across @ other.direction])

    np.testing.assert_allclose(by_vehicle, _differences(world, state), atol=1e-6)
    moved = line.moved(np.random.default_rng(seed).normal(size=4) * 0.1)
    seen = observe_line(moved, sensor_pose(state, mount), segment)
    expected = _differences(lambda x: -observe_line(moved, sensor_pose(x, mount), segment).innovation, state)
    np.testing.assert_allclose(seen.by_vehicle, expected, atol=1e-5)
    by_line = _differences(lambda e: -observe_line(moved.moved(e), sensor_pose(state, mount), segment).innovation, np.zeros(4))
    np.testing.assert_allclose(seen.by_feature, by_line, atol=1e-5)


@settings(max_examples=20, deadline=None)
@given(seeds)
def test_jacobians_of_a_point_and_of_the_motion(seed: int) -> None:
    state, mount, segment = _case(seed)
    position = segment.middle
    point, by_vehicle = new_point(sensor_pose(state, mount), position)
    np.testing.assert_allclose(
        by_vehicle, _differences(lambda x: new_point(sensor_pose(x, mount), position)[0], state), atol=1e-6
    )
    seen = observe_point(point + 0.1, sensor_pose(state, mount), position, np.eye(3))
    expected = _differences(lambda x: -observe_point(point + 0.1, sensor_pose(x, mount), position, np.eye(3)).innovation, state)
    np.testing.assert_allclose(seen.by_vehicle, expected, atol=1e-6)
    rates = np.array([0.1, -0.2, 0.3])
    _, by_state, _ = advanced(state, rates, 0.5)
    np.testing.assert_allclose(by_state, _differences(lambda x: advanced(x, rates, 0.5)[0], state), atol=1e-6)


@settings(max_examples=30, deadline=None)
@given(st.tuples(*[st.floats(-1.4, 1.4)] * 3))
def test_rotations(angles: tuple[float, float, float]) -> None:
    at = np.array(angles)
    np.testing.assert_allclose(rotation_of(at), Rotation.from_euler("ZYX", at[::-1]).as_matrix(), atol=1e-12)
    flat = _differences(lambda a: rotation_of(a).ravel(), at)
    np.testing.assert_allclose(rotation_turns(at).reshape(3, 9).T, flat, atol=1e-8)
    rates = np.array([0.3, -0.1, 0.2])
    spin = rotation_of(at).T @ np.tensordot(rates, rotation_turns(at), 1)
    np.testing.assert_allclose(body_rates(at, rates), [spin[2, 1], spin[0, 2], spin[1, 0]], atol=1e-12)


@settings(max_examples=20, deadline=None)
@given(seeds)
def test_a_line_seen_again_from_where_it_was_seen_has_no_innovation_in_either_direction(seed: int) -> None:
    state, mount, segment = _case(seed)
    pose = sensor_pose(state, mount)
    line, _ = new_line(pose, segment)
    for other in (segment, _segment(segment.end, segment.start)):
        np.testing.assert_allclose(observe_line(line, pose, other).innovation, 0, atol=1e-9)


def test_joint_compatibility_refuses_what_fits_one_by_one() -> None:
    """Two observations, each 2 sigma off in opposite ways though their errors are nearly the same error."""
    common = 1.0
    covariance = np.array([[common + 0.01, common], [common, common + 0.01]])
    candidates = [Candidate(0, 10, slice(0, 1)), Candidate(1, 11, slice(1, 2))]
    assert len(associate(candidates, np.array([2.0, 2.0]), covariance)) == 2
    assert len(associate(candidates, np.array([2.0, -2.0]), covariance)) == 1


def test_one_feature_is_not_shown_twice_and_the_nearer_wins() -> None:
    candidates = [Candidate(0, 10, slice(0, 1)), Candidate(1, 10, slice(1, 2)), Candidate(1, 11, slice(2, 3))]
    best = associate(candidates, np.array([0.1, 0.0, 1.5]), np.eye(3))
    assert {(c.seen, c.feature) for c in best} == {(0, 10), (1, 11)}
    assert associate([], np.zeros(0), np.zeros((0, 0))) == []
    assert gate(3) == pytest.approx(11.345, abs=1e-3)


STRUCTURE = [
    (np.array([2.0, -1, 4]), np.array([2.0, 1, 4])),
    (np.array([2.0, 1, 4]), np.array([2.0, 1, 3])),
    (np.array([2.0, -1, 4]), np.array([3.0, -1, 4])),
]
OBJECTS = [np.array([2.0, 1, 4]), np.array([2.0, -1, 4]), np.array([2.0, 0, 4])]


def _drive(seed: int, features: bool, outage: bool = False) -> tuple[list[float], list[float], StructureFilter]:
    """Sideways past three pipes at 0.1 m/s for 60 s; errors of position and NEES at each scan."""
    rng = np.random.default_rng(seed)
    mount = SensorMount(np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]]), np.array([0.3, 0, 0]))
    plan = SlamSettings(start=0.005)
    slam = StructureFilter(np.array([0.0, -3.0, 3.5]), np.zeros(3), mount, plan)
    error, nees = [], []
    for step in range(1, 1201):
        time_s = step * 0.05
        truth = np.array([0.0, -3.0 + 0.1 * time_s, 3.5])
        slam.predict(0.05, rng.normal(0, 0.005, 3))
        slam.attitude(rng.normal(0, 0.005, 3), 0.005)
        if step % 4 == 0 and not (outage and 20 < time_s < 40):
            slam.velocity(np.array([0, 0.1, 0]) + rng.normal(0, 0.02, 3), 0.02)
        if step % 5 == 0:
            slam.depth(3.5 + rng.normal(0, 0.02), 0.02)
        if step % 40 == 0:
            rotation, origin = mount.rotation, truth + mount.offset
            if features:
                segments = []
                for a, b in STRUCTURE:
                    s = _segment((a - origin) @ rotation, (b - origin) @ rotation)
                    off, turn = rng.normal(0, 0.002, 2) @ s.across, rng.normal(0, 0.004, 2) @ s.across
                    segments.append(_segment(s.start + off - turn * s.length / 2, s.end + off + turn * s.length / 2))
                seen = tuple(
                    Sighting(
                        (p - origin) @ rotation + rng.normal(0, 0.01, 3), np.eye(3) * 1e-4, np.zeros((0, 3)), p[None], "inline"
                    )
                    for p in OBJECTS
                )
                slam.scan(tuple(segments), seen)
            away = slam.vehicle[:3] - truth
            error.append(float(np.linalg.norm(away)))
            nees.append(float(away @ np.linalg.solve(slam.covariance[:3, :3], away)))
    return error, nees, slam


def test_the_map_keeps_the_position_through_an_outage_and_is_not_too_sure_of_it() -> None:
    runs = [_drive(seed, True, outage=True) for seed in range(3)]
    reckoned = [_drive(seed, False, outage=True) for seed in range(3)]
    rms = np.sqrt(np.mean([np.square(run[0]) for run in runs]))
    assert rms < 0.03
    assert np.sqrt(np.mean([np.square(run[0]) for run in reckoned])) > 2 * rms
    assert 0.5 < np.mean([run[1] for run in runs]) < 6.0
    for _, _, slam in runs:
        assert sorted(f.size for f in slam.features.values()) == [3, 3, 3, 4, 4, 4]
        np.testing.assert_allclose(slam.covariance, slam.covariance.T, atol=1e-12)
        assert np.linalg.eigvalsh(slam.covariance).min() > -1e-12


def test_volumes_shrink_with_sightings() -> None:
    slam = StructureFilter(np.zeros(3), np.zeros(3), SensorMount(np.eye(3), np.zeros(3)))
    segment = _segment(np.array([-0.5, 0, 2]), np.array([0.5, 0, 2]))
    sighting = _sighting(np.array([0.0, 0, 2]))
    slam.scan((segment,), (sighting,))
    volumes = [[slam.volume(number) for number in slam.features]]
    for _ in range(4):
        slam.scan((segment,), (sighting,))
        volumes.append([slam.volume(number) for number in slam.features])
    assert np.all(np.diff(volumes, axis=0) < 0)


def test_an_outlier_velocity_is_refused_and_upright_pipes_may_be_asked_for() -> None:
    slam = StructureFilter(np.zeros(3), np.zeros(3), SensorMount(np.eye(3), np.zeros(3)), SlamSettings(upright=True))
    assert slam.velocity(np.array([0.1, 0, 0]), 0.01)
    assert not slam.velocity(np.array([5.0, 0, 0]), 0.01)
    slam.scan(
        (_segment(np.array([0.0, 0, 2]), np.array([0.7, 0, 2.7])), _segment(np.array([0.0, 1, 2]), np.array([0.7, 1, 2]))), ()
    )
    assert len(slam.features) == 1


def test_a_dropped_feature_leaves_the_others_in_place() -> None:
    slam = StructureFilter(np.zeros(3), np.zeros(3), SensorMount(np.eye(3), np.zeros(3)))
    positions = [np.array([x, 0.0, 2.0]) for x in (0.0, 1.0, 2.0)]
    slam.scan((), tuple(_sighting(p) for p in positions))
    before = slam.covariance[15:18, 15:18].copy()
    slam.drop(2)
    assert list(slam.features) == [1, 3]
    at = slam.features[3].at
    np.testing.assert_array_equal(slam.covariance[at : at + 3, at : at + 3], before)


def mapped(scans: int = 4) -> StructureFilter:
    """A filter that has seen three pipes and three objects a few times from where it stands."""
    slam = StructureFilter(np.zeros(3), np.zeros(3), SensorMount(np.eye(3), np.zeros(3)))
    for _ in range(scans):
        slam.scan(*shown())
    return slam


def shown(away: Sequence[Array] | Array | None = None) -> tuple[tuple[Segment, ...], tuple[Sighting, ...]]:
    """The structure, each part ``away`` (3,) from where it is, or all of it by the only one."""
    shifts = [np.zeros(3)] if away is None else list(away)
    shifts = shifts * 6 if len(shifts) == 1 else shifts
    segments = tuple(_segment(a + shift, b + shift) for (a, b), shift in zip(STRUCTURE, shifts[:3], strict=True))
    return segments, tuple(_sighting(p + shift) for p, shift in zip(OBJECTS, shifts[3:], strict=True))


def test_a_mistake_does_not_keep_what_is_really_there_out_of_the_map() -> None:
    """The first that is seen of a pipe and of an object is 8 cm beside them: too far to fit, too near to be something else."""
    off = np.array([0.08, 0.0, 0.0])
    slam = StructureFilter(np.zeros(3), np.zeros(3), SensorMount(np.eye(3), np.zeros(3)))
    segments, sightings = shown()
    for scan in range(8):
        if scan == 0:
            slam.scan(*shown([np.zeros(3), off, np.zeros(3), off, np.zeros(3), np.zeros(3)]))
            assert len(slam.features) == 6
        else:
            slam.scan(segments, sightings)
    assert len(slam.features) == 6
    assert {number for number in slam.features if number > 6} == {7, 8}
    points = sorted(tuple(f.point.round(2)) for f in slam.features.values() if f.point is not None)
    assert points == sorted(tuple(p) for p in OBJECTS)
    for a, b in STRUCTURE:
        lines = [f.line for f in slam.features.values() if f.line is not None]
        offs = [np.array([a, b]) - line.point - line.along(np.array([a, b]))[:, None] * line.direction for line in lines]
        assert min(np.linalg.norm(off, axis=1).max() for off in offs) < 0.01


def test_now_and_then_something_beside_a_feature_drops_nothing() -> None:
    slam = mapped()
    for scan in range(20):
        slam.scan(*shown([np.array([0.0, 0.0, 0.08 * (scan % 3 == 0)]), *[np.zeros(3)] * 5]))
    assert sorted(slam.features) == [1, 2, 3, 4, 5, 6]


def test_a_vehicle_that_was_pushed_is_found_again_and_nothing_is_taken_in_twice() -> None:
    slam = mapped()
    pushed = np.array([0.10, -0.12, 0.08])
    matches = slam.scan(*shown([-pushed]))
    assert not matches.expected
    assert matches.agrees
    assert matches.moved == pytest.approx(np.linalg.norm(pushed), abs=0.01)
    assert np.linalg.norm(slam.vehicle[:3] - pushed) < 0.01
    assert len(slam.features) == 6


def test_nothing_new_is_taken_in_from_a_place_that_is_in_doubt() -> None:
    """After a scan that fits only from elsewhere three have to look as they should before the map grows again."""
    slam = mapped()
    pushed = np.array([0.10, -0.12, 0.08])
    segments, sightings = shown([-pushed])
    more = _sighting(np.array([0.8, 0.8, 2.8]) - pushed)
    assert not slam.scan(segments, (*sightings, more)).expected
    for _ in range(2):
        slam.scan(segments, (*sightings, more))
        slam.scan((), (more,))  # shows nothing that is known, and so confirms nothing
        assert len(slam.features) == 6
    slam.scan(segments, (*sightings, more))
    assert len(slam.features) == 7


def test_a_scan_that_fits_from_nowhere_changes_nothing_but_how_sure_the_position_is() -> None:
    slam = mapped()
    directions = np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1], [-1, 0, 0], [0, -1, 0], [0, 0, -1]])
    before, sure = slam.vehicle.copy(), np.trace(slam.covariance[:3, :3])
    matches = slam.scan(*shown(0.12 * directions))
    assert not matches.agrees
    assert set(matches.segments) | set(matches.sightings) == {-1}
    assert len(slam.features) == 6
    np.testing.assert_array_equal(slam.vehicle, before)
    assert np.trace(slam.covariance[:3, :3]) > 100 * sure
    assert slam.scan(*shown()).expected


def navigator(yaw: float = np.pi / 2) -> StructureMapper:
    """A mapper that has seen nothing, and looks east if not told otherwise."""
    knowledge = Knowledge(
        Views(np.zeros((0, 308)), np.zeros(0, dtype=np.intp), np.zeros((0, 3))), *np.full((2, 6, 6), 1 / 6), np.ones((6, 3))
    )
    mount = SensorMount(np.eye(3), np.zeros(3))
    return StructureMapper(0.0, np.zeros(3), np.array([0, 0, yaw]), mount, knowledge, np.random.default_rng(0))


@pytest.mark.parametrize("sudden", [True, False])
def test_a_vehicle_that_starts_at_once_is_where_its_velocity_took_it(sudden: bool) -> None:
    """The first readings of a new speed look like outliers; when they are believed, the way since then is made good."""
    mapper = navigator()
    times = np.arange(0.0, 6.0, 0.2)
    speeds = np.where(times < 2.0, 0.0, 0.3) if sudden else np.clip(0.4 * (times - 2.0), 0.0, 0.3)
    way = 0.0
    for time_s, speed, before in zip(times, speeds, [0.0, *speeds[:-1]], strict=True):
        way += 0.2 * (before + speed) / 2 if time_s else 0.0
        mapper.attitude(float(time_s), np.array([0, 0, np.pi / 2]), np.zeros(3), 0.005)
        mapper.velocity(float(time_s), np.array([speed, 0.0, 0.0]), 0.01)
    assert mapper.doubts.refused >= 5
    away = mapper.slam.vehicle[:3] - np.array([0.0, way, 0.0])  # it looks east
    # believed after 1.2 s: a change at once has lost 1.2 s of it, one that grows evenly half of that; in between is taken
    assert np.linalg.norm(away) < 0.3 * (1.2 / 4 + 0.2 / 4)
    assert away @ np.linalg.solve(mapper.slam.covariance[:3, :3], away) < gate(3)


def driven(mapper: StructureMapper, readings: Sequence[tuple[float, float]]) -> tuple[float, float]:
    """Where (m, forwards) readings of (time, speed) take a mapper, and how sure it is."""
    for time_s, speed in readings:
        mapper.attitude(time_s, np.array([0, 0, np.pi / 2]), np.zeros(3), 0.005)
        mapper.velocity(time_s, np.array([speed, 0.0, 0.0]), 0.01)
    return float(mapper.slam.vehicle[1]), float(np.sqrt(mapper.slam.covariance[1, 1]))


def every(begin: float, end: float, speed: float) -> list[tuple[float, float]]:
    return [(float(time_s), speed) for time_s in np.arange(begin, end - 1e-9, 0.2)]


@pytest.mark.parametrize("outage_s", [0.0, 10.0])
@pytest.mark.parametrize("bursts", [1, 3, 4])
def test_a_short_burst_of_the_dvl_moves_nothing(outage_s: float, bursts: int) -> None:
    at = 2.0 + outage_s
    wrong = every(at, at + 0.2 * bursts, 0.6)
    way, _ = driven(navigator(), [*every(0.0, 2.0, 0.0), *wrong, *every(at + 0.2 * bursts, at + 4.0, 0.0)])
    assert abs(way) < 0.01


@pytest.mark.parametrize("begun_s", [0.0, 5.0, 10.0])
def test_a_start_during_an_outage_is_in_doubt_by_as_much_as_it_may_have_missed(begun_s: float) -> None:
    """Nothing tells when in the outage the vehicle set off."""
    way, sure = driven(navigator(), [*every(0.0, 2.0, 0.0), *every(12.0, 16.0, 0.3)])
    truth = 0.3 * (16.0 - 0.2 - (2.0 + begun_s))
    assert abs(way - truth) < 2.8 * sure


def test_one_outlier_moves_nothing() -> None:
    slam = StructureFilter(np.zeros(3), np.zeros(3), SensorMount(np.eye(3), np.zeros(3)))
    assert slam.velocity(np.zeros(3), 0.01)
    slam.predict(0.2, np.zeros(3))
    assert not slam.velocity(np.array([0.5, 0, 0]), 0.01)
    slam.predict(0.2, np.zeros(3))
    assert slam.velocity(np.zeros(3), 0.01)
    assert np.linalg.norm(slam.vehicle[:3]) < 1e-9


def seeing(every_s: float = 2.0, scans: int = 12, dvl_until_s: float = 1e9, pushed_at_s: float = 1e9) -> StructureMapper:
    """A mapper before the structure, which stands half a metre further from ``pushed_at_s`` on."""
    mapper = navigator(0.0)
    for time_s in np.arange(0.0, scans * every_s, 0.2):
        mapper.attitude(float(time_s), np.zeros(3), np.zeros(3), 0.005)
        if time_s < dvl_until_s:
            mapper.velocity(float(time_s), np.zeros(3), 0.01)
        if round(time_s / 0.2) % round(every_s / 0.2) == 0:
            away = np.array([0.0, 0.5 * (time_s >= pushed_at_s), 0.0])
            mapper.add_parts(Parts(*shown([away])))
    return mapper


def test_what_speaks_against_a_map_is_said() -> None:
    mapper = seeing()
    assert consistent(mapper)
    assert warnings(mapper) == []
    mapper = seeing(scans=20, dvl_until_s=5.0)
    assert consistent(mapper)
    assert warnings(mapper) == ["The DVL said nothing for 35 s."]
    assert len(mapper.slam.features) == 6


def test_a_structure_that_was_moved_is_said_to_be() -> None:
    mapper = seeing(pushed_at_s=12.0, scans=20)
    assert not consistent(mapper)
    assert any("the structure was moved" in warning for warning in warnings(mapper)), warnings(mapper)
    assert len(mapper.slam.features) == 6


def test_without_an_ahrs_the_structure_tells_how_the_vehicle_turns() -> None:
    mapper, yaw = navigator(0.0), 0.0
    for time_s in np.arange(0.0, 30.1, 0.2):
        yaw = 0.02 * max(float(time_s) - 6.0, 0.0)
        if time_s < 6.0:
            mapper.attitude(float(time_s), np.zeros(3), np.zeros(3), 0.005)
        mapper.velocity(float(time_s), np.zeros(3), 0.01)
        if round(time_s / 0.2) % 10 == 0:
            body = rotation_of(np.array([0.0, 0.0, yaw]))
            segments = tuple(_segment(a @ body, b @ body) for a, b in STRUCTURE)
            mapper.add_parts(Parts(segments, tuple(_sighting(p @ body) for p in OBJECTS)))
    assert mapper.slam.vehicle[5] == pytest.approx(yaw, abs=0.01)
    assert np.linalg.norm(mapper.slam.vehicle[:3]) < 0.03
    assert len(mapper.slam.features) == 6
    assert not consistent(mapper)  # where few scans come it turns astray unnoticed
    assert warnings(mapper) == [
        "Nothing but the scans told for 24 s how the scanner was turned.",
        "The AHRS said nothing for 24 s.",
    ]


def test_what_few_of_many_scans_saw_on_a_pipe_is_no_object() -> None:
    slam, coverage, records = mapped(60), {}, {}
    for number, feature in slam.features.items():
        if feature.line is None:
            records[number] = ObjectRecord()
            continue
        coverage[number] = Coverage()
        for _ in range(60):
            coverage[number].add(np.arange(feature.low, feature.high, 0.02))
    assert len(final_map(slam, coverage, records, 60).objects) == 3
    inline = next(f for f in slam.features.values() if f.point is not None and abs(f.point[1]) < 0.1)
    for seen, there in ((6, 2), (9, 3)):
        inline.sightings = seen
        assert len(final_map(slam, coverage, records, 60).objects) == there


def test_two_objects_that_come_to_lie_in_each_other_are_one() -> None:
    """First seen 16 cm off and unsure along the pipe, so that it is taken in beside the one that is known."""
    slam = mapped()
    unsure = np.diag([0.005, 0.06, 0.005]) ** 2
    segments, sightings = shown()
    beside = Sighting(OBJECTS[2] + np.array([0.0, 0.16, 0.0]), unsure, np.zeros((0, 3)), np.zeros((1, 3)), "end")
    slam.scan(segments, (*sightings, beside))
    assert len(slam.features) == 7
    for _ in range(6):
        nearer = Sighting(OBJECTS[2] + np.array([0.0, 0.06, 0.0]), unsure, np.zeros((0, 3)), np.zeros((1, 3)), "end")
        matches = slam.scan(segments, (*sightings, nearer))
        assert {*matches.segments, *matches.sightings} - {-1} <= set(slam.features)
    assert sorted(slam.features) == [1, 2, 3, 4, 5, 6]
