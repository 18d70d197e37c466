"""The result page and the history in a browser."""

import re

import pytest
from playwright.sync_api import expect

from tests.browser.conftest import Watched
from tests.browser.fake_device import FakeDevice, result


def test_the_drawings_are_drawn(screen: Watched, device: FakeDevice) -> None:
    page = screen.open(f"/surveys/{device.add_survey(None, None, 'top', 'accept')}")
    cross = page.locator("#cross svg")
    expect(cross).to_have_attribute("aria-label", re.compile("fitted circle of 398 millimetres.*300 of 360 degrees.*water 48"))
    assert cross.locator(".measured").count() >= 1
    assert cross.locator("circle.fit").count() == 1
    assert cross.locator("circle.ring").count() == 1
    assert cross.locator("path.water").count() == 2  # the water and its entry in the legend
    texts = cross.locator("text").all_text_contents()
    assert {str(hour) for hour in range(1, 13)} <= set(texts)
    assert "100 mm" in texts
    boxes = page.locator("#boxes svg")
    expect(boxes).to_have_attribute("aria-label", re.compile("^Box plot of 50 diameters: median 398"))
    assert boxes.locator("circle").count() == 50


@pytest.mark.parametrize("kind", ["color", "depth"])
def test_the_picture_is_the_one_of_the_measurement(screen: Watched, device: FakeDevice, kind: str) -> None:
    device.kept = ("color", "depth") if kind == "color" else ("depth",)
    asked: list[str] = []
    screen.page.on("request", lambda request: asked.append(request.url))
    number = device.add_survey(None, None, "top", "accept")
    page = screen.open(f"/surveys/{number}")
    page.wait_for_load_state("networkidle")
    expect(page.locator("#evidence figcaption")).to_have_text(re.compile("^At the measurement"))
    assert page.locator("#picture").evaluate("(image) => [image.naturalWidth, image.naturalHeight]") == [640, 360]
    pictures = [url for url in asked if "/picture/" in url]
    assert [url.partition("/api/v1")[2] for url in pictures] == [f"/surveys/{number}/picture/{kind}.jpg"]
    assert ("No colour picture was kept" in page.locator("#evidence").inner_text()) == (kind == "depth")


def test_where_no_picture_was_kept_it_is_said_and_no_other_is_shown(screen: Watched, device: FakeDevice) -> None:
    device.kept = ()
    asked: list[str] = []
    screen.page.on("request", lambda request: asked.append(request.url))
    page = screen.open(f"/surveys/{device.add_survey(None, None, 'top', 'accept')}")
    page.wait_for_load_state("networkidle")
    expect(page.locator("#no-picture")).to_have_text("No picture was kept with this measurement.")
    assert page.locator("#picture").count() == 0
    assert not [url for url in asked if "/picture/" in url]


def test_a_refused_survey_leaves_the_unseen_wall_open(screen: Watched, device: FakeDevice) -> None:
    page = screen.open(f"/surveys/{device.add_survey(None, None, 'top', 'retry')}")
    expect(page.get_by_role("heading", name="RETRY")).to_be_visible()
    paths = page.locator("#cross .measured")
    assert not any((d or "").endswith("Z") for d in [paths.nth(i).get_attribute("d") for i in range(paths.count())])
    expect(page.locator("#boxes")).to_contain_text("50 frames, 6 without a pipe")
    expect(page.locator("#verdict-accept")).to_be_disabled()


def test_the_cloud_comes_when_asked_for_and_turns(screen: Watched, device: FakeDevice) -> None:
    asked: list[str] = []
    screen.page.on("request", lambda request: asked.append(request.url))
    page = screen.open(f"/surveys/{device.add_survey(None, None, 'top', 'accept')}")
    page.wait_for_load_state("networkidle")
    assert not [url for url in asked if "cloud" in url]
    page.get_by_role("button", name="Show the point cloud").click()
    canvas = page.locator("#cloud canvas")
    expect(canvas).to_be_focused()
    first = canvas.evaluate("(c) => c.toDataURL()")
    page.keyboard.press("ArrowRight")
    turned = canvas.evaluate("(c) => c.toDataURL()")
    assert turned != first
    page.get_by_role("button", name="Turn left").click()
    assert canvas.evaluate("(c) => c.toDataURL()") != turned
    page.keyboard.press("Tab")
    canvas.focus()
    page.keyboard.press("Home")
    assert canvas.evaluate("(c) => c.toDataURL()") == first
    box = canvas.bounding_box()
    assert box is not None
    page.mouse.move(box["x"] + 100, box["y"] + 60)
    page.mouse.down()
    page.mouse.move(box["x"] + 160, box["y"] + 90)
    page.mouse.up()
    assert canvas.evaluate("(c) => c.toDataURL()") != first


