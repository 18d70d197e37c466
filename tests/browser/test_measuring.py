"""The measuring page in a browser: aim, see, press Measure, and what happens when things go wrong."""

import re
import time
from collections.abc import Callable

from playwright.sync_api import Page, expect

from tests.browser.conftest import Watched
from tests.browser.fake_device import FakeDevice
from tests.browser.serving import served
from tests.pairing import browser_cookie, pair
from web_ui.app import create_app

POLLS = "(() => { window.EventSource = undefined; delete window.EventSource; })()"


def changes(page: Page, selector: str, milliseconds: int) -> int:
    """How often the text or the points of `selector` change within the time."""
    return int(
        page.evaluate(
            """async ([selector, time]) => {
                let count = 0;
                const observer = new MutationObserver(() => (count += 1));
                const all = { subtree: true, childList: true, characterData: true, attributes: true };
                observer.observe(document.querySelector(selector), all);
                await new Promise((resolve) => setTimeout(resolve, time));
                observer.disconnect();
                return count;
            }""",
            [selector, milliseconds],
        )
    )


def test_aiming_shows_picture_circle_diameter_and_trust(screen: Watched) -> None:
    page = screen.open("/")
    expect(page.locator("#view-depth")).to_have_attribute("data-state", "live")
    expect(page.locator("#diameter")).to_have_text(re.compile(r"39[789]|399"))
    expect(page.locator("#interval")).to_have_text("395 to 401 mm (95 %)")
    expect(page.locator("#level-text")).to_have_text("Ready")
    expect(page.locator("#gauge svg")).to_have_attribute("aria-label", "Trust 92 percent")
    expect(page.locator("#prompt-remedy")).to_contain_text("press Measure")
    assert page.locator("#overlay polyline.line").count() == 2
    box = page.locator("#overlay polyline.line").first.bounding_box()
    frame = page.locator("#depth").bounding_box()
    assert box is not None
    assert frame is not None
    assert 0.3 < box["height"] / frame["height"] <= 1, "the circle must lie in the picture, at its scale"
    lit = page.evaluate(
        "depth.getContext('2d').getImageData(300, 100, 40, 40).data.some((value, i) => i % 4 < 3 && value > 60)"
    )
    assert lit, "the picture itself must be drawn"


def test_poor_aim_names_reason_and_remedy(screen: Watched, device: FakeDevice) -> None:
    device.scene = "poor"
    page = screen.open("/")
    expect(page.locator("#level-text")).to_have_text("Not yet")
    expect(page.locator("#prompt-reason")).to_have_text("The box points past the pipe's axis.")
    expect(page.locator("#prompt-remedy")).to_contain_text("Turn the rod")
    expect(page.locator("#overlay")).to_have_attribute("data-level", "poor")
    device.scene = "none"
    expect(page.locator("#level-text")).to_have_text("No pipe")
    expect(page.locator("#diameter")).to_have_text("–")
    expect(page.locator("#overlay polyline")).to_have_count(0)


def test_measuring_from_button_to_verdict(screen: Watched, device: FakeDevice) -> None:
    page = screen.open("/")
    page.get_by_role("button", name="Measure", exact=True).click()
    expect(page.locator("#running-count")).to_have_text(re.compile(r"\d+ of 50 frames"))
    expect(page.locator("#start")).to_be_hidden()
    page.wait_for_url("**/surveys/*")
    expect(page.get_by_role("heading", name="ACCEPT")).to_be_visible()
    expect(page.locator("#verdict .big")).to_have_text("398mm")
    assert device.measured == (None, "top", None, None)


def test_live_values_go_on_at_two_hertz_or_better_while_measuring(screen: Watched, device: FakeDevice) -> None:
    device.seconds = 20
    page = screen.open("/")
    expect(page.locator("#view-depth")).to_have_attribute("data-state", "live")
    page.click("#start")
    expect(page.locator("#progress")).to_be_visible()
    assert changes(page, "#overlay polyline.line", 3000) >= 6
    page.click("#cancel")
    expect(page.locator("#start")).to_be_visible()


