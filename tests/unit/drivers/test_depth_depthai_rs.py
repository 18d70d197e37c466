"""OAK cameras behind the pyrealsense2 surface."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from typing import Any

import cv2
import numpy as np
import pytest

pytest.importorskip("depthai", reason="depthai is not installed")

import depthai as dai

import drivers.depth.depthai_rs as oak
from drivers.base import SensorLost, SensorMissing
from drivers.depth.base import DepthSettings
from drivers.depth.depthai_rs.configs import StreamRequest
from drivers.depth.depthai_rs.devices import exposure_control
from drivers.depth.depthai_rs.frames import frame_of
from drivers.depth.depthai_rs.graph import build_graph, plan_streams
from drivers.depth.depthai_rs.lens import lens_intrinsics, plain_coefficients, stated_intrinsics
from drivers.depth.depthai_rs.pipelines import calibrated_intrinsics
from drivers.depth.librealsense import LibrealsenseCamera
from estimators.pinhole import Intrinsics
from tests.unit.drivers.depth_camera_contract import LiveCameraContract
from tests.unit.drivers.fake_oak import (
    RATIONAL,
    SOCKET,
    TURN,
    FakeDai,
    FakeDevice,
    FakePipeline,
    OakRig,
    calibration,
    color_message,
    depth_message,
    gray_message,
    held_against,
    matrix,
    stereo_features,
    stereo_pair,
    tof_features,
)

STATED = Intrinsics(848, 480, 525.0, 526.0, 430.0, 244.5)
"""Of the stereo depth, as its frames state it themselves."""
TOF = Intrinsics(640, 480, 470.0, 471.0, 321.0, 243.0)
"""Of the time of flight, from the calibration: its frames state nothing."""


@pytest.fixture(autouse=True)
def quick_reboot(monkeypatch: pytest.MonkeyPatch) -> None:
    """The fake device is back on the bus at once."""
    monkeypatch.setattr(sys.modules["drivers.depth.depthai_rs.devices"], "REBOOT_SECONDS", 0.3)


class TestStereo(LiveCameraContract):
    @pytest.fixture
    def rig(self) -> Iterator[OakRig]:
        made = OakRig(DepthSettings(), STATED, lens=[[525.0, 0.0, 430.0], [0.0, 526.0, 244.5], [0.0, 0.0, 1.0]])
        yield made
        made.close()


class TestTimeOfFlight(LiveCameraContract):
    @pytest.fixture
    def rig(self) -> Iterator[OakRig]:
        made = OakRig(DepthSettings(640, 480), TOF, tof_features())
        yield made
        made.close()


def plan(features: list[Any], *requests: StreamRequest) -> Any:
    return plan_streams(dai, features, [stereo_pair()], requests)


DEPTH = StreamRequest(oak.stream.depth, 0, 848, 480, oak.format.z16, 30)
COLOR = StreamRequest(oak.stream.color, 0, 848, 480, oak.format.bgr8, 30)
LEFT = StreamRequest(oak.stream.infrared, 1, 848, 480, oak.format.y8, 30)
RIGHT = StreamRequest(oak.stream.infrared, 2, 848, 480, oak.format.y8, 30)
TOF_DEPTH = StreamRequest(oak.stream.depth, 0, 640, 480, oak.format.z16, 30)


def built(features: list[Any], *requests: StreamRequest) -> tuple[FakePipeline, Any]:
    bus = FakeDai(features)
    pipeline = FakePipeline(bus.Device(bus.info()))
    return pipeline, build_graph(bus, pipeline, plan(features, *requests))


def test_stereo_depth_is_rectified_near_unsmoothed_and_in_millimetres() -> None:
    pipeline, _ = built(stereo_features(), DEPTH)
    stereo = pipeline.node(dai.node.StereoDepth)
    for name in ("setRectification", "enableDistortionCorrection", "setLeftRightCheck", "setExtendedDisparity", "setSubpixel"):
        assert stereo.calls[name][0] == (True,), name
    align = dai.StereoDepthConfig.AlgorithmControl.DepthAlign
    assert stereo.calls["setDepthAlign"][0] == (align.RECTIFIED_RIGHT,)
    assert stereo.initialConfig.algorithmControl.depthUnit == dai.DepthUnit.MILLIMETER
    assert stereo.initialConfig.getMedianFilter() == dai.MedianFilter.MEDIAN_OFF


def test_the_pair_feeds_the_matcher_at_the_size_that_was_asked() -> None:
    pipeline, graph = built(stereo_features(), DEPTH, COLOR)
    links = {target.name: source.owner for source, target in pipeline.links}
    assert str(links["left"]) == "Camera CAM_B"
    assert str(links["right"]) == "Camera CAM_C"
    for camera in links.values():
        size, keywords = camera.outputs[0]
        assert size == (848, 480)
        assert keywords["type"] == dai.ImgFrame.Type.GRAY8
        assert keywords["fps"] == 30.0
    assert set(graph.queues) == {(oak.stream.depth, 0), (oak.stream.color, 0)}
    assert set(pipeline.queues) == {("StereoDepth AUTO", "depth"), ("Camera CAM_A", "output 1")}
    assert len(graph.controls) == 2


def test_queues_keep_the_newest_and_never_hold_the_device_up() -> None:
    pipeline, _ = built(stereo_features(), DEPTH)
    queue = pipeline.queues["StereoDepth AUTO", "depth"]
    assert not queue.getBlocking()
    assert queue.getMaxSize() == 2


def test_infrared_beside_stereo_depth_is_what_the_matcher_saw() -> None:
    pipeline, graph = built(stereo_features(), DEPTH, LEFT, RIGHT)
    assert {("StereoDepth AUTO", "rectifiedLeft"), ("StereoDepth AUTO", "rectifiedRight")} < set(pipeline.queues)
    assert (oak.stream.infrared, 2) in graph.queues
    assert all(planned.rectified for planned in plan(stereo_features(), DEPTH, LEFT, RIGHT).streams)
    with pytest.raises(RuntimeError, match="resolve"):
        plan(stereo_features(), DEPTH, StreamRequest(oak.stream.infrared, 1, 640, 480))


def test_infrared_alone_is_as_the_lens_throws_it() -> None:
    pipeline, _ = built(stereo_features(), RIGHT)
    assert set(pipeline.queues) == {("Camera CAM_C", "output 1")}
    assert not plan(stereo_features(), RIGHT).streams[0].rectified


def test_time_of_flight_gives_the_depth_where_there_is_one() -> None:
    pipeline, graph = built(tof_features(), TOF_DEPTH, COLOR)
    tof = pipeline.node(dai.node.ToF)
    assert tof.calls["build"][0][0] == SOCKET.CAM_D
    assert tof.calls["setOutputUndistortion"][0] == (True,)
    assert tof.config.enableDistortionCorrection
    assert tof.config.enableOpticalCorrection
    assert ("ToF CAM_D", "depth") in pipeline.queues
    assert not any(node.real is dai.node.StereoDepth for node in pipeline.nodes)
    assert ("Camera CAM_B", "output 1") in pipeline.queues, "colour comes from a camera of the pair"
    assert graph.controls == ()


@pytest.mark.parametrize(
    ("features", "request_"),
    [
        (stereo_features(), StreamRequest(oak.stream.depth, 0, 850, 480)),
        (stereo_features(), StreamRequest(oak.stream.depth, 0, 1920, 1080)),
        (stereo_features(), StreamRequest(oak.stream.depth, 0, 640, 480, oak.format.y8)),
        (stereo_features(), StreamRequest(oak.stream.color, 0, 8000, 6000)),
        (stereo_features(), StreamRequest(oak.stream.infrared, 3, 640, 480)),
        (stereo_features()[1:], COLOR),
        (tof_features(), DEPTH),
        ([], DEPTH),
    ],
    ids=[
        "width not in 16s",
        "larger than the sensor",
        "depth in grey",
        "large colour",
        "third eye",
        "no colour",
        "tof",
        "blind",
    ],
)
def test_what_a_device_cannot_do_is_refused_in_the_words_of_pyrealsense2(features: list[Any], request_: StreamRequest) -> None:
    with pytest.raises(RuntimeError, match="Couldn't resolve requests"):
        plan(features, request_)


def test_nothing_asked_is_nothing_to_resolve() -> None:
    with pytest.raises(RuntimeError, match="Couldn't resolve requests"):
        plan(stereo_features())


def test_the_fake_holds_calls_against_the_real_signatures() -> None:
    held_against(dai.node.StereoDepth, "setRectification", (True,), {})
    held_against(dai.node.Camera, "requestOutput", ((640, 480),), {"fps": 30.0})
    with pytest.raises(AssertionError):
        held_against(dai.node.Camera, "requestOutput", (), {"fps": 30.0})
    with pytest.raises(AssertionError):
        held_against(dai.node.Camera, "requestOutput", ((640, 480),), {"framerate": 30.0})
    with pytest.raises(AttributeError):
        held_against(dai.node.StereoDepth, "setMagic", (True,), {})


def test_the_fake_device_and_ports_have_no_method_the_real_ones_lack() -> None:
    for fake, real in (
        (FakeDevice, dai.Device),
        (FakePipeline, dai.Pipeline),
    ):
        own = {name for name in vars(fake) if not name.startswith("_") and callable(vars(fake)[name])} - {"node"}
        assert own <= set(dir(real)), own - set(dir(real))
    assert hasattr(dai.Node.Output, "link")
    assert hasattr(dai.Node.Output, "createOutputQueue")
    assert hasattr(dai.Node.Input, "createInputQueue")


def test_rectified_pictures_share_the_right_cameras_pinhole_and_have_no_distortion() -> None:
    made = plan(stereo_features(), DEPTH, LEFT, RIGHT)
    lenses = [calibrated_intrinsics(calibration(), made, planned) for planned in made.streams]
    scale = 848 / 1280
    for lens in lenses:
        assert lens.fx == pytest.approx(793.3 * scale, rel=1e-5)
        assert lens.fy == pytest.approx(794.3 * scale, rel=1e-5)
        assert lens.ppx == pytest.approx(649.4 * scale, abs=0.01)
        # 1280 x 800 scaled to 848 x 530 loses 25 rows above and below
        assert lens.ppy == pytest.approx(406.8 * scale - 25, abs=0.01)
        assert lens.model is oak.distortion.none
        assert lens.coeffs == [0.0] * 5


def test_a_picture_as_the_lens_throws_it_keeps_its_distortion() -> None:
    made = plan(stereo_features(), RIGHT)
    lens = calibrated_intrinsics(calibration(), made, made.streams[0])
    assert lens.model is oak.distortion.brown_conrady
    assert any(lens.coeffs)


def test_a_rational_lens_is_described_well_enough_to_look_through() -> None:
    """The rays of every pixel by OpenCV's rational model and by the five coefficients that were fitted to it."""
    size = (848, 480)
    found = lens_intrinsics(matrix(525.6, 430.2, 244.5), size, RATIONAL + [0.0] * 6, "Perspective")
    rays = np.stack(np.meshgrid(np.linspace(-0.7, 0.7, 30), np.linspace(-0.4, 0.4, 20)), axis=-1).reshape(-1, 2)
    points = np.column_stack([rays, np.ones(len(rays))])
    camera = np.array(matrix(525.6, 430.2, 244.5))
    exact, _ = cv2.projectPoints(points, np.zeros(3), np.zeros(3), camera, np.array(RATIONAL))
    plain, _ = cv2.projectPoints(points, np.zeros(3), np.zeros(3), camera, np.array(found.coeffs))
    undistorted, _ = cv2.projectPoints(points, np.zeros(3), np.zeros(3), camera, np.zeros(5))
    inside = ((exact > 0) & (exact < np.array(size) - 1)).all(axis=(1, 2))
    assert inside.sum() > 300
    worst = np.abs(exact - plain)[inside].max()
    assert worst < 0.5
    assert np.abs(exact - undistorted)[inside].max() > 10.0, "a lens without distortion would prove nothing"
    _, residual_px = plain_coefficients(RATIONAL, oak.intrinsics(*size, 525.6, 526.6, 430.2, 244.5))
    assert worst <= residual_px < 2.0


