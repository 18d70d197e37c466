"""Rings drawn by hand, where every radius and centre is known: rho = F / Z, centre = c + (e / R) rho."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from estimators.rings import FocalRadius, JointConfig, JointRing, Ring, RingMap, axis_view, dark_centre, find, ring_centres

SIZE = (720, 576)


def pipe(
    radii: list[float],
    centre: tuple[float, float] = (360, 288),
    lean: tuple[float, float] = (0.0, 0.0),
    aspect: float = 1.0,
    seed: int = 0,
) -> np.ndarray:
    """A dark hole, light that falls off towards it, a noisy wall, and a dark line for each radius."""
    u, v = np.meshgrid(np.arange(SIZE[0]), np.arange(SIZE[1]))
    rho = np.hypot(u - centre[0], v - centre[1])
    image = 150 * (1 - np.exp(-((rho / 130) ** 2)))
    grain = cv2.GaussianBlur(np.random.default_rng(seed).normal(size=image.shape), (0, 0), 2.5)
    image = (image + 6) * (1 + 0.05 * grain / grain.std())
    picture = np.clip(image, 0, 255).astype(np.uint8)
    for radius in radii:
        middle = (centre[0] + lean[0] * radius, centre[1] + lean[1] * radius)
        shade = int(0.45 * picture[int(middle[1]), int(np.clip(middle[0] + radius, 0, SIZE[0] - 1))])
        points = tuple(round(16 * value) for value in middle)
        axes = (round(16 * radius * np.sqrt(aspect)), round(16 * radius / np.sqrt(aspect)))
        cv2.ellipse(picture, points, axes, 0, 0, 360, shade, max(2, round(radius / 40)), cv2.LINE_AA, 4)
    return picture


def near(rings: list[Ring], radius: float) -> Ring:
    return min(rings, key=lambda ring: abs(ring.radius - radius))


def test_finds_the_rings_that_are_drawn() -> None:
    rings = find(pipe([45, 90, 200]), (360, 288))
    for radius in (45, 90, 200):
        ring = near(rings, radius)
        assert ring.radius == pytest.approx(radius, abs=max(2.0, 0.02 * radius))
        assert ring.centre == pytest.approx((360, 288), abs=3)
        assert ring.quality > 0.6


def test_finds_none_where_none_is() -> None:
    assert [ring for ring in find(pipe([]), (360, 288)) if ring.quality > 0.6] == []


@settings(max_examples=10, deadline=None)
@given(x=st.floats(-0.25, 0.25), y=st.floats(-0.25, 0.25), seed=st.integers(0, 9))
def test_a_camera_off_the_axis(x: float, y: float, seed: int) -> None:
    rings = find(pipe([60, 130], lean=(x, y), seed=seed), (360, 288))
    for radius in (60, 130):
        ring = near(rings, radius)
        assert ring.radius == pytest.approx(radius, rel=0.05, abs=1)
        assert ring.centre == pytest.approx((360 + x * radius, 288 + y * radius), abs=0.06 * radius)


def test_pixels_that_are_not_square() -> None:
    ring = near(find(pipe([110], aspect=1.1), (360, 288)), 110)
    assert ring.across / ring.upright == pytest.approx(1.1, abs=0.03)
    assert ring.radius == pytest.approx(110, rel=0.02)


def test_the_aspect_is_told_back_by_the_map() -> None:
    found = RingMap()
    for seed in range(8):
        rings = find(pipe([60 + 12 * seed], aspect=1.12, seed=seed), (360, 288), aspect=found.aspect)
        found.add(seed, float(seed), rings)
    assert found.aspect == pytest.approx(1.12, abs=0.02)
    assert near(find(pipe([110], aspect=1.12), (360, 288), aspect=1.12), 110).radius == pytest.approx(110, rel=0.01)


def test_the_known_lean_narrows_the_search() -> None:
    rings = find(pipe([70, 150], lean=(0.15, -0.1)), (360, 288), lean=(0.14, -0.12))
    assert near(rings, 150).radius == pytest.approx(150, rel=0.02)


def test_the_dark_end_is_where_to_look() -> None:
    assert dark_centre(pipe([], centre=(300, 330))) == pytest.approx((300, 330), abs=15)


def test_black_borders_are_no_ring() -> None:
    picture = pipe([80])
    picture[:, :14] = 0
    picture[:, -12:] = 0
    assert [ring for ring in find(picture, (360, 288)) if abs(ring.radius - 80) > 5 and ring.quality > 0.6] == []


def ring(radius: float, centre: tuple[float, float] = (0.0, 0.0), quality: float = 0.8) -> Ring:
    return Ring(centre, radius, radius, 0.3, quality, 1.0)


def test_centre_and_lean_from_two_rings() -> None:
    lean = np.array([0.1, -0.2])
    rings = [ring(radius, tuple(np.array([350.0, 290.0]) + lean * radius)) for radius in (30, 80, 200)]
    view = axis_view(rings)
    assert view is not None
    assert view.centre == pytest.approx([350, 290], abs=0.5)
    assert view.lean == pytest.approx(lean, abs=0.01)


def test_one_ring_beside_the_focus_of_expansion_tells_the_lean() -> None:
    view = axis_view([ring(120, (350 + 12, 290 - 24))], foe=((350.0, 290.0), 2.0))
    assert view is not None
    assert view.lean == pytest.approx([0.1, -0.2], abs=0.02)
    assert view.centre == pytest.approx([350, 290], abs=1)


def test_rings_that_lean_too_much_are_not_of_one_pipe() -> None:
    assert axis_view([ring(30, (300, 300)), ring(60, (340, 300))]) is None


def test_one_ring_or_two_alike_tell_no_lean() -> None:
    assert axis_view([ring(50)]) is None
    assert axis_view([ring(50), ring(52)]) is None


FOCAL, PIPE_M, RADIUS_M, STEP_M = 700.0, 5.4, 0.33, 0.55
BEYOND = {1: (0.05, -0.45), 2: (-0.1, 0.4)}
"""How far (m) the joint after the next lies beside the crawler's own pipe, from the first pipe and from the second."""


