"""The map of a finished drive in a browser: unrolled, in 3-D, as a list, and what people say of a landmark."""

import re
from collections.abc import Callable
from typing import Any

import pytest
from playwright.sync_api import Page, expect

from tests.browser.conftest import Watched
from tests.browser.fake_device import FakeDevice


@pytest.fixture
def number(device: FakeDevice) -> int:
    pipe = device.places.create_pipe(
        {"name": "Elm Road", "material": "clay", "shape": "circular", "reference_dn": 300, "note": ""}
    )
    device.drive.befall("encoder_lost", "The tether encoder failed: nothing comes.")
    return device.drive.add(pipe["id"])


def range_of(page: Page) -> tuple[float, float]:
    low, high = re.findall(r"[-\d.]+", page.inner_text("#map-scale"))
    return float(low), float(high)


def middle_of(page: Page) -> tuple[float, float]:
    box = page.locator(".unrolled").bounding_box()
    assert box is not None
    return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2


def test_the_history_lists_drives_in_one_line(screen: Watched, device: FakeDevice, number: int) -> None:
    device.add_survey(None, None, "top", "accept")
    device.drive.add(None, "interrupted")
    page = screen.open("/surveys")
    rows = page.locator(".row")
    expect(rows).to_have_count(3)
    expect(rows.nth(0)).to_contain_text("cut off before its end")
    expect(rows.nth(1)).to_contain_text("DN 400")
    expect(rows.nth(2)).to_have_text(re.compile(r"Map\s+7 landmarks\s+0\.0 to 42\.0 m\s+Elm Road"))
    rows.nth(2).click()
    expect(page.get_by_role("heading", name="Elm Road")).to_be_visible()


def test_the_page_says_what_was_found_and_what_went_wrong(screen: Watched, number: int) -> None:
    page = screen.open(f"/surveys/{number}")
    expect(page.locator(".summary-line")).to_have_text("7 landmarks from 0.0 to 42.0 m, downstream")
    facts = page.locator(".map-summary .facts")
    for words in ("500, 3 dropped", "worked out from the whole drive", "150 mm", "61.20 ± 0.80 px m", "1.0040 ± 0.0020"):
        expect(facts).to_contain_text(words)
    expect(page.locator("#faults tbody tr")).to_have_text(re.compile(r"12 s\s*–\s*The tether encoder failed: nothing comes\."))
    expect(page.locator("#legend li")).to_have_count(7)


def test_the_unrolled_map_has_the_crown_in_the_middle(screen: Watched, number: int) -> None:
    page = screen.open(f"/surveys/{number}")
    expect(page.locator(".unrolled .landmark")).to_have_count(7)
    tall = page.viewport_size is not None and page.viewport_size["width"] < 640
    places: dict[str, Any] = page.evaluate(
        """() => { const at = (e) => { const b = e.getBoundingClientRect(); return [b.x + b.width / 2, b.y + b.height / 2]; };
            const wall = document.querySelector('.unrolled .wall').getBoundingClientRect();
            const symbol = (id) => at(document.querySelector(`.landmark[data-id='${id}'] use`));
            return { wall: [wall.x, wall.y, wall.width, wall.height], two: symbol(1), ten: symbol(2), joint: symbol(4) }; }"""
    )
    left, top, width, height = places["wall"]
    axis, origin, breadth = (0, left, width) if tall else (1, top, height)
    # 12 in the middle, 2 o'clock two twelfths of the girth on, 10 o'clock as much before; chainage at right angles to it
    assert (places["two"][axis] - origin) / breadth == pytest.approx(8 / 12, abs=0.02)
    assert (places["ten"][axis] - origin) / breadth == pytest.approx(4 / 12, abs=0.02)
    assert (places["joint"][axis] - origin) / breadth == pytest.approx(0.5, abs=0.02)
    assert places["two"][1 - axis] < places["ten"][1 - axis] < places["joint"][1 - axis]
    hours = [text for text in page.locator(".unrolled > text").all_text_contents() if text in ("6", "9", "12", "3")]
    assert hours[:5] == ["6", "9", "12", "3", "6"]


