"""What the virtual cameras do beyond the contract (test_depth_virtual.py): their pictures, their faults, the demo's box."""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from drivers.base import BadFrame, FrameTimeout, SensorLost, SensorMissing
from drivers.depth.base import STEREO_SCALE_STD, TIME_OF_FLIGHT_SCALE_STD, DepthSettings
from drivers.depth.librealsense import LibrealsenseCamera
from drivers.registry import open_depth_cameras
from drivers.virtual import world
from drivers.virtual.cameras import STEREO_SERIAL, TIME_OF_FLIGHT_SERIAL, virtual_bus
from drivers.virtual.demo import DemoRig, Description, DescriptionBroken, read_description
from drivers.virtual.depth_camera import STEREO_LENSES, TIME_OF_FLIGHT_LENSES, VirtualBus
from drivers.virtual.faults import CURES, FAULTS, Fault, FaultScript
from drivers.virtual.rig import Pose
from estimators.pinhole import Intrinsics, rays
from tests.unit.drivers.depth_camera_contract import READ_S, LiveRig
from tests.unit.drivers.sensor_contract import TwinPlug

STEREO = DepthSettings(640, 480, 30, serial=STEREO_SERIAL)
TIME_OF_FLIGHT = DepthSettings(224, 172, 10, color=False, serial=TIME_OF_FLIGHT_SERIAL)


class TwinRig(TwinPlug, LiveRig):
    """A virtual camera, and the hand that pulls its cable."""

    def __init__(self, settings: DepthSettings, description: Description | None = None) -> None:
        self.bus = virtual_bus(description or Description())
        self.twin = next(camera for camera in self.bus.cameras if camera.serial == settings.serial)
        self.intrinsics = next(lens for lens in self.twin.lenses if lens.size == (settings.width, settings.height))
        self.camera = LibrealsenseCamera(self.bus, settings)

    def close(self) -> None:
        self.twin.faults.end()
        self.camera.close()


@pytest.fixture
def rig() -> Iterator[TwinRig]:
    made = TwinRig(STEREO)
    yield made
    made.close()


def read_on(rig: TwinRig, timeout_s: float) -> None:
    for _ in range(40):
        rig.camera.read(timeout_s)


# --- as a camera ---


@pytest.mark.parametrize("lens", STEREO_LENSES, ids=lambda lens: str(lens.width))
def test_depth_and_colour_come_in_both_sizes(lens: Intrinsics) -> None:
    width, height = lens.size
    rig = TwinRig(DepthSettings(width, height, 30, serial=STEREO_SERIAL))
    rig.camera.open()
    frame = rig.camera.read(READ_S)
    assert frame.color is not None
    assert frame.color.shape == (height, width, 3)
    assert frame.color.std() > 10
    assert (rig.camera.name, rig.camera.notice) == ("virtual stereo camera", "")
    rig.close()


def test_a_size_the_camera_has_not_is_replaced_and_told() -> None:
    bus = virtual_bus(Description())
    camera = LibrealsenseCamera(bus, DepthSettings(1280, 720, serial=STEREO_SERIAL))
    camera.open()
    assert camera.read(READ_S).intrinsics.size == (640, 480)
    assert "640 x 480" in camera.notice
    camera.close()


def test_pictures_are_paced_and_numbered_as_the_clock_runs(rig: TwinRig) -> None:
    rig.camera.open()
    first = rig.camera.read(READ_S)
    begun = time.monotonic()
    time.sleep(0.5)
    late = rig.camera.read(READ_S)
    elapsed = time.monotonic() - begun
    assert 14 <= late.number - first.number <= elapsed * 30 + 2, "a reader that comes late has missed pictures"
    numbers = [rig.camera.read(READ_S).number for _ in range(6)]
    assert all(b > a for a, b in pairwise(numbers))


def test_it_never_runs_ahead_of_its_rate() -> None:
    rig = TwinRig(TIME_OF_FLIGHT)
    rig.camera.open()
    rig.camera.read(READ_S)
    begun = time.monotonic()
    for _ in range(5):
        rig.camera.read(READ_S)
    assert time.monotonic() - begun > 0.39
    rig.close()


def test_it_measures_the_pipe_it_is_told_to_look_into() -> None:
    still = Description(diameter_mm=400, water_mm=0, tilt_deg=0, hand="none", position="middle", joint_every_m=0)
    rig = TwinRig(STEREO, still)
    rig.camera.open()
    frame = rig.camera.read(READ_S)
    rig.close()
    lens = frame.intrinsics
    # straight down from the eye the wall lies at Y = radius: 60 rows from the lowest, its depth is f r / (v - cy)
    row, column = 420, round(lens.ppx)
    seen = frame.depth[row - 3 : row + 4, column - 20 : column + 20]
    expected_m = 0.2 * lens.fy / (row - lens.ppy)
    assert np.median(seen[seen > 0]) / 1000 == pytest.approx(expected_m, rel=0.02)