def bent_pipe(noise: float = 0.0, seed: int = 0) -> tuple[list[JointRing], dict[int, np.ndarray]]:
    """Stills half a metre apart through two pipes, of a camera 3 cm below the axis that is panned from one to the other; rings
    at f R / Z around c + f e / Z, and the true c of each still."""
    rng = np.random.default_rng(seed)
    seen, truth = [], {}
    for k in range(20):
        passed, into = divmod(k * STEP_M, PIPE_M)
        pipe = int(passed) + 1
        truth[k] = np.array([360.0, 240.0]) + rng.uniform(-90, 90, 2)
        for ahead, beside in ((0, (0.0, 0.03)), (1, BEYOND[pipe])):
            depth = (ahead + 1) * PIPE_M - into
            if 0.35 < depth < 8:
                centre = truth[k] + FOCAL * np.array(beside) / depth + rng.normal(0, noise, 2)
                seen.append(JointRing(k, pipe, pipe + ahead, ring(FOCAL * RADIUS_M / depth, (centre[0], centre[1]))))
    return seen, truth


def test_rings_of_a_pipe_that_bends_tell_where_the_crawler_goes_while_the_camera_pans() -> None:
    seen, truth = bent_pipe()
    found = ring_centres(seen)
    pairs = [k for k in truth if sum(one.picture == k for one in seen) == 2]
    assert len(pairs) >= 8
    for k in pairs:
        assert found[k].centre == pytest.approx(truth[k], abs=2.5)
        assert found[k].lean == pytest.approx([0.0, 0.03 / RADIUS_M], abs=0.02)
        straight = axis_view([one.ring for one in seen if one.picture == k])
        assert straight is None or np.hypot(*(straight.centre - truth[k])) > 20, "on one line they lead into the next pipe"


def test_centres_of_rings_err_as_they_say() -> None:
    squares = []
    for seed in range(12):
        seen, truth = bent_pipe(noise=1.5, seed=seed)
        found = ring_centres(seen)
        squares += [float(np.sum((found[k].centre - truth[k]) ** 2) / found[k].covariance[0, 0] / 2) for k in found]
    assert 0.3 < np.mean(squares) < 1.5


def test_a_ring_drawn_beside_its_joint_pulls_no_centre() -> None:
    seen, truth = bent_pipe()
    large = max(range(len(seen)), key=lambda k: seen[k].ring.radius)
    joint = seen[large]
    wrong = Ring((joint.ring.centre[0] - 80, joint.ring.centre[1]), joint.ring.across + 80, joint.ring.upright, 0.5, 0.8, 1.0)
    found = ring_centres([*seen[:large], replace(joint, ring=wrong), *seen[large + 1 :]])
    others = [k for k in truth if k != joint.picture and sum(one.picture == k for one in seen) == 2]
    assert all(np.hypot(*(found[k].centre - truth[k])) < 5 for k in others)


def test_one_ring_of_another_pipe_says_next_to_nothing() -> None:
    assert ring_centres([]) == {}
    view = ring_centres([JointRing(0, 3, 4, ring(40, (300, 200)))])[0]
    assert np.sqrt(view.covariance[0, 0]) > 50