def test_a_lens_that_cannot_be_described_says_so(caplog: pytest.LogCaptureFixture) -> None:
    lens_intrinsics(matrix(793.0, 640.0, 400.0), (1280, 800), [20.0, 5.0, 0.001, 0.0005, 0.3, 20.3, 12.0, 1.9], "Perspective")
    assert "five distortion coefficients" in caplog.text


def test_plain_coefficients_are_found_again_exactly() -> None:
    plain = [0.11, -0.23, 0.0012, -0.0007, 0.04]
    pixels = oak.intrinsics(640, 480, 400.0, 400.0, 320.0, 240.0)
    found, residual_px = plain_coefficients(plain, pixels)
    assert found == pytest.approx(plain, abs=1e-5)
    assert residual_px < 1e-3
    taken = lens_intrinsics(matrix(400.0, 320.0, 240.0), (640, 480), plain + [0.0] * 9, "Perspective")
    assert taken.coeffs == plain


def test_other_lens_models() -> None:
    fisheye = lens_intrinsics(matrix(400.0, 320.0, 240.0), (640, 480), [0.1, 0.2, 0.3, 0.4], "Fisheye")
    assert fisheye.model is oak.distortion.kannala_brandt4
    assert fisheye.coeffs == [0.1, 0.2, 0.3, 0.4, 0.0]
    assert lens_intrinsics(matrix(400.0, 320.0, 240.0), (640, 480), [0.0] * 14, "Perspective").model is oak.distortion.none
    with pytest.raises(RuntimeError, match="Cylindrical"):
        lens_intrinsics(matrix(400.0, 320.0, 240.0), (640, 480), [0.1], "Cylindrical")


