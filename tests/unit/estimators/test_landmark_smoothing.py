import itertools
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from device.landmarks.smoothing import smooth_drive
from estimators.detections import Detection
from estimators.landmarks.projection import PipeCamera, View, project
from estimators.landmarks.smoothing import (
    NO_RINGS,
    Constraints,
    Frames,
    Known,
    Lateral,
    Noise,
    RingSightings,
    Run,
    Sightings,
    find_doubles,
    identified,
    merged,
    moved,
    run_of,
    smooth,
    smooth_survey,
)
from estimators.landmarks.smoothing import slips as slip_module
from estimators.landmarks.smoothing.knots import knots_of
from estimators.landmarks.smoothing.system import build
from estimators.landmarks.types import Evidence, Landmark, Observation, Sighting
from tests.bench import landmark_smoothing

FOCAL_RADIUS = 120.0
CENTRE = np.array([360.0, 288.0])
GIVEN = Constraints(focal_radius=Known(FOCAL_RADIUS, 1e-3))
QUIET = Noise(centre_std=1e-4, axis_std=1e-5, slip_rate=1e-8, drift=1e-4, roll_std=0.0, ring_share=0.0, landmark_share=0.0)
"""A run with nothing wrong but the pixels."""


def drive(
    x: np.ndarray,
    counted: np.ndarray,
    landmarks: np.ndarray,
    noise_px: float = 0.0,
    rng: np.random.Generator | None = None,
    ring_at: tuple[float, ...] = (),
    sight: float = 5.0,
    std: float = 15.0,
    fps: float = 5.0,
    height: float = 1.0,
) -> Run:
    """What is seen from cameras at ``x`` of landmarks (N, 2) at so many radii from the axis, and of rings at ``ring_at``."""
    rng = rng or np.random.default_rng(0)
    owner, frame, pixels = [], [], []
    rings = []
    for k, (chainage, angle) in enumerate(landmarks):
        for i in np.flatnonzero((chainage - x > 0.4) & (chainage - x < sight)):
            owner.append(k)
            frame.append(i)
            direction = height * np.array([np.cos(angle), np.sin(angle)])
            pixels.append(CENTRE + FOCAL_RADIUS * direction / (chainage - x[i]) + rng.normal(0, noise_px, 2))
    for k, chainage in enumerate(ring_at):
        for i in np.flatnonzero((chainage - x > 0.45) & (chainage - x < 4)):
            rings.append((k, i, FOCAL_RADIUS / (chainage - x[i]) + rng.normal(0, noise_px / 5)))
    circles = np.array(rings, dtype=float).reshape(-1, 3)
    count = len(x)
    return Run(
        Frames(np.arange(count) / fps, counted, np.tile(CENTRE, (count, 1)), np.zeros((count, 2))),
        Sightings(
            np.array(owner, dtype=np.int64),
            np.array(frame, dtype=np.int64),
            np.array(pixels, dtype=float).reshape(-1, 2),
            np.full(len(owner), std),
        ),
        RingSightings(
            circles[:, 0].astype(np.int64), circles[:, 1].astype(np.int64), circles[:, 2], np.full(len(circles), std / 5)
        ),
    )


def positions(result, run: Run) -> np.ndarray:
    assert result.positions.shape == result.position_std.shape == run.frames.time_s.shape
    return result.positions


# ---- the problem itself


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 10_000), aspect=st.floats(0.8, 1.3))
def test_jacobian_is_the_slope_of_the_residuals(seed: int, aspect: float) -> None:
    rng = np.random.default_rng(seed)
    x = np.linspace(0, 2, 21)
    run = replace(drive(x, x, np.array([[2.9, 0.7], [3.5, -2.0]]), 10.0, rng, (3.2,)), aspect=aspect)
    run = replace(run, frames=replace(run.frames, axis=rng.normal(0, 0.05, (21, 2))))
    system = build(run, GIVEN, Noise())
    state = system.initial + rng.normal(0, 0.02, len(system.initial))
    slope = system.jacobian(state).toarray()

    def flat(at: np.ndarray) -> np.ndarray:
        seen, rings = system.residuals(at)
        return np.concatenate([seen[:, 0], seen[:, 1], rings])

    for column in range(len(state)):
        step = np.zeros(len(state))
        step[column] = 1e-6
        numeric = (flat(state + step) - flat(state - step)) / 2e-6
        assert slope[:, column] == pytest.approx(numeric, rel=1e-4, abs=1e-4)