def test_the_two_cameras_of_a_box_look_into_the_same_pipe_from_one_place() -> None:
    bus = virtual_bus(Description())
    stereo, time_of_flight = bus.cameras
    assert stereo.sewer is time_of_flight.sewer
    assert stereo.rig is time_of_flight.rig


def test_the_registry_opens_one_or_both() -> None:
    assert len(open_depth_cameras("virtual", seed=5)) == 1
    both = open_depth_cameras("virtual", seed=5, cameras=2)
    for camera, size in zip(both, ((848, 480), TIME_OF_FLIGHT_LENSES[0].size), strict=True):
        camera.open()
        assert camera.read(READ_S).intrinsics.size == size
        camera.close()


def test_the_picture_moves_with_the_box() -> None:
    bus = virtual_bus(Description(hand="none", joint_every_m=0))
    twin = bus.cameras[0]
    lens = twin.lenses[1]
    grid = rays(lens)[::4, ::4]
    assert twin.painter is not None
    painted = []
    for pose in (Pose(chainage=0.1), Pose(chainage=0.1), Pose(chainage=0.15)):
        hits = twin.sewer.cast(pose.position, pose.rotation, grid)
        painted.append(twin.painter.picture(hits, pose, grid, lens.size).astype(int))
    again, moved = (float(np.abs(painted[0][:200] - other[:200]).mean()) for other in painted[1:])
    assert moved > 3 * again


# --- the pyrealsense2 surface beyond what the driver uses ---


def test_the_surface_answers_like_pyrealsense2() -> None:
    rs = virtual_bus(Description())
    pipeline, config = rs.pipeline(), rs.config()
    with pytest.raises(RuntimeError, match=r"cannot be called before start\(\)"):
        pipeline.wait_for_frames(10)
    config.enable_device(STEREO_SERIAL)
    config.enable_stream(rs.stream.depth, 848, 480, rs.format.z16, 30)
    config.enable_stream(rs.stream.color, 848, 480, rs.format.rgb8, 30)
    profile = pipeline.start(config)
    with pytest.raises(RuntimeError, match="start"):
        pipeline.start(config)
    frames = rs.align(rs.stream.color).process(pipeline.wait_for_frames(5000))
    depth, color = frames.get_depth_frame(), frames.get_color_frame()
    assert depth is not None
    assert color is not None
    x, y = 600, 300
    assert depth.get_distance(x, y) == pytest.approx(depth.get_data()[y, x] * 0.001)
    assert depth.get_timestamp() > 0
    assert profile.get_stream(rs.stream.color).format() is rs.format.rgb8
    sensor = profile.get_device().first_depth_sensor()
    sensor.set_option(rs.option.laser_power, 30)
    assert sensor.get_option(rs.option.laser_power) == 30
    with pytest.raises(RuntimeError, match="out of range"):
        sensor.set_option(rs.option.laser_power, 1000)
    with pytest.raises(RuntimeError, match="doesn't support"):
        sensor.get_option(rs.option.gain)
    pipeline.stop()
    config.enable_stream(rs.stream.depth, 100, 100, rs.format.z16, 30)
    with pytest.raises(RuntimeError, match="Couldn't resolve requests"):
        pipeline.start(config)


def test_without_a_camera_there_is_none() -> None:
    rs = VirtualBus([])
    assert rs.context().query_devices() == []
    with pytest.raises(RuntimeError, match="No device connected"):
        rs.pipeline().start()
    with pytest.raises(SensorMissing):
        LibrealsenseCamera(rs, DepthSettings()).open()


# --- faults ---


def test_a_frozen_camera_counts_on_with_the_old_picture(rig: TwinRig) -> None:
    rig.camera.open()
    rig.twin.faults.trigger("freeze")
    rig.camera.read(READ_S)
    frozen = [rig.camera.read(READ_S) for _ in range(3)]
    assert all(np.array_equal(a.depth, b.depth) and b.number > a.number for a, b in pairwise(frozen))
    rig.twin.faults.end("freeze")
    assert not np.array_equal(rig.camera.read(READ_S).depth, frozen[0].depth)


def test_half_a_picture_is_refused_and_the_next_whole_one_is_not(rig: TwinRig) -> None:
    rig.camera.open()
    rig.twin.faults.trigger("wrong size")
    with pytest.raises(BadFrame, match=r"240, 640.*expected \(480, 640\)"):
        rig.camera.read(READ_S)
    rig.twin.faults.end()
    assert rig.camera.read(READ_S).depth.any()