def test_the_map_is_zoomed_and_moved(screen: Watched, number: int) -> None:
    page = screen.open(f"/surveys/{number}")
    whole = range_of(page)
    assert whole[0] <= 0
    assert whole[1] > 42
    page.get_by_role("button", name="Zoom in").click()
    near = range_of(page)
    assert near[1] - near[0] == pytest.approx((whole[1] - whole[0]) / 1.6, abs=0.15)
    page.locator(".unrolled").focus()
    page.keyboard.press("ArrowRight")
    assert range_of(page)[0] > near[0]
    for _ in range(20):
        page.keyboard.press("+")
    assert range_of(page)[1] - range_of(page)[0] == pytest.approx(1.0, abs=0.11)
    page.keyboard.press("Home")
    assert range_of(page) == whole
    page.get_by_role("button", name="Zoom in").click()
    before = range_of(page)
    middle = middle_of(page)
    page.mouse.move(*middle)
    page.mouse.down()
    page.mouse.move(middle[0] - 60, middle[1] - 60, steps=4)
    page.mouse.up()
    assert range_of(page)[0] > before[0]
    page.get_by_role("button", name="Whole").click()
    assert range_of(page) == whole
    page.mouse.move(*middle_of(page))
    page.keyboard.down("Control")
    page.mouse.wheel(0, -300)
    page.keyboard.up("Control")
    expect(page.locator("#map-scale")).not_to_have_text(re.compile(r"^0\.0 to 42\.8"))


def test_two_fingers_zoom_the_map(watch: Callable[..., Watched], number: int) -> None:
    page = watch(390, 844, has_touch=True).open(f"/surveys/{number}")
    whole = range_of(page)
    page.get_by_role("button", name="Zoom in").click()
    before = range_of(page)
    x, y = middle_of(page)
    session = page.context.new_cdp_session(page)

    def touch(kind: str, apart: float) -> None:
        points = [] if kind == "touchEnd" else [{"x": x, "y": y - apart, "id": 0}, {"x": x, "y": y + apart, "id": 1}]
        session.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})

    touch("touchStart", 30)
    for apart in (40, 60, 90, 120):
        touch("touchMove", apart)
    touch("touchEnd", 0)
    after = range_of(page)
    assert after[1] - after[0] < 0.5 * (before[1] - before[0])
    assert whole[0] < after[0] < after[1] < whole[1]
    expect(page.locator("#landmark-dialog")).to_be_hidden()


@pytest.mark.parametrize("where", ["list", "map"])
def test_a_landmark_opens_from_list_and_map(screen: Watched, number: int, where: str) -> None:
    page = screen.open(f"/surveys/{number}")
    expect(page.locator(".unrolled .landmark")).to_have_count(7)
    if where == "list":
        page.locator(".lm-row[data-id='5']").click()
    else:
        box = page.locator(".landmark[data-id='5'] use").bounding_box()
        assert box is not None
        page.mouse.click(box["x"] + 8, box["y"] + 12)
    expect(page.get_by_role("dialog")).to_be_visible()
    expect(page.locator("#lm-title")).to_have_text("5 Fracture")
    for words in ("24.60 to 26.30 m", "11:10 to 12:35", "± 4 cm, ± 6 min of the clock", "31 hits, 4 misses"):
        expect(page.locator("#lm-facts")).to_contain_text(words)
    expect(page.locator(".bar-row")).to_have_text([re.compile("Fracture.*71 %"), re.compile("Nothing there.*29 %")])
    expect(page.locator("#lm-figure img")).to_have_js_property("naturalWidth", 540)
    expect(page.locator("#lm-said li")).to_have_text(["Box: fracture, 71 %"])
    page.keyboard.press("Escape")
    expect(page.get_by_role("dialog")).to_be_hidden()


def test_the_picture_of_a_landmark_shows_what_the_network_sees(screen: Watched, number: int) -> None:
    page = screen.open(f"/surveys/{number}")
    page.locator(".lm-row[data-id='5']").click()
    picture, heat = page.locator("#lm-figure img"), page.get_by_role("button", name="What the network sees")
    expect(heat).to_have_attribute("aria-pressed", "false")
    plain = picture.get_attribute("src")
    with page.expect_response(lambda response: "thumbnail.jpg?heatmap=fracture" in response.url and response.status == 200):
        heat.click()
    expect(heat).to_have_attribute("aria-pressed", "true")
    expect(picture).to_have_attribute("alt", "Picture of landmark 5, bright where the network sees fracture")
    heat.click()
    expect(picture).to_have_attribute("src", plain or "")


def test_confirm_reject_and_undo(screen: Watched, device: FakeDevice, number: int) -> None:
    page = screen.open(f"/surveys/{number}")
    row = page.locator(".lm-row[data-id='6']")
    row.click()
    page.get_by_label("Your name").fill("Ann")
    page.get_by_role("button", name="Reject", exact=True).click()
    expect(page.locator("#lm-reject")).to_have_attribute("aria-pressed", "true")
    expect(row).to_contain_text("rejected")
    expect(page.locator("#found-count")).to_have_text("6 landmarks")
    expect(page.locator(".landmark[data-id='6']")).to_have_attribute("data-rejected", "yes")
    page.get_by_role("button", name="Undo").click()
    expect(page.locator("#lm-undo")).to_be_hidden()
    expect(page.locator("#lm-confirm")).to_be_focused()
    expect(page.locator("#found-count")).to_have_text("7 landmarks")
    page.get_by_role("button", name="Confirm", exact=True).click()
    expect(row).to_contain_text("confirmed by hand")
    said = page.locator("#lm-said li")
    expect(said).to_have_text(["Box: roots, 64 %", "Ann: rejected", "Ann: decision taken back", "Ann: confirmed"])
    changes = [call[1][2] for call in device.calls if call[0] == "change_landmark"]
    assert changes == [{"decision": word, "by": "Ann"} for word in ("rejected", None, "confirmed")]
    page.reload()
    page.locator(".lm-row[data-id='6']").click()
    expect(page.get_by_label("Your name")).to_have_value("Ann")
    expect(page.locator("#lm-confirm")).to_have_attribute("aria-pressed", "true")