def test_cancel_brings_the_button_back_and_keeps_nothing(screen: Watched, device: FakeDevice) -> None:
    device.seconds = 20
    page = screen.open("/")
    page.click("#start")
    page.get_by_role("button", name="Cancel").click()
    expect(page.locator("#start")).to_be_visible()
    expect(page.locator("#running")).to_be_hidden()
    assert screen.path == "/"
    assert device.surveys() == []


def test_a_measurement_that_fails_says_why_and_what_to_do(screen: Watched, device: FakeDevice) -> None:
    device.outcome = "failed"
    page = screen.open("/")
    page.click("#start")
    expect(page.locator("#failed")).to_have_text("The camera stopped sending pictures. Check its cable, then measure again.")
    expect(page.locator("#start")).to_be_visible()
    assert screen.path == "/"


def test_a_second_screen_sees_the_measurement_and_its_end(watch: Callable[..., Watched], device: FakeDevice) -> None:
    device.seconds = 3
    one, two = watch(), watch(1280, 800)
    one.open("/")
    two.open("/")
    one.page.click("#start")
    expect(two.page.locator("#running")).to_be_visible()
    two.page.wait_for_url("**/surveys/*")
    one.page.wait_for_url("**/surveys/*")
    assert one.path == two.path


def test_a_page_opened_during_a_measurement_joins_it(screen: Watched, device: FakeDevice) -> None:
    device.seconds = 2.5
    device.measure(None, None, None, None)
    page = screen.open("/")
    expect(page.locator("#running")).to_be_visible()
    page.wait_for_url("**/surveys/*")


def test_a_refusal_to_measure_is_said_in_words(screen: Watched, device: FakeDevice) -> None:
    page = screen.open("/")
    expect(page.locator("#view-depth")).to_have_attribute("data-state", "live")
    page.evaluate(
        "void (fetch = ((old) => (url, options) => old(url.endsWith('/measure') ? '/api/v1/none' : url, options))(fetch))"
    )
    page.click("#start")
    expect(page.locator("#failed")).to_be_visible()
    expect(page.locator("#failed")).to_have_text("There is nothing at this address.")
    expect(page.locator("#start")).to_be_enabled()
    screen.complaints.clear()  # the refused request itself is told in the console


def test_a_pipe_is_created_chosen_edited_and_measured(screen: Watched, device: FakeDevice) -> None:
    page = screen.open("/")
    expect(page.locator("#pipe-edit")).to_be_disabled()
    page.get_by_role("button", name="New").click()
    page.get_by_label("From manhole").fill("MH 14")
    page.get_by_label("To manhole").fill("MH 15")
    expect(page.locator("#pipe-check")).to_have_text("MH 14-MH 15 is free.")
    page.get_by_label("Material").select_option("concrete")
    page.get_by_label("Length, m").fill("41,5")
    page.get_by_label("DN on the map").fill("4oo")
    page.get_by_role("button", name="Save pipe").click()
    expect(page.locator("#pipe-error")).to_contain_text("DN on the map")
    page.get_by_label("DN on the map").fill("DN 400")
    page.get_by_role("button", name="Save pipe").click()
    expect(page.locator("#pipe-dialog")).to_be_hidden()
    expect(page.locator("#pipe option:checked")).to_have_text("MH 14-MH 15 · DN 400 · concrete")
    expect(page.locator("#reference")).to_have_text("map: DN 400")
    (pipe,) = device.places.pipes()
    names = {node["id"]: node["name"] for node in device.places.nodes()}
    assert (names[pipe["start_node"]], names[pipe["end_node"]]) == ("MH 14", "MH 15")

    assert pipe["length_m"] == 41.5

    page.get_by_role("button", name="Edit").click()
    expect(page.get_by_label("From manhole")).to_have_value("MH 14")
    page.get_by_label("DN on the map").fill("")
    page.get_by_role("button", name="Save pipe").click()
    expect(page.locator("#pipe option:checked")).to_have_text("MH 14-MH 15 · concrete")
    assert device.places.pipes()[0]["reference_dn"] is None
    assert len(device.places.nodes()) == 2

    page.get_by_label("Box stands at").select_option("entrance")
    page.click("#start")
    page.wait_for_url("**/surveys/*")
    assert device.measured == (pipe["id"], "entrance", None, None)
    expect(page.locator("#verdict")).to_contain_text("MH 14-MH 15")