def test_blackouts_are_what_they_say(rig: TwinRig) -> None:
    rig.camera.open()
    rig.twin.faults.trigger("partial blackout")
    depth = rig.camera.read(READ_S).depth
    assert not depth[:, :400].any()
    assert depth[:, 430:].any()
    rig.twin.faults.trigger("all zero")
    assert not rig.camera.read(READ_S).depth.any()


def test_garbage_is_noise_without_a_pipe_in_it(rig: TwinRig) -> None:
    rig.camera.open()
    rig.twin.faults.trigger("garbage")
    depth = rig.camera.read(READ_S).depth.astype(float)
    assert abs(np.corrcoef(depth[:, :-1].ravel(), depth[:, 1:].ravel())[0, 1]) < 0.05


def test_a_slow_camera_skips_numbers(rig: TwinRig) -> None:
    rig.camera.open()
    rig.twin.faults.trigger("slow")
    frames = [rig.camera.read(READ_S) for _ in range(3)]
    assert all(b.number - a.number >= 15 for a, b in pairwise(frames))
    assert all(b.monotonic_ns - a.monotonic_ns > 0.4e9 for a, b in pairwise(frames[1:]))


def test_a_late_picture_is_a_timeout_and_then_comes(rig: TwinRig) -> None:
    rig.camera.open()
    rig.twin.faults.trigger("late")
    with pytest.raises(FrameTimeout):
        read_on(rig, 0.8)
    begun = time.monotonic()
    assert rig.camera.read(READ_S).depth.any()
    assert time.monotonic() - begun > 0.3, "it was late, not lost"


def test_a_camera_that_never_comes_is_silent_from_the_start(rig: TwinRig) -> None:
    rig.twin.faults.trigger("never comes")
    rig.camera.open()
    with pytest.raises(FrameTimeout):
        rig.camera.read(0.2)


def test_a_cable_that_was_out_for_a_moment_needs_a_reopening(rig: TwinRig) -> None:
    rig.camera.open()
    rig.camera.read(READ_S)
    rig.unplug()
    rig.plug_in()
    with pytest.raises(SensorLost):
        rig.camera.read(0.2)
    rig.camera.open()
    assert rig.camera.read(READ_S).depth.any()


def test_a_hanging_library_hangs_until_the_fault_is_over(rig: TwinRig) -> None:
    rig.camera.open()
    rig.twin.faults.trigger("hang")
    came = threading.Event()

    def read() -> None:
        rig.camera.read(READ_S)
        came.set()

    thread = threading.Thread(target=read, daemon=True)
    thread.start()
    assert not came.wait(0.3)
    rig.twin.faults.end("hang")
    assert came.wait(READ_S)
    thread.join(READ_S)


@pytest.mark.parametrize(("cure", "after_reopening", "after_reset"), [("none", 0, 0), ("restart", 1, 1), ("reset", 0, 1)])
def test_the_ladder_cures_what_it_can(rig: TwinRig, cure: str, after_reopening: int, after_reset: int) -> None:
    rig.camera.open()
    rig.twin.faults.trigger("all zero", cure=cure)
    rig.camera.open()
    assert rig.camera.read(READ_S).depth.any() == after_reopening
    rig.camera.reset()
    assert rig.twin.resets == 1
    rig.camera.open()
    assert rig.camera.read(READ_S).depth.any() == after_reset


class Clock:
    now = 0.0

    def __call__(self) -> float:
        return self.now


def test_a_script_runs_by_the_clock_from_the_first_start() -> None:
    clock = Clock()
    script = FaultScript([Fault("disconnect", 5.0), Fault("reconnect", 7.0), Fault("freeze", 2.0, 1.0)], clock)
    clock.now = 100.0
    assert script.active() == frozenset()
    script.begin()
    seen = []
    for clock.now in (100.0, 102.5, 103.5, 105.5, 107.5):
        script.begin()
        seen.append((sorted(script.active()), script.times_unplugged()))
    assert seen == [([], 0), (["freeze"], 0), ([], 0), (["disconnect"], 1), ([], 1)]


def test_a_reconnect_and_disconnect_between_two_looks_are_not_missed() -> None:
    clock = Clock()
    script = FaultScript([Fault("disconnect", 1.0), Fault("reconnect", 1.1), Fault("disconnect", 1.2, 0.1)], clock)
    script.begin()
    clock.now = 2.0
    assert script.active() == frozenset()
    assert script.times_unplugged() == 2


@pytest.mark.parametrize(
    "values", [("melt", 0, 1, "none"), ("freeze", -1, 1, "none"), ("freeze", 0, 0, "none"), ("freeze", 0, 1, "x")]
)
def test_impossible_faults_are_refused(values: tuple[str, float, float, str]) -> None:
    with pytest.raises(ValueError, match="fault"):
        Fault(*values)