def test_residuals_follow_equation_5() -> None:
    camera, x = PipeCamera(400.0, 400.0, 0.3, 720, 576), np.array([0.0, 0.5])
    run = drive(x, x, np.array([[2.0, 0.3]]))
    axis = np.array([[0.02, -0.01], [0.02, -0.01]])
    run = replace(run, frames=replace(run.frames, axis=axis / 0.3))
    system = build(run, GIVEN, Noise())
    system.initial[system.layout.landmarks : system.layout.landmarks + 2] = 2.1, 0.4
    seen, _ = system.residuals(system.initial)
    for i, position in enumerate(x):
        expected = project(camera, View(position, (360.0, 288.0), (0.02, -0.01)), np.array([[2.1, 0.4]]))[0]
        assert run.sightings.pixels[i] + 15.0 * seen[i] == pytest.approx(expected, abs=1e-9)


def test_one_sighting_of_one_landmark_by_hand() -> None:
    # At depth Z straight to the right of the centre: chainage follows u by Z^2 / fR, the angle follows v by Z / fR.
    run = drive(np.array([0.0]), np.array([0.0]), np.array([[1.5, 0.0]]), std=2.0)
    result = smooth(run, replace(GIVEN, start=Known(0.0, 1e-4)), QUIET)
    mark = result.landmarks[0]
    assert (mark.chainage, mark.angle) == pytest.approx((1.5, 0.0), abs=1e-4)
    assert np.sqrt(mark.covariance[0, 0]) == pytest.approx(2.0 * 1.5**2 / FOCAL_RADIUS, rel=0.02)
    assert np.sqrt(mark.covariance[1, 1]) == pytest.approx(2.0 * 1.5 / FOCAL_RADIUS, rel=0.02)
    assert mark.covariance[0, 1] == pytest.approx(0.0, abs=1e-5)


def test_two_landmarks_tell_the_scale_of_the_tether() -> None:
    # Seen without noise, 2 m and 4 m on: the camera went 3 m while the tether counted 3 / 1.02.
    x = np.linspace(0, 3, 61)
    landmarks = np.array([[3.8, 0.5], [4.2, 3.0]])
    result = smooth(drive(x, x / 1.02, landmarks, std=1.0), GIVEN, QUIET)
    assert result.converged
    assert result.scale.value == pytest.approx(1.02, abs=1e-3)
    assert positions(result, drive(x, x, landmarks)) == pytest.approx(x, abs=0.01)
    for mark, (chainage, angle) in zip(result.landmarks, landmarks, strict=True):
        assert (mark.chainage, mark.angle) == pytest.approx((chainage, angle), abs=0.01)
    assert result.slips == ()


@pytest.mark.parametrize("height", [0.96, 1.03])
def test_landmarks_that_are_not_on_the_wall_do_not_stretch_the_tether(height: float) -> None:
    # Deposits stand into the pipe, of a hole the far edge shows: what looks like another scale must not be believed as one.
    x = np.linspace(0, 12, 121)
    landmarks = np.array([[2.0 * k + 2.5, 0.7 * k] for k in range(6)])
    run = drive(x, x, landmarks, noise_px=4.0, std=4.0, height=height)
    result = smooth(run, replace(GIVEN, scale=Known(1.0, 0.02)), Noise())
    assert result.converged
    for mark, (chainage, _) in zip(result.landmarks, landmarks, strict=True):
        assert abs(mark.chainage - chainage) < 3 * np.sqrt(mark.covariance[0, 0])
    last = result.landmarks[-1].chainage - landmarks[-1, 0]
    assert abs(last) < 0.5 * abs(height - 1) * landmarks[-1, 0], "half of what the other scale would make of the whole way"