def test_what_a_frame_states_of_itself_comes_first() -> None:
    data = np.zeros((480, 848), np.uint16)
    stated = stated_intrinsics(depth_message(data, 1, matrix(500.0, 424.0, 240.0)), (848, 480))
    assert stated is not None
    assert (stated.fx, stated.fy, stated.ppx, stated.ppy) == (500.0, 501.0, 424.0, 240.0)
    assert stated_intrinsics(depth_message(data, 1), (848, 480)) is None
    assert stated_intrinsics(depth_message(data, 1, matrix(1.0, 0.0, 0.0)), (848, 480)) is None, "nobody filled it in"
    assert stated_intrinsics(depth_message(data, 1, matrix(float("nan"), 0.0, 0.0)), (848, 480)) is None
    assert stated_intrinsics(depth_message(data, 1, matrix(500.0, 424.0, 240.0)), (640, 480)) is None, "of another size"


def profile_of(planned: Any, made: Any) -> Any:
    return oak.stream_profile(
        planned.kind,
        planned.index,
        planned.pixels,
        planned.size,
        planned.fps,
        lambda: calibrated_intrinsics(calibration(), made, planned),
        planned.rectified,
    )


def test_messages_become_frames() -> None:
    made = plan(stereo_features(), DEPTH, COLOR, LEFT)
    depth, color, left = (profile_of(planned, made) for planned in made.streams)
    data = np.arange(480 * 848, dtype=np.uint16).reshape(480, 848)
    found = frame_of(depth_message(data, 7), depth)
    assert np.array_equal(found.get_data(), data)
    assert found.get_frame_number() == 7
    assert found.get_timestamp() == pytest.approx(1231.0)
    assert found.get_distance(10, 2) == pytest.approx(data[2, 10] / 1000)
    assert (found.get_width(), found.get_height()) == (848, 480)
    assert found.profile.as_video_stream_profile().get_intrinsics().fx == pytest.approx(793.3 * 848 / 1280, rel=1e-5)

    red = np.zeros((480, 848, 3), np.uint8)
    red[..., 2] = 255
    assert frame_of(color_message(red, 1), color).get_data()[0, 0].tolist() == pytest.approx([0, 0, 255], abs=2)
    gray = np.full((480, 848), 77, np.uint8)
    assert np.array_equal(frame_of(gray_message(gray, 1), left).get_data(), gray)
    with pytest.raises(RuntimeError, match="Only a depth frame"):
        frame_of(gray_message(gray, 1), left).get_distance(0, 0)


