"""The anomaly survey's estimators on virtual pairs whose truth is known, and the parts by hand."""

from __future__ import annotations

import contextlib
from dataclasses import replace
from functools import cache

import cv2
import numpy as np
import pytest

from device.anomaly.result import clock, inspect, result_of, smooth_stretches
from drivers.virtual.landmarks import Patch
from drivers.virtual.profile import circular
from drivers.virtual.rig import Pose
from drivers.virtual.stereo_camera import StereoLens, StereoLook, StereoPainter, VirtualStereoCamera
from drivers.virtual.world import Joint, VirtualSewer
from estimators.anomaly.deviation import DeviationMap, what_closes
from estimators.anomaly.joints import find_joints, ring_cells
from estimators.anomaly.pair import PairFindings, inspect_pair, misread
from estimators.anomaly.regions import anomalous_share, find_regions
from estimators.anomaly.rows import row_medians
from estimators.anomaly.score import band_scores, plain_score, score, sure_score
from estimators.pinhole import Intrinsics
from estimators.stereo.follow import Refused
from estimators.stereo.on_wall import OCCLUDED, SMOOTH, TRUSTED, EvenPair, RowMisfit, WallMatch, even_pair, gain_over
from estimators.stereo.rig import StereoRig
from estimators.stereo.unrolled import Unrolled

DIAMETER = 0.4
ANGLES, ROWS = 180, 100


def flat(deviation_m: float = 0.0) -> DeviationMap:
    """A map of 1 m of a pipe of 200 mm radius, everywhere measured."""
    shape = ROWS, ANGLES
    theta = (np.arange(ANGLES) + 0.5) * (2 * np.pi / ANGLES) - np.pi
    depth = 1.0 + (np.arange(ROWS) + 0.5) / ROWS
    area = np.full(shape, 0.2 * 2 * np.pi / ANGLES / ROWS, np.float32)
    everywhere = np.ones(shape, bool)
    return DeviationMap(
        theta,
        depth,
        np.full(shape, deviation_m, np.float32),
        np.full(shape, 0.0003, np.float32),
        everywhere,
        ~everywhere,
        area,
        np.full(shape, 0.2, np.float32),
        np.full(shape, 0.3, np.float32),
        np.full(shape, 2e-4, np.float32),
    )


def test_the_score_is_the_mean_of_what_lies_inwards() -> None:
    found = flat()
    found.deviation[:50] = -0.004
    found.deviation[50:75] = 0.008
    assert plain_score(found) == (pytest.approx(0.002), pytest.approx(0.002))
    # edges are soft to what noise may explain
    assert score(found) == (pytest.approx(0.002), pytest.approx(0.002, rel=0.03), pytest.approx(1.0))
    left_out = np.zeros(found.deviation.shape, bool)
    left_out[:50] = True
    assert score(found, left_out) == (0.0, pytest.approx(0.004), pytest.approx(0.5))


def test_noise_is_in_the_plain_score_alone() -> None:
    found = flat()
    found.deviation[:] = np.random.default_rng(2).normal(0, 0.001, found.deviation.shape)
    found.sigma[:] = 0.001
    assert sure_score(found) == (pytest.approx(0.0, abs=2e-6), pytest.approx(0.0, abs=2e-6))
    assert plain_score(found) == (pytest.approx(0.0004, rel=0.02), pytest.approx(0.0004, rel=0.02))  # sigma / sqrt(2 pi)
    found.deviation[40:60, 40:60] -= 0.01
    share = 400 / found.deviation.size
    assert sure_score(found)[0] == pytest.approx(0.01 * share, rel=0.1)