def test_the_length_is_the_scale_where_nothing_is_seen() -> None:
    # scale * 20 = 20.4 +- 0.02, beside a scale of 1 +- 0.05: the length has nearly all the say.
    counted = np.linspace(0, 20, 101)
    run = drive(counted, counted, np.empty((0, 2)))
    result = smooth(run, Constraints(length=Known(20.4, 0.02), start=Known(5.0, 1e-4)), QUIET)
    assert result.scale.value == pytest.approx(1.02, abs=2e-4)
    assert result.scale.std == pytest.approx(0.02 / 20, rel=0.05)
    assert result.positions[[0, 50, 100]] == pytest.approx([5.0, 15.2, 25.4], abs=5e-3)
    assert result.landmarks == ()
    # nothing says what f * R is
    assert result.focal_radius.std > 0.5 * result.focal_radius.value


def test_length_and_sightings_give_the_focal_length_and_the_radius() -> None:
    rng = np.random.default_rng(3)
    x = np.linspace(0, 12, 241)
    run = drive(
        x, x / 0.98, np.array([[c, a] for c, a in zip(np.arange(1.0, 13.0), np.arange(12.0), strict=True)]), 8.0, rng, std=8.0
    )
    result = smooth(run, Constraints(length=Known(12.0, 0.01)), QUIET)
    assert result.focal_radius.value == pytest.approx(FOCAL_RADIUS, abs=4 * result.focal_radius.std)
    assert result.focal_radius.std < 0.02 * FOCAL_RADIUS
    assert result.scale.value == pytest.approx(0.98, abs=4 * result.scale.std + 1e-4)


# ---- slips


def test_a_slip_is_found_where_it_was() -> None:
    x = np.linspace(0, 10, 201)
    counted = x + 0.3 * (x > 6.0)
    run = drive(x, counted, np.array([[3.0, 0.5], [7.0, 1.0], [9.0, 2.0]]), 10.0, None, (2.0, 4.5, 7.0, 9.5), std=10.0)
    result = smooth(run, replace(GIVEN, scale=Known(1.0, 0.001)), Noise(centre_std=0.1, axis_std=0.001))
    assert len(result.slips) == 1
    slip = result.slips[0]
    assert slip.start_s <= np.interp(6.0, x, run.frames.time_s) + 0.2 <= slip.end_s + 0.4
    assert slip.metres == pytest.approx(-0.3, abs=0.06)
    assert slip.chainage == pytest.approx(6.0, abs=0.3)
    assert slip.probability > 0.95
    assert np.abs(result.positions - x).max() < 0.12


def test_where_nothing_is_in_view_a_slip_may_have_happened() -> None:
    counted = np.linspace(0, 10, 201)
    run = drive(counted, counted, np.empty((0, 2)))
    noise = Noise(slip_rate=0.1, slip_std=0.3, drift=1e-4)
    result = smooth(run, Constraints(scale=Known(1.0, 1e-4), start=Known(0.0, 1e-4)), noise)
    # one slip of 0.3 m expected in 10 m (and a little for the seconds): a variance of 0.09 m^2
    assert result.position_std[-1] == pytest.approx(0.3, rel=0.25)
    assert result.positions == pytest.approx(counted, abs=0.05)


def test_a_suspected_slip_widens_the_map_there() -> None:
    counted = np.linspace(0, 4, 81)
    run = drive(counted, counted, np.empty((0, 2)))
    constraints = Constraints(scale=Known(1.0, 1e-4), start=Known(0.0, 1e-4))
    noise = replace(QUIET, slip_rate=1e-4)
    calm = smooth(run, constraints, noise)
    warned = smooth(replace(run, suspected=(8.0,)), constraints, noise)
    assert calm.position_std[-1] < 0.05
    assert warned.position_std[-1] == pytest.approx(0.3 * np.sqrt(0.5), rel=0.2)
    assert warned.position_std[20] < 0.05


