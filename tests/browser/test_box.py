"""The page of the box's health and the lamp's slider, as an operator uses them."""

from playwright.sync_api import Page, expect

from tests.browser.conftest import Watched
from tests.browser.fake_device import FakeDevice


def test_what_matters_is_said_with_its_remedy_and_goes_when_it_is_over(screen: Watched, device: FakeDevice) -> None:
    device.clock_source = "rtc"
    page = screen.open("/health")
    expect(page.locator("#concerns")).to_contain_text("Nothing. The box is well.")
    expect(page.locator("#sensors li")).to_have_count(2)
    expect(page.locator("#sensors")).to_contain_text("Depth camera working")
    expect(page.locator("#machine")).to_contain_text("11.8 GB of 29.5 GB")
    expect(page.locator("#machine")).to_contain_text("Intel RealSense D435")
    device.concerns = ("under_voltage", "hot")
    expect(page.locator("#concerns li")).to_have_count(2, timeout=8000)
    expect(page.locator("#concerns li").first).to_contain_text("Charge or change the power bank")
    expect(page.locator("#health-text")).to_have_text("Low voltage")
    page.locator("#health summary").click()
    expect(page.locator("#health-body")).to_contain_text("The box is getting hot.")
    page.get_by_role("link", name="Everything about the box").click()
    expect(page).to_have_url(screen.root + "/health")
    device.concerns = ()
    expect(page.locator("#concerns")).to_contain_text("Nothing. The box is well.", timeout=8000)
    assert screen.complaints == []
    assert screen.foreign == []


def slide(page: Page, to: int) -> None:
    page.locator("#lamp-level").fill(str(to))
    page.locator("#lamp-level").dispatch_event("change")


def test_the_slider_sets_the_lamp_and_a_tap_makes_it_automatic_again(screen: Watched, device: FakeDevice) -> None:
    for path in ("/health", "/drive"):
        device.set_up_box()
        page = screen.open(path)
        expect(page.locator("#lamp-text")).to_have_text("Follows the exposure of the picture.")
        slide(page, 75)
        expect(page.locator("#lamp-text")).to_have_text("Stays as it is set.")
        expect(page.locator("#lamp-percent")).to_have_text("75 %")
        assert device.lamp()["level"] == 0.75
        page.get_by_role("button", name="Automatic").click()
        expect(page.locator("#lamp-auto")).to_have_attribute("aria-pressed", "true")
        assert device.lamp()["automatic"] is True
    assert screen.complaints == []


def test_a_box_without_a_lamp_shows_none(screen: Watched, device: FakeDevice) -> None:
    device.lamp_state = None
    page = screen.open("/drive")
    expect(page.locator("#lamp")).to_have_count(0)
    assert screen.complaints == []