def test_a_correction_moves_the_landmark_and_keeps_what_was_measured(screen: Watched, device: FakeDevice, number: int) -> None:
    page = screen.open(f"/surveys/{number}")
    page.locator(".lm-row[data-id='1']").click()
    chainage = page.get_by_label("Chainage, m")
    chainage.fill("about 4")
    page.get_by_role("button", name="Save", exact=True).click()
    expect(page.locator("#lm-error")).to_have_text("Chainage: a number of metres, or nothing.")
    chainage.fill("4,25")
    page.locator("#lm-class").fill("roots")
    page.locator("#lm-clock").select_option("3:30")
    page.locator("#lm-note").fill("a lateral\nwith roots")
    page.get_by_role("button", name="Save", exact=True).click()
    expect(page.get_by_role("dialog")).to_be_hidden()
    row = page.locator(".lm-row[data-id='1']")
    expect(row).to_contain_text("1 Roots")
    expect(row).to_contain_text("4.25 m")
    expect(row).to_contain_text("3:30")
    expect(row).to_contain_text("corrected")
    kept = device.drive.map(number)["landmarks"][0]
    assert (kept["class"], kept["chainage_m"], kept["clock"]) == ("connection", 3.42, 2.0)
    assert kept["corrected"] == {"class": "roots", "chainage_m": 4.25, "clock": 3.5}
    row.click()
    expect(page.locator("#lm-facts")).to_contain_text("connection, 3.42 m, 2:00")
    expect(chainage).to_have_value("4.25")
    expect(page.locator("#lm-said li").last).to_contain_text("class roots, chainage 4.25 m, clock 3:30, “a lateral")
    chainage.fill("")
    page.get_by_role("button", name="Save", exact=True).click()
    expect(page.get_by_role("dialog")).to_be_hidden()
    change = next(call[1][2] for call in reversed(device.calls) if call[0] == "change_landmark")
    assert change == {"chainage_m": None, "by": ""}, "only what changed is said"
    expect(row).to_contain_text("3.42 m")


def test_the_list_is_filtered_by_class_and_status(screen: Watched, number: int) -> None:
    page = screen.open(f"/surveys/{number}")
    expect(page.locator(".lm-row")).to_have_count(7)
    page.locator("#filter-class").select_option("connection")
    expect(page.locator(".lm-row")).to_have_count(3)
    expect(page.locator("#list-count")).to_have_text("3 of 7")
    page.locator("#filter-status").select_option("candidate")
    expect(page.locator(".lm-row")).to_have_count(0)
    expect(page.locator("#list-empty")).to_have_text("None of this kind.")
    page.locator("#filter-status").select_option("passed")
    page.locator("#filter-class").select_option("deposit")
    expect(page.locator(".lm-row")).to_have_text(re.compile("^3 Deposit"))


def test_the_pipe_in_3d_comes_when_asked_for(screen: Watched, number: int) -> None:
    asked: list[str] = []
    screen.page.on("request", lambda request: asked.append(request.url))
    page = screen.open(f"/surveys/{number}")
    page.wait_for_load_state("networkidle")
    assert not [url for url in asked if "pipe3d" in url]
    page.get_by_role("button", name="Show the pipe in 3-D").click()
    canvas = page.locator("#pipe3d canvas")
    expect(canvas).to_be_focused()
    first = canvas.evaluate("(c) => c.toDataURL()")
    page.keyboard.press("ArrowRight")
    turned = canvas.evaluate("(c) => c.toDataURL()")
    assert turned != first
    page.keyboard.press("Home")
    assert canvas.evaluate("(c) => c.toDataURL()") == first
    page.keyboard.press("PageDown")
    assert canvas.evaluate("(c) => c.toDataURL()") != first
    page.get_by_label("Length shown").select_option("Whole")
    expect(page.get_by_label("Along the pipe", exact=True)).to_be_disabled()
    blue = "(c) => { const d = c.getContext('2d').getImageData(0, 0, c.width, c.height).data; const w = c.width;"
    place = canvas.evaluate(
        blue
        + """ for (let i = 0; i < d.length; i += 4) if (d[i] > 85 && d[i] < 125 && d[i + 1] > 150 && d[i + 2] > 235)
                return [(i / 4) % w / w, Math.floor(i / 4 / w) / c.height]; return null; }"""
    )
    assert place is not None, "a connection must be seen in its colour"
    box = canvas.bounding_box()
    assert box is not None
    page.mouse.click(box["x"] + place[0] * box["width"], box["y"] + place[1] * box["height"] + 4)
    expect(page.locator("#lm-title")).to_contain_text("Connection")