def test_lost_wall_counts_where_the_pictures_speak_for_it_and_large_windows_tell_of_none() -> None:
    found = flat()
    found.deviation[40:60, 40:60] = 0.008
    found.gain[:] = 0.02  # patches agree as well on the wall: a smooth one, misread
    assert score(found)[1:] == (0.0, pytest.approx(1.0))
    found.gain[40:60, 40:60] = 0.3
    outward = score(found)[1]
    assert outward == pytest.approx(0.008 * 400 / found.deviation.size, rel=0.05)
    found.patch[70:] = 0.05 * 0.2**2  # nothing is said of these
    assert score(found)[1:] == (pytest.approx(outward / 0.7), pytest.approx(0.7))
    bands = band_scores(found, 0.25)
    assert bands[1].outward > 0
    assert np.isnan(bands[3].outward)
    assert bands[3].inward == 0.0
    found.patch[:] = 0.05 * 0.2**2
    outward, told = score(found)[1:]  # of what is lost and its soft edges alone
    assert outward * told == pytest.approx(0.008 * 400 / found.deviation.size, rel=0.05)
    assert 400 / found.deviation.size <= told < 0.06


def test_what_closes_the_pipe_is_no_deposit_and_a_deposit_before_it_is_one() -> None:
    deviation = np.zeros((240, 540), np.float32)
    inside = np.ones(deviation.shape, bool)
    inside[220:] = False
    deviation[210:220, 50:90] = -0.03  # reaches the far end, and is short
    deviation[120:220, 200:240] = -0.03  # a long deposit that reaches it, too
    deviation[100:120, 300:340] = -0.03
    deviation[210:220, 240:260] = -0.03  # and what belongs to it
    closing = what_closes(deviation, inside, np.arange(240.0), 0.003)
    assert closing[210:220, 50:90].all()
    assert closing.sum() == 400
    cut = what_closes(np.roll(deviation, -240, axis=1), inside, np.arange(240.0), 0.003)
    np.testing.assert_array_equal(cut, np.roll(closing, -240, axis=1))


def test_wall_that_is_lost_on_both_sides_of_the_cut_is_one_part() -> None:
    found = flat()
    found.deviation[40:60, 80:100] = 0.008
    found.patch[:] = 0.05  # more than half of it, and not half of either half
    whole = score(found)
    assert whole[1] == pytest.approx(0.008 * 400 / (22 * 24), rel=0.02)  # with its soft edges
    assert score(replace(found, deviation=np.roll(found.deviation, 90, axis=1))) == pytest.approx(whole)


def test_bands_score_their_own_part_and_say_nothing_of_what_was_not_measured() -> None:
    found = flat()
    found.deviation[:25] = -0.004
    found.deviation[75:] = np.nan
    bands = band_scores(found, 0.25)
    assert [round(band.first, 3) for band in bands] == [1.0, 1.25, 1.5, 1.75]
    assert bands[0].inward == pytest.approx(0.004)
    assert bands[1].inward == 0.0
    assert np.isnan(bands[3].inward)


def test_a_band_says_what_may_go_unseen_in_it_and_smooth_ones_are_told_as_one_stretch() -> None:
    found = flat()
    found.patch[50:] = 6e-3
    found.deviation[95:] = np.nan
    bands = band_scores(found, 0.25)
    assert [band.sees for band in bands] == pytest.approx([1e-4, 1e-4, 3e-3, 3e-3])
    assert smooth_stretches(bands) == [{"from_m": 1.5, "to_m": 2.0, "sees_mm2": 3000}]
    found.deviation[50:] = np.nan
    assert smooth_stretches(band_scores(found, 0.25)) == []  # nothing was measured: nothing is said to be sound


def test_a_region_has_its_area_place_and_sign_across_the_seam() -> None:
    found = flat()
    found.deviation[40:60, :20] = -0.02
    found.deviation[40:60, -20:] = -0.02
    (region,) = find_regions(found, [])
    assert region.peak == pytest.approx(-0.02, rel=0.05)
    assert region.area == pytest.approx(20 * 40 * float(found.area[0, 0]), rel=0.3)  # soft edges of the smoothing
    assert abs(region.theta) == pytest.approx(np.pi, abs=0.05)  # nine o'clock, where the map is cut open
    assert region.kind == "intrusion"
    assert anomalous_share(found, [region]) == pytest.approx(region.area / float(found.area.sum()), rel=1e-3)


