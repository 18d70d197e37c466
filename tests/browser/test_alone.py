"""The page of what happened while nobody looked, and the line that leads to it."""

from playwright.sync_api import expect

from tests.browser.conftest import Watched
from tests.browser.fake_alone import line
from tests.browser.fake_device import FakeDevice

NIGHT = (
    line(1, "on", at="2026-05-01T18:00:00Z"),
    line(2, "begin", 7, "pipe_seen", "2026-05-01T18:10:00Z"),
    line(3, "end", 7, "node", "2026-05-01T18:25:00Z"),
    line(4, "begin", 8, "moved", "2026-05-01T18:40:00Z"),
    line(5, "end", 8, "power_cut", "2026-05-01T18:44:00Z"),
    line(6, "cut", 8),
    line(7, "on"),
    line(8, "begin", 9, "power_back"),
    line(9, "end", 9, "standstill"),
    line(10, "held", None, "disk"),
)


def test_it_is_switched_on_and_off_at_the_page(screen: Watched, device: FakeDevice) -> None:
    page = screen.open("/alone")
    state, button = page.locator("#alone-state"), page.locator("#alone-switch")
    expect(state).to_have_text("Off: surveys begin when somebody says so.")
    button.click()
    expect(state).to_have_text("Waits for a pipe to come into view.")
    expect(button).to_have_attribute("aria-pressed", "true")
    assert device.logs_by_itself
    device.held = ("The disk was nearly full.",)
    expect(page.locator("#alone-holds li")).to_have_text("The disk was nearly full.")  # told by the status
    button.click()
    expect(button).to_have_text("Off: log by itself")
    assert not device.logs_by_itself


def test_whoever_comes_is_led_to_what_happened_and_reads_it_once(screen: Watched, device: FakeDevice) -> None:
    device.journal = NIGHT
    page = screen.open("/surveys")
    news = page.locator("#news")
    expect(news).to_have_text("8 things happened while nobody looked")
    news.get_by_role("link").click()
    assert screen.path == "/alone"
    expect(page.locator("#news")).to_be_hidden()
    facts = page.locator(".facts div")
    told = [facts.nth(k).inner_text().split("\n") for k in range(facts.count())]
    assert told == [["Surveys", "3"], ["Power cuts", "1"], ["Surveys held back", "1 time"], ["Unsafe shutdowns, ever", "1"]]
    rows = page.locator(".entries li")
    expect(rows).to_have_count(10)
    expect(rows.first).to_contain_text("No survey was begun any more. The disk was nearly full.")
    page.get_by_role("link", name="Survey 8").first.focus()
    page.locator("#alone-read").click()
    expect(page.locator(".entries .new")).to_have_count(0)
    expect(page.locator("#alone-read")).to_have_count(0)
    assert device.looked == 10
    page = screen.open("/surveys")
    expect(page.locator("#health-text")).not_to_have_text("Box")  # the status has come
    expect(page.locator("#news")).to_be_hidden()
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")