def test_a_name_is_checked_while_it_is_typed_and_a_refused_pipe_leaves_nothing_behind(
    screen: Watched, device: FakeDevice
) -> None:
    nodes = [device.places.create_node(name)["id"] for name in ("MH 14", "MH 15")]
    device.places.create_pipe({"name": "MH 14-MH 15", "start_node": nodes[0], "end_node": nodes[1]})
    page = screen.open("/")
    page.get_by_role("button", name="New").click()
    check, name = page.locator("#pipe-check"), page.get_by_label("Pipe name")
    page.get_by_label("From manhole").fill("MH 14")
    page.get_by_label("To manhole").fill("MH 15")
    expect(check).to_have_text("There is already a pipe called MH 14-MH 15.")
    expect(check).to_have_attribute("data-state", "refused")
    expect(name).to_have_attribute("aria-invalid", "true")
    page.get_by_label("To manhole").fill("mh-15")
    expect(check).to_have_text("There is a manhole called MH 15: is mh-15 another one?")
    expect(name).to_have_attribute("placeholder", "MH 14-mh-15")
    page.get_by_label("To manhole").fill("MH 99")
    name.fill("MH 14-MH 15")
    expect(check).to_have_attribute("data-state", "refused")
    page.get_by_role("button", name="Save pipe").click()
    expect(page.locator("#pipe-error")).to_have_text("There is already a pipe called MH 14-MH 15.")
    assert len(device.places.pipes()) == 1
    assert len(device.places.nodes()) == 2, "no manhole is made for a pipe that is refused"
    name.fill("")
    expect(check).to_have_text("MH 14-MH 99 is free.")
    page.get_by_role("button", name="Save pipe").click()
    expect(page.locator("#pipe option:checked")).to_have_text("MH 14-MH 99")


def test_the_second_position_is_measured_in_the_same_survey(screen: Watched, device: FakeDevice) -> None:
    device.outcome = "second"
    page = screen.open("/")
    page.click("#start")
    page.wait_for_url("**/surveys/*")
    first = screen.path
    expect(page.locator("#verdict")).to_contain_text("Move the box to the middle of the pipe")
    device.outcome = "accept"
    page.get_by_role("link", name="Measure in the middle").click()
    expect(page.get_by_label("Box stands at")).to_have_value("middle")
    page.get_by_role("button", name="Measure in the middle").click()
    page.wait_for_url("**/surveys/*")
    assert screen.path == first
    expect(page.get_by_role("heading", name="ACCEPT")).to_be_visible()
    expect(page.get_by_role("heading", name="Recordings")).to_be_visible()
    assert device.measured == (None, "middle", None, int(first.rsplit("/", 1)[1]))


def test_a_lost_camera_is_shown_at_once_and_comes_back(screen: Watched, device: FakeDevice) -> None:
    page = screen.open("/")
    expect(page.locator("#view-depth")).to_have_attribute("data-state", "live")
    device.scene = "lost"
    expect(page.locator("#view-depth")).to_have_attribute("data-state", "lost")
    expect(page.locator("#depth-veil")).to_contain_text("Camera lost. Last good frame")
    expect(page.locator("#health-text")).to_have_text("Camera lost")
    expect(page.locator("#prompt-reason")).to_have_text("The camera stopped sending pictures.")
    expect(page.locator("#diameter")).to_have_text("–")
    expect(page.locator("#overlay")).to_be_hidden()
    expect(page.locator("#start")).to_be_disabled()
    before = page.locator("#camera-text").text_content()
    expect(page.locator("#camera-text")).not_to_have_text(before or "")  # the age of the last good frame goes on
    device.scene = "good"
    expect(page.locator("#view-depth")).to_have_attribute("data-state", "live")
    expect(page.locator("#start")).to_be_enabled()