def test_the_chain_agrees_with_counting_all_sets_of_slips() -> None:
    rng = np.random.default_rng(5)
    count = 6
    prior = slip_module.SlipPrior(np.full(count, 1e-4), np.full(count, 0.09), np.full(count, 0.1))
    # what the rest of the run says of the increments: two sums and one single, more or less well
    rows = np.array([[1, 1, 1, 0, 0, 0], [0, 0, 0, 1, 1, 1], [0, 1, 0, 0, 0, 0]], dtype=float)
    told, std = np.array([0.3, 0.02, 0.1]), np.array([0.05, 0.05, 0.15])
    information, shift = rows.T @ (rows / std[:, None] ** 2), rows.T @ (told / std**2)

    def given_slips(slipped: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
        variance = prior.variance(slipped)
        covariance = np.linalg.inv(information + np.diag(1 / variance))
        mean = covariance @ shift
        evidence = 0.5 * np.linalg.slogdet(covariance)[1] - 0.5 * np.log(variance).sum() + 0.5 * shift @ mean
        chance = np.log(np.where(slipped, prior.chance, 1 - prior.chance)).sum()
        return mean, covariance, evidence + chance

    sets = [given_slips(np.array(slipped)) for slipped in itertools.product([False, True], repeat=count)]
    weight = np.exp(np.array([one[2] for one in sets]) - max(one[2] for one in sets))
    weight /= weight.sum()
    mean = sum(w * one[0] for w, one in zip(weight, sets, strict=True))
    second = sum(w * (one[1] + np.outer(one[0], one[0])) for w, one in zip(weight, sets, strict=True))
    start = np.zeros(count, bool)
    given = given_slips(start)[0], given_slips(~start)[1]
    slack = slip_module.weigh_all(prior, start, *given, rng)
    assert slack.mean == pytest.approx(mean, abs=0.02)
    assert np.diag(slack.covariance) == pytest.approx(np.diag(second - np.outer(mean, mean)), rel=0.25, abs=2e-4)
    best, _ = slip_module.climb(prior, start, *given)
    assert given_slips(best)[2] > np.log(weight.max()) + max(one[2] for one in sets) - 1.5 + np.log(1 / weight.max())


@pytest.mark.filterwarnings("error")
def test_an_interval_at_rest_that_nothing_was_seen_of_can_be_freed() -> None:
    # its covariance differs from its prior by less than rounding: to free it used to divide by next to nothing
    settings = landmark_smoothing.Settings()
    rng = np.random.default_rng([1034, 0])
    focal_radius = landmark_smoothing.FOCAL_RADIUS * (1 + rng.normal(0, settings.nominal))
    driven = landmark_smoothing.simulate(rng, settings, focal_radius)
    length = Known(settings.length + rng.normal(0, settings.length_std), settings.length_std)
    constraints = Constraints(length=length, start=Known(0.0, 0.01))
    noise = Noise(centre_std=settings.centre_px, axis_std=settings.axis)
    bound = landmark_smoothing.bound_of(driven, settings, NO_RINGS, constraints, noise)
    assert (bound > 0.005).all()
    assert (bound < 0.5).all()


# ---- covariance and robustness


def test_covariance_agrees_with_monte_carlo() -> None:
    landmarks = np.array([[2.0, 0.5], [4.5, -2.0], [6.0, 2.5]])
    x = np.linspace(0, 5.5, 56)
    distances, errors, stds = [], [], []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        scale = 1 + rng.normal(0, 0.02)
        run = drive(x, x / scale, landmarks, 6.0, rng, std=6.0)
        result = smooth(run, replace(GIVEN, scale=Known(1.0, 0.02)), QUIET)
        for mark, truth in zip(result.landmarks, landmarks, strict=True):
            error = np.array([mark.chainage, mark.angle]) - truth
            distances.append(error @ np.linalg.solve(mark.covariance, error))
        errors.append(result.positions[-1] - x[-1])
        stds.append(result.position_std[-1])
    assert np.mean(distances) == pytest.approx(2.0, abs=0.55)
    assert 0.9 <= np.mean(np.array(distances) < 5.991) <= 0.99
    assert np.std(errors) == pytest.approx(np.mean(stds), rel=0.35)


def test_the_roll_of_the_crawler_is_in_every_angle() -> None:
    x = np.linspace(0, 3, 31)
    run = drive(x, x, np.array([[3.5, 0.5]]), std=5.0)
    without, with_roll = (smooth(run, GIVEN, replace(QUIET, roll_std=std)).landmarks[0].covariance for std in (0.0, 0.1))
    assert with_roll - without == pytest.approx(np.diag([0.0, 0.01]), abs=1e-6)


def test_a_burst_of_false_sightings_makes_its_landmark_less_certain() -> None:
    x = np.linspace(0, 8, 161)
    run = drive(x, x, np.array([[4.0, 0.5], [8.5, 2.0]]), 10.0, np.random.default_rng(3), std=10.0)
    pixels = run.sightings.pixels.copy()
    mine = np.flatnonzero(run.sightings.landmark == 0)
    pixels[mine[20:35]] += [25.0, 0.0]
    pixels[mine[50:62]] -= [0.0, 25.0]
    calm = smooth(run, GIVEN, QUIET)
    disturbed = smooth(replace(run, sightings=replace(run.sightings, pixels=pixels)), GIVEN, QUIET)
    assert disturbed.landmarks[0].covariance[1, 1] > 1.5 * calm.landmarks[0].covariance[1, 1]
    assert disturbed.landmarks[1].covariance[1, 1] < 1.5 * calm.landmarks[1].covariance[1, 1]


def test_wrong_sightings_are_weighed_down() -> None:
    rng = np.random.default_rng(2)
    x = np.linspace(0, 4, 81)
    landmarks = np.array([[3.0, 0.5], [4.8, 2.0]])
    run = drive(x, x, landmarks, 5.0, rng, std=5.0)
    wrong = rng.uniform(size=len(run.sightings.landmark)) < 0.2
    pixels = np.where(wrong[:, None], rng.uniform(0, 500, run.sightings.pixels.shape), run.sightings.pixels)
    result = smooth(replace(run, sightings=replace(run.sightings, pixels=pixels)), GIVEN, QUIET)
    for mark, (chainage, angle) in zip(result.landmarks, landmarks, strict=True):
        assert mark.chainage == pytest.approx(chainage, abs=0.05)
        assert mark.angle == pytest.approx(angle, abs=0.05)
        mine = run.sightings.landmark == mark.id
        assert mark.used == pytest.approx(mine.sum() - wrong[mine].sum(), abs=0.1 * mine.sum())


def test_more_scatter_than_claimed_is_noticed() -> None:
    x = np.linspace(0, 4, 81)
    landmarks = np.array([[3.0, 0.5], [4.5, 2.0], [4.8, -1.0]])
    honest = smooth(drive(x, x, landmarks, 12.0, np.random.default_rng(1), std=12.0), GIVEN, QUIET)
    bold = smooth(drive(x, x, landmarks, 12.0, np.random.default_rng(1), std=4.0), GIVEN, QUIET)
    assert honest.noise_ratio == pytest.approx(1.0, abs=0.15)
    assert bold.noise_ratio == pytest.approx(3.0, abs=0.5)
    assert bold.landmarks[1].covariance[0, 0] == pytest.approx(honest.landmarks[1].covariance[0, 0], rel=0.4)


@settings(max_examples=4, deadline=None)
@given(start=st.floats(-50, 50), seed=st.integers(0, 100))
def test_the_start_moves_the_whole_map(start: float, seed: int) -> None:
    x = np.linspace(0, 3, 31)
    run = drive(x, x, np.array([[2.5, 0.5], [3.6, 1.0]]), 5.0, np.random.default_rng(seed), std=5.0)
    here, there = (smooth(run, replace(GIVEN, start=Known(at, 0.01)), QUIET) for at in (0.0, start))
    for one, other in zip(here.landmarks, there.landmarks, strict=True):
        assert other.chainage - one.chainage == pytest.approx(start, abs=5e-3)
        assert other.angle == pytest.approx(one.angle, abs=5e-3)


# ---- little or nothing to go by


def test_no_frame_is_refused() -> None:
    with pytest.raises(ValueError, match="no frame"):
        smooth(drive(np.empty(0), np.empty(0), np.empty((0, 2))))


def test_no_sightings_give_the_tether() -> None:
    counted = np.linspace(0, 5, 51)
    result = smooth(drive(counted, counted, np.empty((0, 2))))
    assert result.positions == pytest.approx(counted, abs=0.05)
    assert (np.diff(result.position_std) > -1e-3).all()
    assert result.position_std[-1] > 0.2


def test_a_standing_crawler_learns_nothing_of_the_scale() -> None:
    still = np.zeros(50)
    result = smooth(drive(still, still, np.array([[1.5, 0.4]]), 5.0, std=5.0), None, Noise())
    assert result.scale.std == pytest.approx(0.05, rel=0.05)
    # without f * R a landmark is somewhere ahead
    assert np.sqrt(result.landmarks[0].covariance[0, 0]) > 0.5


def test_no_counter_at_all_is_very_uncertain() -> None:
    x = np.linspace(0, 3, 31)
    run = drive(x, x, np.array([[3.6, 0.5]]), 5.0, std=5.0)
    run = replace(run, frames=replace(run.frames, encoder=np.full(31, np.nan)))
    result = smooth(run, GIVEN)
    assert np.isfinite(result.positions).all()
    assert result.position_std[-1] > 0.1


def test_a_gap_in_the_counter_is_bridged_by_the_picture() -> None:
    x = np.linspace(0, 5, 101)
    counted = np.where((x > 2) & (x < 3), np.nan, x)
    run = drive(x, counted, np.array([[3.0, 0.5], [4.5, 1.0]]), 5.0, None, (3.2, 4.4, 5.6), std=5.0)
    result = smooth(run, GIVEN, Noise(centre_std=0.5, axis_std=0.005))
    assert np.abs(result.positions - x).max() < 0.1
    assert result.position_std.max() < 0.15


def test_a_picture_that_runs_backwards_is_told_as_slips() -> None:
    # The landmark shrinks while the tether counts on: it is not behind the camera, so the crawler is pulled back.
    x = np.linspace(0, 3, 31)
    run = drive(x, x, np.array([[3.6, 0.5]]), std=5.0)
    backwards = replace(run, sightings=replace(run.sightings, pixels=run.sightings.pixels[::-1].copy()))
    result = smooth(backwards, GIVEN)
    assert sum(slip.metres for slip in result.slips) < -3
    assert np.isfinite(result.landmarks[0].covariance).all()
    assert result.position_std[-1] > 0.1


def test_sightings_at_the_centre_itself_are_survived() -> None:
    x = np.linspace(0, 1, 11)
    run = drive(x, x, np.array([[4.0, 0.5]]))
    run = replace(run, sightings=replace(run.sightings, pixels=np.tile(CENTRE, (len(run.sightings.landmark), 1))))
    result = smooth(run, GIVEN)
    assert np.isfinite(result.landmarks[0].chainage)
    assert np.sqrt(result.landmarks[0].covariance[0, 0]) > 0.3


# ---- knots


@settings(max_examples=30, deadline=None)
@given(steps=st.lists(st.floats(-0.3, 0.5), min_size=1, max_size=60), fps=st.floats(0.5, 30))
def test_knots_cover_every_frame(steps: list[float], fps: float) -> None:
    x = np.cumsum(np.array([0.0, *steps]))
    knots = knots_of(drive(x, x, np.array([[x.max() + 2, 0.3]]), fps=fps))
    assert knots.frame[0] == 0
    assert knots.frame[-1] == len(x) - 1
    assert (np.diff(knots.frame) > 0).all()
    assert ((knots.share >= 0) & (knots.share <= 1 + 1e-9)).all()
    index = np.arange(len(x))
    assert (knots.frame[knots.left] <= index).all()
    assert (knots.frame[knots.right] >= index).all()


# ---- loops and laterals


def there_and_back() -> tuple[np.ndarray, np.ndarray]:
    """Ways of the crawler and its tether, which slips by 0.3 m at the far end."""
    x = np.concatenate([np.linspace(0, 6, 121), np.linspace(6, 0, 121)[1:]])
    return x, x + 0.3 * (np.arange(len(x)) > 110)


def test_driving_back_closes_the_loop_over_a_double() -> None:
    x, counted = there_and_back()
    landmarks = np.array([[2.0, 0.5], [4.5, -2.0]])
    run = drive(x, counted, landmarks, 6.0, np.random.default_rng(4), std=6.0)
    # the mapper takes what comes into view on the way back for something new
    ids = np.where(run.sightings.frame > 120, run.sightings.landmark + 10, run.sightings.landmark)
    run = replace(run, sightings=replace(run.sightings, landmark=ids), labels=dict.fromkeys((0, 1, 10, 11), "connection"))
    noise = Noise(centre_std=0.5, axis_std=0.005)
    alone = smooth(run, GIVEN, noise)
    assert find_doubles(run, alone) in ({10: 0, 11: 1}, {0: 10, 1: 11}, {10: 0, 1: 11}, {0: 10, 11: 1})
    result, same = smooth_survey(run, GIVEN, noise)
    assert len(result.landmarks) == 2
    assert len(same) == 2
    assert result.position_std[-1] < alone.position_std[-1]
    assert result.positions[-1] == pytest.approx(0.0, abs=3 * result.position_std[-1])
    for mark, truth in zip(sorted(result.landmarks, key=lambda mark: mark.chainage), landmarks, strict=True):
        assert mark.chainage == pytest.approx(truth[0], abs=0.1)


def test_two_seen_at_once_or_of_other_class_are_no_doubles() -> None:
    x = np.linspace(0, 2, 41)
    twins = np.array([[2.60, 0.50], [2.62, 0.52]])
    run = replace(drive(x, x, twins, 6.0, std=6.0), labels={0: "connection", 1: "connection"})
    assert find_doubles(run, smooth(run, GIVEN)) == {}
    # the same two, each seen in every other frame
    even = run.sightings.frame % 2 == run.sightings.landmark
    half = Sightings(*(getattr(run.sightings, name)[even] for name in ("landmark", "frame", "pixels", "std")))
    apart = replace(run, sightings=half)
    smoothed = smooth(apart, GIVEN)
    assert len(find_doubles(apart, smoothed)) == 1
    assert find_doubles(replace(apart, labels={0: "connection", 1: "roots"}), smoothed) == {}


def test_merging_nothing_changes_nothing() -> None:
    run = drive(np.zeros(3), np.zeros(3), np.array([[1.0, 0.0]]))
    assert merged(run, {}) is run
    assert set(merged(run, {0: 7}).sightings.landmark) == {7}


def test_a_known_lateral_holds_the_map() -> None:
    x = np.linspace(0, 10, 201)
    run = drive(x, x / 1.04, np.array([[4.0, 0.5], [9.0, 1.0]]), 6.0, np.random.default_rng(6), std=6.0)
    run = replace(run, labels={0: "roots", 1: "connection"})
    free, _ = smooth_survey(run, Constraints(), QUIET)
    laterals = (Lateral(9.0, 0.02, label="connection"), Lateral(30.0, 0.02, label="connection"))
    held, _ = smooth_survey(run, Constraints(laterals=laterals), QUIET)
    assert held.landmarks[1].chainage == pytest.approx(9.0, abs=0.06)
    assert held.landmarks[0].covariance[0, 0] < 0.5 * free.landmarks[0].covariance[0, 0]
    assert held.landmarks[0].chainage == pytest.approx(4.0, abs=4 * np.sqrt(held.landmarks[0].covariance[0, 0]))
    assert held.scale.value == pytest.approx(1.04, abs=0.01)


def test_laterals_are_found_by_class_and_place_once_each() -> None:
    x = np.linspace(0, 6, 121)
    run = drive(x, x, np.array([[3.0, 0.5], [3.4, 2.0], [5.5, 1.0]]), 5.0, std=5.0)
    run = replace(run, labels={0: "connection", 1: "connection", 2: "roots"})
    smoothed = smooth(run, replace(GIVEN, scale=Known(1.0, 0.001)), QUIET)
    asked = (
        Lateral(3.38, 0.05, label="connection"),
        Lateral(3.02, 0.05, label="connection"),
        Lateral(5.5, 0.05, label="connection"),
    )
    found = identified(asked, run, smoothed)
    assert [(one.landmark, one.chainage) for one in found] == [(1, 3.38), (0, 3.02)]
    by_hand = identified((Lateral(3.0, 0.1, landmark=0), asked[1]), run, smoothed)
    assert [one.landmark for one in by_hand] == [0]


# ---- from the mapper and back


def survey_landmark(number: int, chainage: float, extent: float, views: list[View], camera: PipeCamera) -> Landmark:
    sightings = []
    for k, view in enumerate(views):
        u, v = project(camera, view, np.array([[chainage, 0.5]]))[0]
        sightings.append(Sighting(number, 10 + k, k / 5, view, float(u), float(v), "deposit", 0.9))
    return Landmark(
        number, "deposit", "confirmed", chainage, 0.5, np.eye(2) * 0.01, chainage - extent / 2, chainage + extent / 2,
        0.4, 0.6, {"deposit": 1.0}, len(views), 0, 10, 10 + len(views), Evidence(10, 1.0, 1.0, 1.0), tuple(sightings),
    )  # fmt: skip


def test_from_the_mapper_and_back() -> None:
    camera = PipeCamera(400.0, 420.0, 0.3, 720, 576)
    views = [View(position, (360.0, 288.0), (0.03, 0.0)) for position in np.linspace(0, 2, 21)]
    seen = [Observation(10 + k, k / 5, view, (Detection(1.0, 1.0, "deposit"),)) for k, view in enumerate(views)]
    landmarks = [survey_landmark(4, 2.6, 0.0, views, camera), survey_landmark(9, 2.8, 1.0, views, camera)]
    run = run_of(seen, landmarks, camera, pixel_std=5.0)
    assert run.aspect == pytest.approx(1.05)
    assert run.frames.axis[0] == pytest.approx([0.1, 0.0])
    assert run.labels == {4: "deposit", 9: "deposit"}
    assert run.rings is NO_RINGS
    assert set(run.sightings.frame) == set(range(21))
    point = run.sightings.landmark == 4
    assert run.sightings.std[point] == pytest.approx(5.0)
    # at 0.8 m a metre of deposit is worth 120 / 0.64 / sqrt(12) px
    assert run.sightings.std[~point][-1] == pytest.approx(np.hypot(5.0, 120 / 0.64 / np.sqrt(12)))
    result = smooth(run, Constraints(focal_radius=Known(120.0, 0.1)), QUIET)
    late = [replace(mark, chainage=mark.chainage + 0.2, chainage_from=mark.chainage_from + 0.2) for mark in landmarks]
    back = moved(late, result)
    assert [mark.id for mark in back] == [4, 9]
    assert back[0].chainage == pytest.approx(2.6, abs=0.02)
    assert back[1].chainage_from == pytest.approx(2.3, abs=0.1)
    assert back[0].covariance is result.landmarks[0].covariance


def test_a_landmark_without_sightings_is_left_out() -> None:
    camera = PipeCamera(400.0, 400.0, 0.3, 720, 576)
    seen = [Observation(0, 0.0, View(0.0, (360.0, 288.0)), ())]
    unseen = survey_landmark(1, 2.0, 0.0, [], camera)
    run = run_of(seen, [unseen], camera)
    assert moved([unseen], smooth(run)) == []


def test_a_long_thing_is_no_surer_than_the_way_of_the_frames_that_saw_it() -> None:
    camera = PipeCamera(400.0, 400.0, 0.3, 720, 576)
    views = [View(position, (360.0, 288.0)) for position in np.linspace(0, 12, 121)]
    seen = [Observation(10 + k, k / 5, view, (Detection(1.0, 1.0, "deposit"),)) for k, view in enumerate(views)]
    near, far = survey_landmark(1, 2.6, 0.0, views[:21], camera), survey_landmark(2, 13.0, 1.0, views[90:], camera)
    far = replace(far, sightings=tuple(replace(one, time_s=one.time_s + 18.0) for one in far.sightings))
    found = smooth_drive(seen, [near, far], [], camera, 5.0, Known(120.0, 1.2))
    assert found is not None
    sigmas = {landmark.id: np.sqrt(landmark.covariance[0, 0]) for landmark in found.landmarks}
    assert sigmas[2] > np.hypot(0.1, 0.02 * 10), "ten metres by a tether that is good for two per cent"
    assert sigmas[1] < 0.15