def drive(
    focal: float, joints: list[float], seed: int = 0, clutter: int = 0, noise: float = 0.004
) -> list[tuple[int, float, list[Ring]]]:
    """Rings of a drive from 0 to 12 in steps of 0.4, some missed, and false ones."""
    rng = np.random.default_rng(seed)
    frames = []
    for frame, position in enumerate(np.arange(0, 12, 0.4)):
        seen = []
        for joint in joints:
            depth = joint - position
            if depth > 0 and 20 < focal / depth < 300 and rng.random() < 0.8:
                seen.append(ring(focal / depth * (1 + noise * rng.normal())))
        seen += [ring(float(np.exp(rng.uniform(3, 5.7))), quality=0.5) for _ in range(rng.poisson(clutter))]
        frames.append((frame, float(position), seen))
    return frames


@pytest.mark.parametrize(("focal", "clutter"), [(180.0, 0), (180.0, 2), (420.0, 1), (60.0, 1)])
def test_joints_and_focal_radius_of_a_drive(focal: float, clutter: int) -> None:
    joints = [4.6, 7.0, 9.6]
    found = RingMap(config=JointConfig(position_std=0.02))
    for frame, position, rings in drive(focal, joints, clutter=clutter):
        found.add(frame, position, rings)
    result = found.solve()
    assert result.focal_radius is not None
    assert result.focal_radius.value == pytest.approx(focal, rel=0.02)
    assert abs(result.focal_radius.value - focal) < 4 * result.focal_radius.sigma
    places = [joint.chainage for joint in result.joints]
    for joint in joints:
        assert min(abs(joint - place) for place in places) < 0.08
    assert len(places) <= len(joints) + (1 if clutter else 0)


def test_one_ring_far_behind_the_others_takes_no_joint_away() -> None:
    """A joint is seen over the last metre and a half; nobody asks where it was before because something far off lay on its
    place."""
    found = RingMap(config=JointConfig(position_std=0.05))
    for frame, position in enumerate(np.arange(0, 10, 0.06)):
        depths = [joint - position for joint in (2.0, 4.0, 6.0, 8.0, 10.0)]
        rings = [ring(66 / depth) for depth in depths if 0.25 < depth < 1.5]
        found.add(frame, float(position), [*rings, ring(66 / (6.0 - position), quality=0.5)] if frame in (8, 9) else rings)
    result = found.solve()
    assert [joint.chainage for joint in result.joints] == pytest.approx([2, 4, 6, 8, 10], abs=0.02)
    assert all(sighting.ring.radius > 40 for joint in result.joints for sighting in joint.sightings)


def test_joints_that_disagree_leave_the_focal_radius_unsure() -> None:
    told = []
    for apart in (0.0, 0.05):
        found = RingMap(config=JointConfig(position_std=0.02))
        for frame, position in enumerate(np.arange(0, 16, 0.2)):
            depths = {k: joint - position for k, joint in enumerate((4.0, 7.0, 10.0, 13.0, 16.0)) if 0.6 < joint - position < 5}
            # in every second pipe the inner edge of the joint is what shows
            found.add(frame, float(position), [ring(180 * (1 + apart * (k % 2)) / depth) for k, depth in depths.items()])
        result = found.solve(last=True)
        assert result.focal_radius is not None
        assert result.focal_radius.value == pytest.approx(180 * (1 + 0.4 * apart), rel=0.02)
        told.append(result.focal_radius.sigma / result.focal_radius.value)
    assert told[0] == pytest.approx(JointConfig().common_std, rel=0.05)
    # five joints that differ by 2.5 % either way tell their mean to 2.5 % / sqrt(5) at best
    assert told[1] > np.hypot(JointConfig().common_std, 0.025 / np.sqrt(5))


def test_what_does_not_grow_is_no_joint() -> None:
    found = RingMap(FocalRadius(180.0, 0.0, known=True))
    for frame, position in enumerate(np.arange(0, 12, 0.2)):
        found.add(frame, float(position), [ring(60.0)])
    assert found.solve().joints == ()


def test_an_edge_that_vanishes_long_before_the_camera_is_no_joint() -> None:
    found = RingMap(FocalRadius(180.0, 0.0, known=True))
    for frame, position in enumerate(np.arange(0, 12, 0.2)):
        seen = [ring(180 / (joint - position)) for joint in (6.0, 9.0) if 0.6 < joint - position < 5]
        edge = 11.0 - float(position)
        found.add(frame, float(position), seen + ([ring(180 / edge)] if 6.0 < edge < 9 else []))
    places = [joint.chainage for joint in found.solve().joints]
    assert places == pytest.approx([6.0, 9.0], abs=0.05)


def test_nothing_and_one_ring_give_an_empty_map() -> None:
    found = RingMap()
    assert found.solve().joints == ()
    assert found.solve().focal_radius is None
    found.add(0, 0.0, [ring(50)])
    assert found.solve().joints == ()


def test_standing_still_is_no_evidence() -> None:
    found = RingMap(FocalRadius(180.0, 0.0, known=True))
    for frame in range(50):
        found.add(frame, 3.0, [ring(90.0)])
    assert found.solve().joints == ()