def test_a_picture_that_stands_still_is_marked_old(screen: Watched, device: FakeDevice) -> None:
    page = screen.open("/")
    expect(page.locator("#view-depth")).to_have_attribute("data-state", "live")
    page.evaluate(
        "void (fetch = ((old) => (url, how) => url.includes('/picture/') ? new Promise(() => {}) : old(url, how))(fetch))"
    )
    expect(page.locator("#view-depth")).to_have_attribute("data-state", "stale")
    expect(page.locator("#depth-veil")).to_contain_text("Old picture")


def test_a_lost_connection_is_said_and_mends_itself(screen: Watched) -> None:
    first, second = FakeDevice(), FakeDevice()
    second.access = first.access  # sessions live on over a restart
    page = screen.page
    banner = page.locator("#link-lost")
    with served(create_app(first)) as port:  # type: ignore[arg-type]  # a fake with the facade's methods
        screen.root = f"http://127.0.0.1:{port}"
        screen.page.context.add_cookies([browser_cookie(pair(port), screen.root)])
        screen.open("/")
        expect(page.locator("#view-depth")).to_have_attribute("data-state", "live")
        expect(banner).to_be_hidden()
        first.close()
    expect(banner).to_be_visible(timeout=12_000)
    expect(banner).to_contain_text("Connection to the box lost")
    expect(page.locator("#view-depth")).to_have_attribute("data-state", "lost")
    expect(page.locator("#start")).to_be_disabled()
    expect(page.locator("#diameter")).to_have_text("–")
    with served(create_app(second), port=port):  # type: ignore[arg-type]  # a fake with the facade's methods
        expect(banner).to_be_hidden(timeout=12_000)
        expect(page.locator("#view-depth")).to_have_attribute("data-state", "live")
        expect(page.locator("#start")).to_be_enabled()
        page.goto("about:blank")
        second.close()
    screen.complaints.clear()  # failed requests are told in the console


def test_without_event_streams_the_page_polls(screen: Watched, device: FakeDevice) -> None:
    screen.page.add_init_script(POLLS)
    page = screen.open("/")
    assert page.evaluate("'EventSource' in window") is False
    expect(page.locator("#level-text")).to_have_text("Ready")
    assert changes(page, "#overlay polyline.line", 3000) >= 3
    page.click("#start")
    expect(page.locator("#running")).to_be_visible()
    page.wait_for_url("**/surveys/*", timeout=12_000)


def test_when_the_cap_is_reached_the_page_polls(watch: Callable[..., Watched], device: FakeDevice) -> None:
    watched = watch()
    watched.page.route(
        "**/api/v1/events*", lambda route: route.fulfill(status=503, json={"error": {"code": "unavailable", "message": "full"}})
    )
    page = watched.open("/")
    expect(page.locator("#level-text")).to_have_text("Ready")
    expect(page.locator("#link-lost")).to_be_hidden()
    watched.complaints.clear()  # the refused stream is told in the console


def test_the_browser_offers_its_time_once(screen: Watched, device: FakeDevice) -> None:
    screen.open("/")
    end = time.monotonic() + 5
    while not (offers := [value for name, value in device.calls if name == "set_clock"]) and time.monotonic() < end:
        time.sleep(0.05)
    assert len(offers) == 1
    assert abs(offers[0] / 1000 - time.time()) < 60


def test_colour_beside_depth_on_a_laptop_and_behind_a_switch_on_a_phone(watch: Callable[..., Watched]) -> None:
    laptop, phone = watch(1280, 800), watch()
    laptop.open("/")
    expect(laptop.page.locator("#view-color")).to_have_attribute("data-state", "live")
    expect(laptop.page.locator("#view-depth")).to_be_visible()
    phone.open("/")
    expect(phone.page.locator("#view-color")).to_be_hidden()
    phone.page.get_by_role("button", name="Colour").click()
    expect(phone.page.locator("#view-color")).to_have_attribute("data-state", "live")
    expect(phone.page.locator("#view-depth")).to_be_hidden()


def test_leaving_the_page_ends_its_stream(watch: Callable[..., Watched], device: FakeDevice) -> None:
    watched = watch()
    for _ in range(12):  # more than the cap: an old stream that stayed would lock the page out
        watched.open("/")
        expect(watched.page.locator("#level-text")).to_have_text("Ready")
