"""What must hold for gloves, sunlight, keyboards and screen readers, on every page in every state."""

from collections.abc import Callable
from typing import Any

import pytest
from playwright.sync_api import Page, expect

from tests.browser.conftest import Watched
from tests.browser.fake_device import FakeDevice
from tests.browser.test_alone import NIGHT

STATES = [
    "/",
    "/ poor",
    "/ lost",
    "/ measuring",
    "/ dialog",
    "/surveys",
    "/surveys empty",
    "/surveys/accept",
    "/surveys/retry",
    "/drive",
    "/drive driving",
    "/drive mark",
    "/drive counter",
    "/surveys/map",
    "/surveys/map landmark",
    "/surveys/map 3d",
    "/alone",
    "/health",
    "/nothing",
    "/site",
    "/site dialog",
]
CONTRAST_OF = """() => {
  const parse = (text) => (text.match(/[\\d.]+/g) ?? [0, 0, 0, 0]).map(Number);
  const light = ([r, g, b]) => {
    const part = (v) => ((v /= 255) <= 0.03928 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4);
    return 0.2126 * part(r) + 0.7152 * part(g) + 0.0722 * part(b);
  };
  const ground = (element) => {
    for (let at = element; at; at = at.parentElement) {
      const colour = parse(getComputedStyle(at).backgroundColor);
      if ((colour[3] ?? 1) > 0.5) return colour;
    }
    return [255, 255, 255];
  };
  const poor = [];
  const seen = (element) => element.checkVisibility({ visibilityProperty: true });
  for (const element of document.querySelectorAll("body *")) {
    const own = [...element.childNodes].some((node) => node.nodeType === 3 && node.textContent.trim());
    if (!own || element.closest("svg, option, script, .veil") || !seen(element)) continue;
    if (element.closest(":disabled") || element.closest("label")?.control?.disabled) continue;
    const [a, b] = [light(parse(getComputedStyle(element).color)), light(ground(element))];
    const ratio = (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05);
    if (ratio < 4.5) poor.push(`${element.tagName} "${element.textContent.trim().slice(0, 30)}" ${ratio.toFixed(2)}`);
  }
  return poor;
}"""
SMALL_TARGETS = """() => {
  const small = [];
  const fields = "button, select, textarea, input:not([type=radio])";
  for (const element of document.querySelectorAll(`${fields}, a.button, nav a, .brand, summary, .choice label, a.row`)) {
    if (!element.checkVisibility({ visibilityProperty: true })) continue;
    const box = element.getBoundingClientRect();
    if (box.height < 47.5 || box.width < 43.5) small.push(`${element.id || element.className} ${box.width}x${box.height}`);
  }
  return small;
}"""
NAMED = "button, a, select, textarea, input, [role=img], canvas, dialog, nav, progress"
NAMELESS = """(named) => [...document.querySelectorAll(named)]
  .filter((element) => element.checkVisibility())
  .filter((element) => !(element.textContent.trim() || element.labels?.length))
  .filter((element) => !["aria-label", "aria-labelledby"].some((name) => element.getAttribute(name)))
  .map((element) => element.outerHTML.slice(0, 80))"""


def show(watched: Watched, device: FakeDevice, name: str) -> Page:
    path, _, state = name.partition(" ")
    pipe = device.places.create_pipe(
        {"name": "P" * 80, "material": "ductile iron", "shape": "egg", "reference_dn": 1100, "note": ""}
    )["id"]
    if path == "/surveys/map":
        device.drive.befall("slip", "The counter stands still but the picture moves.")
        path = f"/surveys/{device.drive.add(pipe)}"
    elif path.startswith("/surveys/"):
        path = f"/surveys/{device.add_survey(None, pipe, 'top', path.rsplit('/', 1)[1])}"
    elif path == "/surveys" and not state:
        device.add_survey(None, pipe, "top", "accept")
        device.add_survey(None, pipe, "top", "second")
        device.drive.add(pipe, "interrupted")
        path = "/surveys?deleted=9"
    elif path == "/alone":
        device.journal, device.logs_by_itself, device.held = NIGHT, True, ("The disk was nearly full.",)
    elif path == "/site":
        nodes = [device.places.create_node(f"M{n}", easting=565000.25 + 40 * n, northing=5933000.5)["id"] for n in (1, 2)]
        device.places.create_pipe({"name": "M1-M2", "start_node": nodes[0], "end_node": nodes[1], "length_m": 40})
        path = "/site?deleted=9"
    if state in ("poor", "lost"):
        device.scene = state
    page = watched.open(path)
    if path == "/":
        expect(page.locator("#level-text")).to_have_text({"poor": "Not yet", "lost": "Unknown"}.get(state, "Ready"))
        page.select_option("#pipe", str(pipe))
    if state == "measuring":
        device.seconds = 30
        page.click("#start")
        expect(page.locator("#running")).to_be_visible()
    if path == "/drive":
        device.drive.add(pipe, "interrupted")
        expect(page.locator("#view-cctv")).to_have_attribute("data-state", "live")
        page.select_option("#pipe", str(pipe))
    if state in ("driving", "mark"):
        device.drive.metres_per_second = 20
        page.click("#start")
        expect(page.locator(".lm-row").first).to_be_visible()
    if state == "mark":
        page.click("#mark")
    if state == "counter":
        page.click("#counter-details summary")
    if state == "landmark":
        page.locator(".lm-row[data-id='5']").click()
        page.click("#lm-confirm")
        expect(page.locator("#lm-undo")).to_be_visible()
    if state == "3d":
        page.click("#pipe3d-show")
        expect(page.locator("#pipe3d canvas")).to_be_focused()
    if state == "dialog" and path == "/":
        page.click("#pipe-edit")
    elif state == "dialog":
        page.get_by_role("button", name="M1", exact=True).click()
        expect(page.locator("#node-check")).to_have_text("M1 is free.")
    expect(page.locator("#health-text")).not_to_have_text("Box")
    if path == "/nothing":
        watched.complaints.clear()  # the missing page itself is told in the console
    return page