def test_the_printed_page_is_the_whole_map_without_buttons(screen: Watched, number: int) -> None:
    page = screen.open(f"/surveys/{number}")
    for _ in range(3):
        page.get_by_role("button", name="Zoom in").click()
    page.evaluate("window.dispatchEvent(new Event('beforeprint'))")
    page.emulate_media(media="print")
    expect(page.locator(".unrolled .landmark")).to_have_count(7)
    assert page.locator("button:visible").evaluate_all("(all) => all.filter((b) => !b.matches('.lm-row')).length") == 0
    assert page.locator(".unrolled").get_attribute("viewBox") == "0 0 1000 420"
    page.emulate_media(media="screen")
    page.evaluate("window.dispatchEvent(new Event('afterprint'))")
    assert page.locator(".unrolled .landmark").count() < 7


def test_a_drive_is_deleted_and_brought_back(screen: Watched, device: FakeDevice, number: int) -> None:
    page = screen.open(f"/surveys/{number}")
    page.get_by_role("button", name="Delete this survey").click()
    page.get_by_role("button", name="Delete", exact=True).click()
    page.wait_for_url("**/surveys?deleted=*")
    assert device.surveys() == []
    page.get_by_role("button", name="Undo").click()
    page.wait_for_url("**/surveys")
    page.locator(".row").click()
    expect(page.locator(".unrolled .landmark")).to_have_count(7)


def test_an_empty_map_says_so(screen: Watched, device: FakeDevice, number: int) -> None:
    device.drive.map(number).update(landmarks=[], rings=[], from_m=None, to_m=None, focal_radius=None, scale=None, faults=[])
    page = screen.open(f"/surveys/{number}")
    expect(page.locator("#found-count")).to_have_text("No landmarks")
    expect(page.locator("#list-empty")).to_have_text("Nothing found yet.")
    expect(page.locator(".faults-panel")).to_contain_text("None.")


def test_pure_functions_of_the_map(screen: Watched) -> None:
    page = screen.open("/surveys")

    def ask(module: str, expression: str) -> Any:
        return page.evaluate(f"import('/static/js/{module}.js').then((m) => {expression})")

    assert ask("unrolled_map", "[6, 9, 12, 3, 5.999].map(m.across)") == pytest.approx([0, 0.25, 0.5, 0.75, 1], abs=1e-3)
    assert ask("unrolled_map", "m.parts(11, 2)") == [pytest.approx([5 / 12, 7 / 12])]
    assert ask("unrolled_map", "m.parts(5, 2)") == [pytest.approx([11 / 12, 1]), pytest.approx([0, 1 / 12])]
    assert ask("unrolled_map", "m.clampView({from: -5, to: 5}, {low: 0, high: 42})") == {"from": 0, "to": 10}
    assert ask("unrolled_map", "m.clampView({from: 40, to: 140}, {low: 0, high: 42})") == {"from": 0, "to": 42}
    assert ask("drive_words", "[12, 0.41, 11.99, 1, 2.5, null].map(m.clockText)") == [
        "12:00",
        "12:25",
        "12:00",
        "1:00",
        "2:30",
        "–",
    ]
    assert ask("drive_words", "[m.clockReach(11, 1), m.clockReach(5, 7), m.clockReach(12, 11.9), m.clockReach(3, 3)]") == [
        pytest.approx(2),
        pytest.approx(2),
        0,
        0,
    ]
    assert ask("numbers", "[m.readNumber(' 4,5 '), m.readNumber(''), Number.isNaN(m.readNumber('4x'))]") == [
        4.5,
        None,
        True,
    ]
    moved = ask(
        "drive_words",
        """m.shown({chainage_m: 2, chainage_to_m: 5, clock: 11, clock_to: 1, class: 'deposit', status: 'passed', decision: null,
                    corrected: {chainage_m: 3, clock: 5.5}})""",
    )
    assert (moved["chainage_m"], moved["chainage_to_m"], moved["clock"], moved["clock_to"]) == (3, 6, 5.5, 7.5)
    angles = ask("pipe3d", "[3, 6, 9, 12].map((hour) => m.onWall(0, m.angleOf(hour)))")
    assert [[round(x, 6) + 0.0, round(y, 6) + 0.0] for x, y, _ in angles] == [[1, 0], [0, 1], [-1, 0], [0, -1]]