@pytest.mark.parametrize(
    ("theta", "sign", "kind"), [(np.pi / 2, -1, "deposit"), (-np.pi / 2, -1, "intrusion"), (0.5, 1, "loss")]
)
def test_kinds_that_are_plain(theta: float, sign: int, kind: str) -> None:
    found = flat()
    column = int((theta + np.pi) / (2 * np.pi) * ANGLES)
    found.deviation[40:60, column - 8 : column + 8] = sign * 0.012
    (region,) = find_regions(found, [])
    assert (region.kind, region.expected) == (kind, False)


def test_what_hides_more_wall_than_it_covers_stands_free() -> None:
    found = flat()
    found.deviation[40:46, 130:140] = -0.05
    found.deviation[46:70, 130:140] = np.nan
    found.hidden[46:70, 130:140] = True
    (region,) = find_regions(found, [])
    assert region.kind == "object"


def test_no_region_without_patches_that_agree_better_off_the_wall() -> None:
    found = flat()
    found.deviation[40:60, 20:60] = -0.02
    found.gain[:] = 0.0
    assert find_regions(found, []) == []


def test_a_region_fills_the_windows_that_tell_it_or_is_one_patchs_error() -> None:
    found = flat()
    found.deviation[40:50, 20:30] = 0.01
    (region,) = find_regions(found, [])
    found.patch[:] = 3 * region.area
    assert find_regions(found, []) == []
    found.patch[:] = 2 * region.area
    found.gain[:] = 0.12
    assert len(find_regions(found, [])) == 1
    found.gain[:] = 0.1  # of a whole window that would do
    assert find_regions(found, []) == []
    found.patch[:] = region.area
    assert len(find_regions(found, [])) == 1


def test_medians_along_rows_leave_out_what_was_not_measured() -> None:
    nan = np.nan
    values = np.array([[3.0, nan, 1.0, 2.0], [nan, 4.0, 8.0, nan], [nan, nan, nan, nan], [5.0, 6.0, 7.0, 9.0]])
    np.testing.assert_equal(row_medians(values), [2.0, 6.0, nan, 6.5])


def test_what_is_within_the_noise_is_no_region() -> None:
    found = flat()
    rng = np.random.default_rng(1)
    found.deviation[:] = rng.normal(0, 0.002, found.deviation.shape)
    found.sigma[:] = 0.002
    assert find_regions(found, []) == []


def test_what_lies_off_the_wall_to_both_sides_was_misread_and_a_silted_pipe_was_not() -> None:
    assert misread(0.87, (0.00096, 0.00109), 0.15)  # a wall that was lost over a sixth of the way around
    assert not misread(0.7, (0.006, 0.0001), 0.15)  # much deposit
    assert not misread(0.97, (0.0005, 0.0004), 0.15)  # deposits and holes, on a wall that most follows


def test_a_joint_is_an_expected_ring_with_gap_and_displacement() -> None:
    found = flat()
    found.deviation[50:53] = 0.008
    found.deviation[53:] += (0.006 * np.cos(found.theta - np.pi / 2)).astype(np.float32)
    (joint,) = find_joints(found)
    assert joint.gap == pytest.approx(0.03)
    assert joint.offset == pytest.approx(0.006, rel=0.1)
    assert joint.offset_theta == pytest.approx(np.pi / 2, abs=0.05)
    assert ring_cells(found, [joint])[51].all()
    assert all(region.expected for region in find_regions(found, [joint]) if joint.first < region.depth < joint.last)


@cache
def looked(height: float, grain: float = 0.25, joint: bool = False, offset: float = 0.0, told: bool = True) -> PairFindings:
    things = (Patch(2.75, 2.9, 2.0, 0.3, height),) if height else ()
    joints = (Joint(2.8, 0.02, 0.012),) if joint else ()
    sewer = VirtualSewer(circular(DIAMETER), 4.0, joints=joints, things=things)
    lens = StereoLens(offset_px=offset)
    left, right = StereoPainter(sewer, lens, StereoLook(grain=grain), 1).pair(
        Pose(0.01, -0.02, 2.0, 0.02, -0.01), np.random.default_rng(1)
    )
    rig = StereoRig(lens.intrinsics, lens.baseline_m, offset if told else None)
    return inspect_pair(left, right, rig, np.random.default_rng(1))