def test_a_message_of_the_wrong_kind_is_no_frame() -> None:
    made = plan(stereo_features(), DEPTH, COLOR)
    depth, color = (profile_of(planned, made) for planned in made.streams)
    with pytest.raises(RuntimeError, match="uint8"):
        frame_of(gray_message(np.zeros((480, 848), np.uint8), 1), depth)
    with pytest.raises(RuntimeError, match="shape"):
        frame_of(gray_message(np.zeros((480, 848), np.uint8), 1), color)
    short = dai.ImgFrame()
    short.setType(dai.ImgFrame.Type.RAW16)
    short.setWidth(848)
    short.setHeight(480)
    short.setData(np.zeros(100, np.uint8))
    with pytest.raises(RuntimeError, match="enough data"):
        frame_of(short, depth)


def test_colour_can_be_asked_red_first() -> None:
    made = plan(stereo_features(), StreamRequest(oak.stream.color, 0, 848, 480, oak.format.rgb8, 30))
    red = np.zeros((480, 848, 3), np.uint8)
    red[..., 2] = 255
    found = frame_of(color_message(red, 1), profile_of(made.streams[0], made)).get_data()
    assert found[0, 0].tolist() == pytest.approx([255, 0, 0], abs=2)


def test_requests_are_written_as_pyrealsense2_takes_them() -> None:
    asked = oak.config()
    asked.enable_stream(oak.stream.depth)
    asked.enable_stream(oak.stream.infrared, 2, 640, 480, oak.format.y8, 15)
    asked.enable_stream(oak.stream.color, 848, 480, oak.format.bgr8, 30)
    assert list(asked.requests.values()) == [
        StreamRequest(oak.stream.depth),
        StreamRequest(oak.stream.infrared, 2, 640, 480, oak.format.y8, 15),
        StreamRequest(oak.stream.color, 0, 848, 480, oak.format.bgr8, 30),
    ]
    asked.disable_stream(oak.stream.color)
    assert len(asked.requests) == 2
    asked.disable_all_streams()
    assert not asked.requests
    with pytest.raises(TypeError):
        asked.enable_stream(oak.stream.depth, "wide")
    with pytest.raises(RuntimeError, match="pyrealsense2"):
        asked.enable_device_from_file("run.db3")