def test_the_operators_answers_change_the_verdict_and_are_kept(screen: Watched, device: FakeDevice) -> None:
    number = device.add_survey(None, None, "top", "accept")
    page = screen.open(f"/surveys/{number}")
    page.locator("label[for=fit_aligned-no]").click()
    page.locator("label[for=image_good-yes]").click()
    page.locator("label[for=verdict-retry]").click()
    page.get_by_role("button", name="Save my answers").click()
    expect(page.locator("#answer-error")).to_contain_text("Your name")
    page.get_by_label("Your name").fill("Ann")
    page.get_by_label("Note").fill("cylinder stands off")
    page.get_by_role("button", name="Save my answers").click()
    expect(page.get_by_role("heading", name="RETRY")).to_be_visible()
    expect(page.locator("#verdict")).to_contain_text("refused by the operator")
    expect(page.locator("#record")).to_contain_text("retry")
    expect(page.locator(".said li")).to_have_text(["Ann: retry, “cylinder stands off”"])
    operator = device.survey(number)["operator"]
    assert operator["answers"] == {"image_good": True, "cloud_is_pipe": None, "fit_aligned": False}
    assert (operator["verdict"], operator["by"], operator["note"]) == ("retry", "Ann", "cylinder stands off")
    page.reload()
    expect(page.locator("#fit_aligned-no")).to_be_checked()
    expect(page.get_by_label("Your name")).to_have_value("Ann")


def test_deletion_asks_first_and_can_be_undone(screen: Watched, device: FakeDevice) -> None:
    number = device.add_survey(None, None, "top", "accept")
    page = screen.open(f"/surveys/{number}")
    page.get_by_role("button", name="Delete this survey").click()
    expect(page.get_by_role("dialog")).to_contain_text(f"Delete survey {number}?")
    page.get_by_role("button", name="Keep it").click()
    expect(page.get_by_role("dialog")).to_be_hidden()
    assert device.surveys()
    page.get_by_role("button", name="Delete this survey").click()
    page.get_by_role("button", name="Delete", exact=True).click()
    page.wait_for_url("**/surveys?deleted=*")
    expect(page.locator(".row")).to_have_count(0)
    assert device.surveys() == []
    page.get_by_role("button", name="Undo").click()
    page.wait_for_url("**/surveys")
    expect(page.locator(".row")).to_have_count(1)
    page.locator(".row").click()
    expect(page.get_by_role("heading", name="ACCEPT")).to_be_visible()


def test_the_history_is_filtered_by_pipe(screen: Watched, device: FakeDevice) -> None:
    elm = device.places.create_pipe(
        {"name": "Elm Road", "material": "clay", "shape": "circular", "reference_dn": None, "note": ""}
    )["id"]
    device.add_survey(None, elm, "top", "accept")
    device.add_survey(None, None, "top", "retry")
    page = screen.open("/surveys")
    expect(page.locator(".row")).to_have_count(2)
    expect(page.locator(".row").first).to_contain_text("unstable radius, aim")
    page.get_by_label("Pipe").select_option("Elm Road")
    expect(page.locator(".row")).to_have_count(1)
    expect(page.locator(".row")).to_contain_text("Elm Road")
    expect(page.locator(".row time")).not_to_have_text(re.compile("UTC"))  # times are shown in the reader's own zone


