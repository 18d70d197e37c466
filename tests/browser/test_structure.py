"""The Structure page in a browser: start, watch the map grow, end, look at it, take it away."""

from __future__ import annotations

import json
from collections.abc import Callable

import pytest
from playwright.sync_api import expect

from tests.browser.conftest import Watched
from tests.browser.fake_device import FakeDevice
from tests.browser.test_accessibility import CONTRAST_OF, NAMED, NAMELESS, SMALL_TARGETS


def test_a_chamber_grows_on_the_page_and_leads_to_its_map(screen: Watched, device: FakeDevice) -> None:
    device.places.create_node("Pump station 4")
    page = screen.open("/structure")
    expect(page.locator("#prompt-reason")).to_have_text("Ready.")
    expect(page.locator(".chamber-panel")).to_be_hidden()
    page.select_option("#node", label="Pump station 4")
    page.click("#start")
    expect(page.locator("#setup")).to_be_hidden()
    expect(page.locator("#pipes")).to_have_text("12")
    expect(page.locator("#chamber-rows tr")).to_have_count(20)
    expect(page.locator("#unsure li").first).to_contain_text("Tee 3: tee or elbow")
    expect(page.locator("#unsure")).to_contain_text("Whether Socket 20 sits on pipe")
    expect(page.locator("#next-view-text")).to_contain_text("it would tell what object 3 is")
    expect(page.locator("#sensors li")).to_have_count(4)
    canvas = page.locator("#chamber3d canvas")
    drawn = "(canvas) => new Set(canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height).data).size"
    assert canvas.evaluate(drawn) > 60, "pipes are shaded"
    canvas.focus()
    before = canvas.evaluate("(canvas) => canvas.toDataURL()")
    page.keyboard.press("ArrowLeft")
    assert canvas.evaluate("(canvas) => canvas.toDataURL()") != before
    assert page.evaluate("document.documentElement.scrollWidth <= window.innerWidth"), "nothing sticks out"

    page.click("#end")
    page.wait_for_url("**/surveys/901")
    expect(page.locator("#summary-title")).to_have_text("Pump station 4")
    expect(page.locator(".prompt .reason")).to_contain_text("The AHRS said nothing for 24 s.")
    expect(page.locator("#chamber-graph .edge")).not_to_have_count(0)
    with page.expect_download() as waited:
        page.get_by_role("link", name="JSON graph").click()
    graph = json.loads(waited.value.path().read_text(encoding="utf-8"))
    assert len(graph["nodes"]) == 32


def test_cancel_asks_first_and_forgets(screen: Watched, device: FakeDevice) -> None:
    device.structure.prompts = [
        {
            "code": "adrift",
            "reason": "The box no longer knows well where it is.",
            "remedy": "Go back to where pipes are in view.",
        }
    ]
    page = screen.open("/structure")
    page.click("#start")
    expect(page.locator("#prompt-reason")).to_have_text("The box no longer knows well where it is.")
    page.click("#cancel")
    page.get_by_role("button", name="Cancel it").click()
    expect(page.locator("#start")).to_be_visible()
    expect(page.locator("#toast")).to_have_text("The survey was cancelled.")
    assert device.structure.maps == {}


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_it_can_be_read_and_reached_at_360_px(watch: Callable[..., Watched], device: FakeDevice, scheme: str) -> None:
    page = watch(360, 740, color_scheme=scheme).open("/structure")
    page.click("#start")
    expect(page.locator("#pipes")).to_have_text("12")
    expect(page.locator("#chamber-rows tr")).to_have_count(20)
    assert page.evaluate("document.documentElement.scrollWidth") <= 360
    assert page.evaluate(CONTRAST_OF) == []
    assert page.evaluate(SMALL_TARGETS) == []
    assert page.evaluate(NAMELESS, NAMED) == []