def started(bus: FakeDai, *requests: tuple[Any, ...]) -> tuple[Any, Any]:
    surface = bus.surface()
    pipeline, asked = surface.pipeline(), surface.config()
    for request in requests:
        asked.enable_stream(*request)
    return pipeline, pipeline.start(asked)


def test_emitter_and_exposure_reach_the_device() -> None:
    bus = FakeDai()
    pipeline, profile = started(bus, (oak.stream.depth, 848, 480, oak.format.z16, 30))
    sensor = profile.get_device().first_depth_sensor()
    device = bus.device
    assert device is not None
    assert device.pipeline is not None
    sensor.set_option(oak.option.laser_power, 0.5)
    sensor.set_option(oak.option.emitter_enabled, 1)
    assert device.intensity == 0.5
    sensor.set_option(oak.option.emitter_enabled, 0)
    assert device.intensity == 0.0
    sensor.set_option(oak.option.exposure, 4000)
    assert [control.getExposureTime().total_seconds() for control in device.pipeline.sent] == [0.004, 0.004]
    assert sensor.get_option(oak.option.exposure) == 4000
    assert sensor.get_option(oak.option.enable_auto_exposure) == 0
    for wanted, value in ((oak.option.laser_power, 1.5), (oak.option.exposure, 0)):
        with pytest.raises(RuntimeError, match="out of range"):
            sensor.set_option(wanted, value)
    pipeline.stop()