def test_every_fault_and_cure_has_a_name_the_description_takes(tmp_path: Path) -> None:
    faults = [{"name": name, "at_s": 1, "for_s": 2, "cure": cure} for name in FAULTS for cure in CURES]
    file = tmp_path / "sewer.json"
    file.write_text(json.dumps({"faults": faults}))
    assert [fault.name for fault in read_description(file).faults] == [fault["name"] for fault in faults]


# --- the demo's box and its description ---


def test_a_description_is_read(tmp_path: Path) -> None:
    file = tmp_path / "sewer.json"
    file.write_text(json.dumps({"shape": "egg", "diameter_mm": 600, "smears": [[0.2, 0.3, 0.1]], "position": "middle"}))
    found = read_description(file)
    assert (found.shape, found.position, found.smears) == ("egg", "middle", ((0.2, 0.3, 0.1),))
    assert 2 * found.profile.below() == pytest.approx(0.9, abs=1e-3)
    cameras = open_depth_cameras("virtual", description=file)
    cameras[0].open()
    assert cameras[0].read(READ_S).depth.any()
    cameras[0].close()


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("no json", "is not JSON"),
        ("[]", "holds no JSON object"),
        ('{"diameter": 300}', "there is no field diameter"),
        ('{"diameter_mm": "wide"}', "diameter_mm must be a number"),
        ('{"diameter_mm": 5000}', "diameter_mm must be between 150 and 1100"),
        ('{"diameter_mm": NaN}', "diameter_mm must be a number"),
        ('{"shape": "square"}', "shape must be one of circular, egg, oval, dented"),
        ('{"shape": 3}', "shape must be text"),
        ('{"lowering": 1}', "lowering must be true or false"),
        ('{"position": "roof"}', "position must be one of top, middle"),
        ('{"faults": [{"name": "melt"}]}', "there is no fault 'melt'"),
        ('{"faults": [{"name": "freeze", "until": 3}]}', "a fault has no field until"),
        ('{"smears": [[1, 2]]}', "a smear must be a list of 3 numbers"),
    ],
)
def test_a_broken_description_is_told_in_one_sentence(text: str, told: str, tmp_path: Path) -> None:
    file = tmp_path / "sewer.json"
    file.write_text(text)
    with pytest.raises(DescriptionBroken, match=told) as caught:
        read_description(file)
    assert "\n" not in str(caught.value)
    with pytest.raises(DescriptionBroken, match="There is no file"):
        read_description(tmp_path / "none.json")


def test_the_box_is_let_down_before_the_wall_and_ends_in_the_pipe() -> None:
    clock = Clock()
    description = Description(lowering=True, position="top")
    rig = DemoRig(description, clock=clock)
    rig.begin()
    sewer = description.sewer()
    ahead = np.zeros((1, 1, 2), np.float32)
    met = []
    for clock.now in (0.5, 30.0):
        pose = rig.pose()
        met.append(int(sewer.cast(pose.position, pose.rotation, ahead).material[0, 0]))
        met.append(pose.chainage > 0)
    assert met == [world.CHAMBER, False, world.WALL, True], "two degrees to the right, the line of sight ends on the wall"


def test_the_box_moves_to_the_middle_by_itself_and_when_asked() -> None:
    clock = Clock()
    rig = DemoRig(Description(hand="none", stay_s=10), clock=clock)
    rig.begin()
    heights = []
    for clock.now in (5.0, 12.0, 20.0, 33.0):
        heights.append(rig.pose().down)
    top, moving, middle, back = heights
    assert top < -0.03
    assert top < moving < middle
    assert (middle, back) == (pytest.approx(0.0), pytest.approx(top))
    rig.move("middle")
    clock.now = 100.0
    assert rig.pose().down == pytest.approx(0.0)
    with pytest.raises(ValueError, match="top or middle"):
        rig.move("roof")


def test_the_hand_trembles_smoothly_and_stays() -> None:
    clock = Clock()
    rig = DemoRig(Description(position="top", hand="steady"), clock=clock)
    rig.begin()
    places = []
    for clock.now in np.arange(0, 20, 1 / 60):
        places.append(rig.pose().position)
    steps = np.linalg.norm(np.diff(places, axis=0), axis=1)
    assert 0.0003 < np.std(places, axis=0).mean() < 0.005
    assert steps.max() < 0.004


def test_each_camera_states_how_wrong_its_scale_may_be() -> None:
    stated = []
    for camera in open_depth_cameras("virtual", cameras=2):
        camera.open()
        stated.append(camera.read(2.0).scale_std)
        camera.close()
    assert stated == [STEREO_SCALE_STD, TIME_OF_FLIGHT_SCALE_STD]