@pytest.mark.parametrize("name", STATES)
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_readable_reachable_and_named(watch: Callable[..., Watched], device: FakeDevice, name: str, scheme: str) -> None:
    page = show(watch(360, 740, color_scheme=scheme), device, name)
    width = page.evaluate("document.documentElement.scrollWidth")
    assert width <= 360, "nothing may be scrolled sideways at 360 px"
    assert page.evaluate(CONTRAST_OF) == []
    assert page.evaluate(SMALL_TARGETS) == []
    assert page.evaluate(NAMELESS, NAMED) == []
    for landmark in ("banner", "navigation", "main"):
        assert page.get_by_role(landmark).count() == 1, landmark  # type: ignore[arg-type]  # a role


def test_no_sideways_scroll_when_text_is_large(watch: Callable[..., Watched], device: FakeDevice) -> None:
    page = show(watch(360, 740), device, "/")
    page.evaluate("document.documentElement.style.fontSize = '130%'")
    assert page.evaluate("document.documentElement.scrollWidth") <= 360


def test_the_page_is_worked_by_keyboard_alone(watch: Callable[..., Watched], device: FakeDevice) -> None:
    device.seconds = 30
    device.places.create_pipe({"name": "A", "material": "clay", "shape": "circular", "reference_dn": None, "note": ""})
    page = watch(1280, 800).open("/")
    expect(page.locator("#level-text")).to_have_text("Ready")
    page.keyboard.press("Tab")
    expect(page.locator(".skip")).to_be_focused()
    seen: list[str] = []
    for _ in range(20):
        page.keyboard.press("Tab")
        focused: dict[str, Any] = page.evaluate(
            """() => { const e = document.activeElement, s = getComputedStyle(e);
                       return { id: e.id, ring: s.outlineStyle !== 'none' && parseFloat(s.outlineWidth) >= 2 }; }"""
        )
        assert focused["ring"], f"the focus on {focused['id']} must be seen"
        seen.append(focused["id"])
        if focused["id"] == "start":
            break
    assert seen[-1] == "start"
    assert {"pipe", "position", "pipe-new"} <= set(seen)
    page.keyboard.press("Enter")
    expect(page.locator("#cancel")).to_be_focused()
    page.keyboard.press("Enter")
    expect(page.locator("#start")).to_be_focused()


def test_the_dialog_keeps_and_gives_back_the_focus(watch: Callable[..., Watched]) -> None:
    page = watch().open("/")
    page.focus("#pipe-new")
    page.keyboard.press("Enter")
    expect(page.get_by_label("From manhole")).to_be_focused()
    page.keyboard.press("Escape")
    expect(page.locator("#pipe-dialog")).to_be_hidden()
    expect(page.locator("#pipe-new")).to_be_focused()


def test_changes_are_spoken(watch: Callable[..., Watched], device: FakeDevice) -> None:
    page = watch().open("/")
    assert page.get_attribute("#prompt", "aria-live") == "polite"
    assert page.get_attribute("#link-lost", "role") == "alert"
    assert page.get_attribute("#diameter", "aria-live") == "off", (
        "a number that changes four times a second must not be read out"
    )
    device.seconds = 30
    page.click("#start")
    expect(page.locator("#announce")).to_contain_text("Hold the box still")
    page.click("#cancel")
    expect(page.locator("#announce")).to_contain_text("cancelled")
    device.scene = "lost"
    expect(page.locator("#announce")).to_have_text("Camera lost.")


def test_a_screen_reader_is_not_flooded_while_aiming(watch: Callable[..., Watched], device: FakeDevice) -> None:
    page = watch().open("/")
    expect(page.locator("#level-text")).to_have_text("Ready")
    spoken = page.evaluate(
        """async () => { let n = 0; const o = new MutationObserver(() => (n += 1));
            const all = { subtree: true, childList: true, characterData: true };
            for (const e of document.querySelectorAll('[aria-live=polite], [role=alert]')) o.observe(e, all);
            await new Promise((r) => setTimeout(r, 2500)); return n; }"""
    )
    assert spoken == 0