def test_automatic_exposure_is_a_command_of_its_own() -> None:
    values = {oak.option.enable_auto_exposure: 1.0, oak.option.exposure: 4000.0, oak.option.gain: 400.0}
    automatic = exposure_control(dai, values)
    manual = exposure_control(dai, {**values, oak.option.enable_auto_exposure: 0.0})
    assert automatic.getExposureTime().total_seconds() != 0.004
    assert manual.getExposureTime().total_seconds() == 0.004
    assert manual.getSensitivity() == 400


def test_a_device_without_projector_says_so() -> None:
    bus = FakeDai(projector=False)
    pipeline, profile = started(bus, (oak.stream.depth, 640, 480, oak.format.z16, 30))
    sensor = profile.get_device().first_depth_sensor()
    assert not sensor.supports(oak.option.emitter_enabled)
    assert sensor.supports(oak.option.exposure)
    with pytest.raises(RuntimeError, match="support"):
        sensor.set_option(oak.option.emitter_enabled, 1)
    pipeline.stop()


def test_devices_are_listed_by_serial_number_without_being_opened() -> None:
    bus = FakeDai()
    found = oak.context(bus).query_devices()
    assert [device.get_info(oak.camera_info.serial_number) for device in found] == [bus.serial]
    assert bus.device is None
    pipeline, profile = started(bus, (oak.stream.depth,))
    assert profile.get_device().get_info(oak.camera_info.name) == "OAK-D-PRO"
    assert profile.get_device().get_info(oak.camera_info.usb_type_descriptor) == "SUPER"
    assert profile.get_device().get_info(oak.camera_info.product_line) == "OAK"
    assert bus.device is not None
    assert bus.device.attempts == 0, "DepthAI must not hold a lost device while the ladder opens it"
    pipeline.stop()
    assert bus.device is None


def test_a_device_that_reboots_is_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys.modules["drivers.depth.depthai_rs.devices"], "REBOOT_SECONDS", 5.0)
    bus = FakeDai()
    pipeline, _ = started(bus, (oak.stream.depth,))
    pipeline.stop()
    bus.plugged = False
    answers = iter([False, False, True])
    monkeypatch.setattr(bus.Device, "getAllAvailableDevices", staticmethod(lambda: [bus.info()] if next(answers) else []))
    begun = time.monotonic()
    assert len(oak.context(bus).query_devices()) == 1
    assert 0.1 < time.monotonic() - begun < 3.0


def test_an_impossible_request_boots_a_known_device_no_more() -> None:
    bus = FakeDai(tof_features())
    camera = LibrealsenseCamera(bus.surface(), DepthSettings(848, 480))
    camera.open()
    assert "640 x 480" in camera.notice
    camera.close()
    assert bus.boots == 2, "once to learn what it has, once to stream"
    camera.open()
    camera.close()
    assert bus.boots == 3


def test_without_a_device_pyrealsense2s_words_are_said() -> None:
    bus = FakeDai()
    bus.plugged = False
    with pytest.raises(RuntimeError, match="No device connected"):
        bus.surface().pipeline().start(oak.config())
    with pytest.raises(RuntimeError, match="not started"):
        bus.surface().pipeline().wait_for_frames(10)


def test_real_depthai_without_a_device_is_a_missing_camera() -> None:
    if dai.Device.getAllConnectedDevices():
        pytest.skip("an OAK camera is plugged in")
    with pytest.raises(RuntimeError, match="No device connected"):
        oak.pipeline().start()
    with pytest.raises(SensorMissing):
        LibrealsenseCamera(oak, DepthSettings()).open()


