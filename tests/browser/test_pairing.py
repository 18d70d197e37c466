"""Pairing, and the control of the box between two phones."""

from collections.abc import Callable, Iterator

import pytest
from playwright.sync_api import Browser, Page, expect

from device.access import control
from tests.browser.conftest import SIZES, Watched
from tests.browser.fake_device import FakeDevice
from tests.browser.test_accessibility import CONTRAST_OF, NAMED, NAMELESS, SMALL_TARGETS
from tests.pairing import PIN

REFUSALS = ("401", "403", "409", "429")
"""Statuses that the browser tells of in its console, as it must."""


@pytest.fixture
def stranger(chromium: Browser, root: str) -> Iterator[Callable[..., Page]]:
    """Make a page of somebody who is not paired: `stranger(size)`. Its console may tell of refusals, and of nothing else."""
    made: list[Watched] = []

    def make(size: str = "phone") -> Page:
        width, height = SIZES[size]
        context = chromium.new_context(viewport={"width": width, "height": height}, has_touch=size == "phone")
        context.set_default_timeout(8000)
        made.append(Watched(context.new_page(), root))
        return made[-1].page

    yield make
    for watched in made:
        watched.page.context.close()
        assert watched.foreign == [], "a request left the box"
        assert [text for text in watched.complaints if not any(status in text for status in REFUSALS)] == []


def assert_readable(page: Page) -> None:
    """At 360 px: nothing to scroll sideways, contrast, targets for gloves, names for screen readers."""
    page.set_viewport_size({"width": 360, "height": 740})
    assert page.evaluate("document.documentElement.scrollWidth") <= 360
    assert page.evaluate(CONTRAST_OF) == []
    assert page.evaluate(SMALL_TARGETS) == []
    assert page.evaluate(NAMELESS, NAMED) == []


def pair(page: Page, pin: str = PIN) -> None:
    page.get_by_label("PIN").press_sequentially(pin)


@pytest.mark.parametrize("size", SIZES)
def test_the_pin_opens_the_page_that_was_asked_for(stranger: Callable[..., Page], root: str, size: str) -> None:
    page = stranger(size)
    page.goto(f"{root}/surveys")
    expect(page.get_by_role("heading", name="Pair with this box")).to_be_visible()
    expect(page.get_by_label("PIN")).to_be_focused()
    expect(page.get_by_role("navigation")).to_have_count(0)
    pair(page)
    expect(page.get_by_role("heading", name="History")).to_be_visible()
    assert page.url == f"{root}/surveys"
    page.goto(f"{root}/")
    expect(page.locator("#level-text")).to_have_text("Ready")


def test_wrong_pins_are_told_with_the_time_to_wait(stranger: Callable[..., Page], root: str) -> None:
    page = stranger()
    page.goto(f"{root}/pair")
    button, failed = page.locator("#pair"), page.locator("#pair-failed")
    for _ in range(2):
        pair(page, "000000")
        expect(failed).to_contain_text("not the PIN on the label")
        expect(button).to_be_enabled()
    pair(page, "000001")
    expect(failed).to_contain_text("Try again in 2 s")
    expect(button).to_be_disabled()
    expect(button).to_contain_text("wait")
    expect(button).to_be_enabled()  # by itself, when the time is over
    expect(failed).to_contain_text("You may try again now")
    assert_readable(page)
    page.get_by_label("PIN").fill("12 3x4")
    expect(page.get_by_label("PIN")).to_have_value("1234")
    page.get_by_label("PIN").fill("")
    pair(page)
    expect(page.locator("#level-text")).to_have_text("Ready")


def test_control_is_asked_for_handed_over_and_taken_back(
    stranger: Callable[..., Page], root: str, device: FakeDevice, monkeypatch: pytest.MonkeyPatch
) -> None:
    first, second = stranger(), stranger("laptop")
    for page in (first, second):
        page.goto(f"{root}/")
        pair(page)
        expect(page.locator("#level-text")).to_have_text("Ready")
    expect(first.locator("#control")).to_be_hidden()
    expect(second.locator("#control")).to_contain_text("controls the box; this device watches")
    assert_readable(second)
    second.click("#start")
    expect(second.locator(".failed:visible").first).to_contain_text("ask for the control first")
    assert not any(name == "measure" for name, _ in device.calls)

    second.get_by_role("button", name="Ask for the control").click()
    expect(second.locator("#control")).to_contain_text("without an answer it comes here in")
    expect(first.locator("#control")).to_contain_text("asks for the control")
    first.get_by_role("button", name="Keep it").click()
    expect(second.locator("#control")).to_contain_text("this device watches")
    second.get_by_role("button", name="Ask for the control").click()
    expect(second.locator("#control-failed")).to_contain_text("ask again in")

    monkeypatch.setattr(control, "CONSENT_S", 1.0)
    device.access._control._refused.clear()
    second.get_by_role("button", name="Ask for the control").click()
    expect(second.locator("#control")).to_be_hidden()  # nobody answered
    expect(first.locator("#control")).to_contain_text("this device watches")
    second.click("#start")
    expect(second.locator("#running")).to_be_visible()


def test_who_is_sent_away_sees_the_pairing_page(stranger: Callable[..., Page], root: str) -> None:
    first, second = stranger(), stranger("laptop")
    for page in (first, second):
        page.goto(f"{root}/")
        pair(page)
        expect(page.locator("#level-text")).to_have_text("Ready")
    first.goto(f"{root}/pair")
    expect(first.locator("#paired li")).to_have_count(2)
    assert_readable(first)
    first.get_by_role("button", name="away").click()
    expect(first.locator("#paired li")).to_have_count(1)
    expect(second.get_by_role("heading", name="Pair with this box")).to_be_visible(timeout=15_000)
    first.get_by_role("button", name="Unpair this device").click()
    expect(first.get_by_role("heading", name="Pair with this box")).to_be_visible()
