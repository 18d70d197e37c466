"""The anomaly survey in a browser: aim, scan, look at what was found; on a phone and on a laptop, and read by everybody."""

from collections.abc import Callable

import pytest
from playwright.sync_api import expect

from tests.browser.conftest import Watched
from tests.browser.fake_device import FakeDevice


def test_from_the_menu_to_a_finding(screen: Watched, device: FakeDevice) -> None:
    pipe = device.places.create_pipe(
        {"name": "P1", "material": "concrete", "shape": "circular", "reference_dn": 400, "note": ""}
    )
    page = screen.open("/drive")
    if page.locator("#surveys-open").is_visible():
        page.click("#surveys-open")
    page.get_by_role("link", name="Anomaly").click()
    expect(page.locator("#prompt-remedy")).to_contain_text("press Scan")
    expect(page.locator("#aim-matched")).to_have_text("88 %")
    expect(page.locator("#aim-aside")).to_have_text("13 % of the radius, low and left")
    page.select_option("#pipe", str(pipe["id"]))
    expect(page.locator("#chainage")).to_have_value("12.34")  # as the tether counts, until somebody says otherwise
    page.fill("#chainage", "12,5")
    page.click("#chainage-tether")
    expect(page.locator("#chainage")).to_have_value("12.34")
    page.fill("#chainage", "12,0")
    page.click("#start")
    expect(page.locator("#found-word")).to_have_text("1 deviation")
    assert device.anomaly.calls == [{"pipe_id": pipe["id"], "chainage_m": 12.0, "pairs": None}]
    expect(page.locator("#regions")).to_contain_text("at 12.95 m, 6.0 o'clock")
    expect(page.get_by_text("deviated in one pair alone")).to_be_visible()
    smooth = page.get_by_text("Too smooth or too far off from 13.20 to 13.50 m: places of up to 33 cm² may go unseen there.")
    expect(smooth).to_be_visible()
    drawn = page.locator("#wall .region")
    expect(drawn).to_have_count(2)  # the pipe is cut open at the invert, where it lies
    left, right = (box for k in range(2) if (box := drawn.nth(k).bounding_box()) is not None)
    wall = page.locator("#wall image").bounding_box()
    assert wall is not None
    edges = sorted((left["x"], right["x"] + right["width"]))
    assert edges == pytest.approx([wall["x"], wall["x"] + wall["width"]], abs=4)
    page.click("#show-reference")
    expect(page.locator("#show-reference")).to_have_attribute("aria-pressed", "true")
    page.click("#cloud-show")
    expect(page.locator("#cloud canvas")).to_be_focused()
    page.goto(f"{screen.root}/surveys")
    expect(page.locator(".row").first).to_contain_text("1 deviation")


def test_scans_of_one_go_are_joined_along_the_pipe(screen: Watched, device: FakeDevice) -> None:
    first, second, _ = (device.anomaly.add(chainage=station) for station in (12.0, 12.6, 15.0))
    page = screen.open(f"/surveys/{first}")
    along = page.get_by_role("region", name="Along the pipe", exact=True)
    expect(along).to_contain_text("3 scans in one go, from 12.3 to 16.5 m")
    expect(along).to_contain_text("Not scanned from 14.1 to 15.3 m.")
    places = along.locator("#along-regions li")
    expect(places).to_have_count(3)  # each stands as far ahead of its camera
    expect(along.locator("#along .inward")).to_have_count(42)
    expect(page.get_by_text("Stand at 13.8 m for the next scan")).to_be_visible()
    along.get_by_role("link", name=str(second)).click()
    expect(page).to_have_url(f"{screen.root}/surveys/{second}")
    device.anomaly.outcome = "refused"
    page.goto(f"{screen.root}/surveys/{device.anomaly.add(chainage=14.0)}")
    expect(along.locator("#along .inward")).to_have_count(42)  # the pipe is told where this scan tells nothing, too


def test_a_smooth_wall_a_lost_camera_and_a_cancelled_scan(watch: Callable[..., Watched], device: FakeDevice) -> None:
    device.anomaly.level, device.anomaly.seconds = "poor", 30.0
    page = watch().open("/anomaly")
    expect(page.locator("#prompt-remedy")).to_contain_text("projector")
    page.click("#start")
    page.click("#cancel")
    expect(page.locator("#start")).to_be_visible()
    expect(page.locator("#announce")).to_contain_text("cancelled")
    device.anomaly.level = "lost"
    expect(page.locator("#prompt-reason")).to_have_text("The stereo camera is lost.")


def test_a_box_without_a_stereo_camera_says_so(watch: Callable[..., Watched], device: FakeDevice) -> None:
    device.anomaly.available = False
    page = watch().open("/anomaly")
    expect(page.locator("#unavailable")).to_contain_text("[stereo]")
    expect(page.locator("#start")).to_be_disabled()


def test_two_plain_cameras_are_calibrated_with_a_board(screen: Watched, device: FakeDevice) -> None:
    device.anomaly.calibration.enough = 5
    page = screen.open("/anomaly")
    page.get_by_role("link", name="Calibrate the two cameras").click()
    expect(page.locator("#in-use")).to_contain_text("Not calibrated yet")
    page.fill("#square", "29,5")
    page.click("#begin")
    expect(page.locator("#prompt-remedy")).to_have_text("Show it in the upper left of the left picture.")
    assert "square_mm=29.5" in (page.locator("#board-pdf").get_attribute("href") or "")
    expect(page.locator("#cells-left .covered")).to_have_count(24)
    expect(page.locator("#found-offset")).to_have_text("± 0.08 px")
    expect(page.locator("#found-views")).to_have_text("18, 1 left out")
    assert device.anomaly.calibration.board == {"kind": "charuco", "columns": 9, "rows": 6, "square_m": 0.0295}
    assert device.anomaly.calibration.saved is None, "nothing is changed before somebody says so"
    page.click("#save")
    expect(page.locator("#in-use")).to_contain_text("In use: charuco 9 x 6, 30 mm, 18 views")
    device.anomaly.calibration.enough = 1000
    page.click("#begin")
    page.click("#finish")
    expect(page.locator("#prompt-remedy")).to_contain_text("at least 12 are needed")
    page.click("#begin")
    page.click("#cancel")
    expect(page.locator("#begin")).to_be_visible()


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("state", ["live", "found", "refused", "calibrate"])
def test_readable_reachable_and_named(watch: Callable[..., Watched], device: FakeDevice, state: str, scheme: str) -> None:
    from tests.browser.test_accessibility import CONTRAST_OF, NAMED, NAMELESS, SMALL_TARGETS

    device.anomaly.outcome = state
    device.anomaly.level = "poor"
    paths = {"live": "/anomaly", "calibrate": "/anomaly/calibrate"}
    page = watch(360, 740, color_scheme=scheme).open(paths.get(state) or f"/surveys/{device.anomaly.add()}")
    expect(page.locator("#health-text")).not_to_have_text("Box")
    if state == "live":
        expect(page.locator("#aim-matched")).to_have_text("21 %")
    assert page.evaluate("document.documentElement.scrollWidth") <= 360
    assert page.evaluate(CONTRAST_OF) == []
    assert page.evaluate(SMALL_TARGETS) == []
    assert page.evaluate(NAMELESS, NAMED) == []