@pytest.mark.parametrize("at", ["open", "start"])
@pytest.mark.parametrize("kind", [RuntimeError, ValueError, IndexError])
def test_a_device_that_fails_to_start_is_let_go(at: str, kind: type[Exception]) -> None:
    bus = FakeDai()
    bus.faults[at] = kind("X_LINK_ERROR")
    camera = LibrealsenseCamera(bus.surface(), DepthSettings())
    with pytest.raises(SensorLost, match="X_LINK_ERROR"):
        camera.open()
    assert bus.device is None
    bus.faults.clear()
    camera.open()
    camera.close()


def test_colour_is_the_latest_there_is() -> None:
    bus = FakeDai()
    pipeline, _ = started(bus, (oak.stream.depth, 848, 480, oak.format.z16, 30), (oak.stream.color, 848, 480))
    assert bus.device is not None
    assert bus.device.pipeline is not None
    queues = bus.device.pipeline.queues
    depth, color = queues["StereoDepth AUTO", "depth"], queues["Camera CAM_A", "output 1"]
    data, picture = np.ones((480, 848), np.uint16), np.zeros((480, 848, 3), np.uint8)
    depth.send(depth_message(data, 1))
    frames = pipeline.wait_for_frames(1000)
    assert frames.get_depth_frame().get_frame_number() == 1
    assert not frames.get_color_frame()
    color.send(color_message(picture, 5))
    color.send(color_message(picture, 6))
    depth.send(depth_message(data, 2))
    assert pipeline.wait_for_frames(1000).get_color_frame().get_frame_number() == 6
    depth.send(depth_message(data, 3))
    frames = pipeline.wait_for_frames(1000)
    assert frames.get_color_frame().get_frame_number() == 6
    assert (frames.size(), len(list(frames))) == (2, 2)
    with pytest.raises(RuntimeError, match="Frame didn't arrive within 20"):
        pipeline.wait_for_frames(20)
    assert pipeline.try_wait_for_frames(20)[0] is False
    assert pipeline.poll_for_frames().size() == 0
    pipeline.stop()


def test_aligned_depth_lies_on_its_colour() -> None:
    """A wall with a window in it, 1 m away: the window's edge must be found where the geometry puts it."""
    bus = FakeDai()
    pipeline, profile = started(bus, (oak.stream.depth, 848, 480, oak.format.z16, 30), (oak.stream.color, 848, 480))
    assert bus.device is not None
    assert bus.device.pipeline is not None
    depth = np.full((480, 848), 1000, np.uint16)
    depth[:, 424:] = 0
    queues = bus.device.pipeline.queues
    gradient = np.repeat(np.linspace(0, 255, 848).astype(np.uint8)[None, :, None], 480, axis=0).repeat(3, axis=2)
    queues["Camera CAM_A", "output 1"].send(color_message(gradient, 1))
    queues["StereoDepth AUTO", "depth"].send(depth_message(depth, 1))
    frames = pipeline.wait_for_frames(1000)

    moved = oak.align(oak.stream.color).process(frames).get_depth_frame()
    lens = profile.get_stream(oak.stream.color).get_intrinsics()
    assert moved.profile.get_intrinsics() == lens
    row = moved.get_data()[240]
    edge = np.flatnonzero(row).max()
    seen_from = profile.get_stream(oak.stream.depth).get_intrinsics()
    turned = (423.5 - seen_from.ppx) / seen_from.fx
    x, z = np.cos(TURN) * turned - np.sin(TURN), np.sin(TURN) * turned + np.cos(TURN)
    expected = lens.fx * (x + 0.0375) / z + lens.ppx
    assert edge == pytest.approx(expected, abs=1.5)
    assert np.median(row[row > 0]) == pytest.approx(1000, abs=6)

    color = oak.align(oak.stream.depth).process(frames).get_color_frame().get_data()
    assert color.shape == (480, 848, 3)
    assert color[240, 423, 0] == pytest.approx(255 * expected / 847, abs=3)
    assert not color[:, 424:].any()

    pipeline.stop()
    with pytest.raises(RuntimeError, match="needs a depth and a colour"):
        oak.align(oak.stream.color).process(oak.composite_frame([]))
    with pytest.raises(RuntimeError, match="align"):
        oak.align(oak.stream.infrared)