def test_a_clean_pipe_has_its_diameter_and_no_anomaly() -> None:
    found = looked(0.0)
    assert found.shape.width is not None
    assert found.shape.width.value == pytest.approx(DIAMETER, rel=0.01)
    assert found.regions == []
    assert found.inward < 0.001
    assert found.followed.coverage > 0.8


def test_a_deposit_is_found_where_it_is_as_high_as_it_is() -> None:
    found = looked(0.03)
    region = found.regions[0]
    assert region.peak == pytest.approx(-0.03, rel=0.25)
    assert region.depth == pytest.approx(0.82, abs=0.05)  # its middle, from the camera
    assert abs(region.theta - 2.0) < 0.15
    # 15 cm by 12 cm at half its height on average, spread over 1.4 m2 of wall
    assert found.inward - looked(0.0).inward == pytest.approx(0.0002, abs=0.0001)


def test_lost_wall_is_found_outwards() -> None:
    found = looked(-0.02)
    assert found.regions[0].kind == "loss"
    assert found.outward - looked(0.0).outward == pytest.approx(0.00012, abs=0.00007)


def test_a_pipe_without_texture_is_refused_or_without_anomaly() -> None:
    with contextlib.suppress(Refused):
        found = looked(0.0, grain=0.01)
        assert found.regions == []
        assert found.followed.coverage < looked(0.0).followed.coverage


def test_a_pair_finds_its_own_offset() -> None:
    found = looked(0.0, offset=12.0, told=False)
    assert found.own_offset
    assert found.offset_px == pytest.approx(12.0, abs=1.5)
    assert found.shape.width is not None
    assert found.shape.width.interval[0] <= DIAMETER <= found.shape.width.interval[1]


def test_a_pair_that_does_not_know_its_scale_tells_no_width_but_by_how_much_its_lengths_may_be_wrong() -> None:
    found = looked(0.03)
    followed = found.followed
    assert result_of(found)["reason"] == ""
    assert result_of(found)["width_mm"] is not None
    shift = followed.wall.rig.range_px_m / found.shape.depth
    vague = replace(followed.wall.rig, offset_std_px=0.1 * shift)  # a tenth of the shift: lengths within 19.6 %
    result = result_of(replace(found, followed=replace(followed, wall=replace(followed.wall, rig=vague))))
    assert result["reason"] == "scale_unsure"
    assert result["width_mm"] is None
    assert result["lengths_within_percent"] == pytest.approx(19.6, abs=0.1)
    assert "20 %" in result["message"]


def test_the_unrolled_wall_has_rows_by_log_depth_and_cells_of_one_shape() -> None:
    grid = looked(0.03).followed.grid
    assert np.allclose(np.diff(np.log(grid.depth)), grid.cell[0])
    assert grid.row_of(grid.depth) == pytest.approx(np.arange(len(grid.depth)), abs=1e-6)
    assert grid.row_of(np.sqrt(grid.depth[:-1] * grid.depth[1:])) == pytest.approx(np.arange(len(grid.depth) - 1) + 0.5)
    assert (grid.row_of(np.array([-1.0, 0.0])) < 0).all()


def test_nothing_is_seen_in_a_margin() -> None:
    grid = looked(0.03).followed.grid
    picture = np.full((600, 960), 90, np.uint8)
    margin = picture.copy()
    margin[580:] = 0
    seen = even_pair(margin, picture).shown(grid).seen
    np.testing.assert_array_equal(seen, grid.seen & (grid.y < 579))
    assert seen.sum() < grid.seen.sum()


def test_hidden_and_smooth_are_told_apart() -> None:
    state = looked(0.03).followed.match.state
    assert (state == TRUSTED).mean() > 0.3
    smooth = looked(0.0, grain=0.03).followed.match.state
    assert (smooth == SMOOTH).sum() > (state == SMOOTH).sum()
    assert (smooth == OCCLUDED).sum() < (smooth == SMOOTH).sum()


