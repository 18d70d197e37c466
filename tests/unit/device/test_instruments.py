"""What a report says of the sensors behind it."""

from __future__ import annotations

from device.inspections.instruments import crawler, depth_camera, scanner, stereo_camera


def test_a_drive_states_what_was_set_and_what_it_found() -> None:
    settings = {"grabber": "/dev/video0", "encoder": {"name": "QSB", "counts_per_metre": 1250.0}, "focal_px": (431.0, 430.2)}
    found = crawler(2, {"settings": settings, "scale": {"value": 1.00231, "sigma": 0.002}, "focal_radius": None})
    assert (found.survey, found.kind, found.sensor) == (2, "landmarks", "/dev/video0, QSB")
    assert found.calibration == {
        "counts_per_metre": "1250.0",
        "focal": "431.0 px x 430.2 px",
        "scale_found": "1.0023 ± 0.0020",
    }


def test_a_drive_that_states_nothing_is_no_error() -> None:
    assert crawler(2, {"settings": {}}).calibration == {}


def test_an_offset_is_stated_or_found_from_the_wall() -> None:
    stated = stereo_camera(3, {"camera": "oak", "offset_px": 31.5, "offset_std_px": 0.4, "own_offset": False})
    assert (stated.sensor, stated.calibration) == ("oak", {"offset": "31.50 ± 0.40 px"})
    assert stereo_camera(3, {"offset_px": 31.5, "own_offset": True}).calibration == {"offset_found": "31.50 px"}
    assert stereo_camera(3, {}).calibration == {}


def test_depth_camera_and_scanner() -> None:
    assert depth_camera(1, {"camera": "D435i"}).calibration == {"scale_error": "0.4 %"}
    assert scanner(4, {"settings": {"scanner": "camera", "radius_m": 0.0315}}).calibration == {"pipe_radius": "31.5 mm"}