@pytest.mark.parametrize("path", ["/", "/surveys"])
def test_the_health_strip_opens_and_names_everything(screen: Watched, path: str) -> None:
    page = screen.open(path)
    expect(page.locator("#health-text")).to_have_text(re.compile("Box OK"))
    page.locator("#health summary").click()
    body = page.locator("#health-body")
    for words in ("Camera front (virtual) working", "3 dropped", "Storage: 11.8 GB free", "Clock set by a browser"):
        expect(body).to_contain_text(words)


def test_pure_functions_of_the_drawings(screen: Watched) -> None:
    page = screen.open("/surveys")
    box = page.evaluate("import('/static/js/box_plot.js').then((m) => m.boxNumbers([1, 2, 3, 4, 5, 6, 7, 8, 9, 40]))")
    assert box == {"lower": 3.25, "median": 5.5, "upper": 7.75, "low": 1, "high": 9, "outliers": [40]}
    near = page.evaluate("import('/static/js/box_plot.js').then((m) => m.extent([398, 399, 400], [395, 402]))")
    assert near[0] < 395
    assert near[1] > 402
    far = page.evaluate("import('/static/js/box_plot.js').then((m) => m.extent([299.5, 300, 300.5], [290, 310]))")
    assert 298 < far[0] < 299.5 < 300.5 < far[1] < 302, "a wide interval must not squeeze the frames into a line"
    ticks = page.evaluate("import('/static/js/box_plot.js').then((m) => m.ticks(395.2, 401.1).values)")
    assert ticks == [396, 398, 400]
    runs = page.evaluate("import('/static/js/cross_section.js').then((m) => m.seenRuns([0, 90, 180, 270], [1, null, 3, 4]))")
    assert runs == {"runs": [[[180, 3], [270, 4], [0, 1]]], "closed": False}
    whole = page.evaluate("import('/static/js/cross_section.js').then((m) => m.seenRuns([0, 120, 240], [1, 1, 1]).closed)")
    assert whole is True
    assert page.evaluate("import('/static/js/cross_section.js').then((m) => [12, 3, 6, 9].map(m.clockAngle))") == [
        270,
        0,
        90,
        180,
    ]
    lines = page.evaluate(
        """import('/static/js/cloud.js')
             .then((m) => m.wireframe({axis: [0, 0, 2], point: [0, 0, 1], radius: 0.5, from: 0, to: 1}))"""
    )
    ring = lines[0]
    assert all(abs((x * x + y * y) ** 0.5 - 0.5) < 1e-9 and abs(z - 1) < 1e-9 for x, y, z in ring)
    assert all(abs(z - 2) < 1e-9 for _, _, z in lines[6])
    seen = page.evaluate(
        """import('/static/js/cloud.js').then((m) => m.seenLength({
             points: Array.from({length: 101}, (_, i) => [1, 0, i / 100]), inlier: Array(101).fill(1),
             cylinder: {axis: [0, 0, 1], point: [0, 0, 0.5]}}))"""
    )
    assert seen == pytest.approx({"from": -0.48, "to": 0.48})
    one = page.evaluate(
        "import('/static/js/box_plot.js').then((m) => m.boxPlot([{diameter_mm: 200}], null).getAttribute('aria-label'))"
    )
    assert one.startswith("Box plot of 1 diameters: median 200.0")
    assert page.evaluate("import('/static/js/box_plot.js').then((m) => m.boxPlot([{diameter_mm: null}], null))") is None


def test_a_finding_without_a_pipe_is_shown_in_words(screen: Watched, device: FakeDevice) -> None:
    number = device.add_survey(None, None, "top", "retry")
    empty = dict.fromkeys(("diameter_mm", "interval_mm", "radius_std_mm", "dn", "reference", "profile", "mean_mm"))
    frames = [dict.fromkeys(("diameter_mm", "inlier_share", "mse_mm2", "orientation"))] * 3
    device.survey(number)["result"] = {
        **result("retry"),
        **empty,
        "inlier_weighted_mean_mm": None,
        "frames": frames,
        "proxies": {},
    }
    page = screen.open(f"/surveys/{number}")
    expect(page.locator("#boxes")).to_have_text("No frame gave a diameter.")
    expect(page.locator("#cross")).to_have_text("No cross-section.")