def test_a_wall_with_less_texture_is_told_more_by_large_patches_alone() -> None:
    fine, coarse = looked(0.03).followed, looked(0.0, grain=0.03).followed
    assert 0.0 <= fine.rough < coarse.rough <= coarse.coverage


def test_what_large_patches_say_for_a_shift_is_not_drowned_by_noise() -> None:
    """A strip of a wall as textured as its pictures are noisy: patches of them alike by less than a half."""
    rng = np.random.default_rng(2)
    texture = cv2.GaussianBlur(rng.normal(size=(44, 1200)).astype(np.float32), (0, 0), 3)
    left, right = (texture / texture.std() + rng.normal(size=texture.shape).astype(np.float32) for _ in range(2))
    pair = EvenPair(left, right, left, left, 1.0, (slice(None), slice(None)))
    y, x = np.mgrid[2:42, 60:1140].astype(np.float32)
    zero = np.zeros_like(x)
    grid = Unrolled(np.linspace(-3, 3, 1080), np.linspace(1, 2, 40), x, y, zero, zero, zero, zero == 0)

    def gain(window: int, other: float) -> float:
        match = WallMatch(
            zero, zero, zero + np.float32(0.4), np.full(zero.shape, window, np.uint8), np.full(zero.shape, TRUSTED, np.uint8)
        )
        return float(gain_over(zero + np.float32(other), pair, grid, match, RowMisfit(), 1200, 44).mean())

    assert gain(1, 0.0) == pytest.approx(0.0, abs=0.05)  # as the match says
    assert gain(1, 20.0) == pytest.approx(0.4, abs=0.08)
    assert gain(2, 20.0) > 0.75
    assert gain(2, 0.0) == 0.0


def test_two_pictures_of_nothing_are_refused_with_a_sentence() -> None:
    camera = Intrinsics(480, 300, 500.0, 500.0, 239.5, 149.5)
    noise = np.random.default_rng(0).integers(0, 255, (2, 300, 480), dtype=np.uint8)
    result, findings = inspect(noise[0], noise[1], StereoRig(camera, 0.06))
    assert findings is None
    assert result["fitted"] is False
    assert result["width_mm"] is None
    assert result["regions"] == []
    assert result["message"].endswith(".")


@pytest.mark.parametrize(("theta", "hour"), [(-np.pi / 2, 12.0), (0.0, 3.0), (np.pi / 2, 6.0), (np.pi, 9.0), (-np.pi, 9.0)])
def test_clock_hours(theta: float, hour: float) -> None:
    assert clock(theta) == hour


def test_the_virtual_camera_drives_on() -> None:
    lens = StereoLens(Intrinsics(240, 150, 140.0, 140.0, 119.5, 74.5))
    camera = VirtualStereoCamera(StereoPainter(VirtualSewer(circular(0.3), 4.0), lens, StereoLook(), 1))
    camera.open()
    first, second = camera.read(), camera.read()
    camera.close()
    assert (first.number, second.number) == (1, 2)
    assert first.left.shape == (150, 240)
    assert not np.array_equal(first.left, second.left)
    assert camera.pose(1).chainage > camera.pose(0).chainage


def test_the_black_margin_of_one_picture_is_no_texture_in_either() -> None:
    """As if both had been cut there: the margin's edge has no partner."""
    rng = np.random.default_rng(4)
    left, right = rng.integers(20, 200, (2, 60, 80), np.uint8)
    cut = even_pair(left[:50], right[:50])
    left[50:], right[50:, 3] = 0, 255
    whole = even_pair(left, right)
    assert whole.part == (slice(0, 49), slice(0, 80))  # the row beside it may be half margin
    assert not whole.left[49:].any()
    assert not whole.right[49:].any()
    np.testing.assert_allclose(whole.right[:25], cut.right[:25], atol=1e-5)
    assert even_pair(np.zeros_like(left), right).part == (slice(0, 60), slice(0, 80))  # a dark picture has no margin
    hot = np.zeros_like(left)
    hot[20, 30] = 255
    assert even_pair(hot, hot).part == (slice(0, 60), slice(0, 80))  # nor has one with a hot pixel
