"""The Drive page in a browser: start, watch, mark, end, and what happens when things go wrong."""

import re
from collections.abc import Callable

import pytest
from playwright.sync_api import Page, Route, expect

from tests.browser.conftest import Watched
from tests.browser.fake_device import FakeDevice
from tests.browser.fake_drive import LENGTH_M, SLIP
from tests.waiting import wait_until
from web_ui.wording import CLASSES

POLLS = "(() => { window.EventSource = undefined; delete window.EventSource; })()"


def begin(watched: Watched, device: FakeDevice, speed: float = 4.0) -> Page:
    """The page with a drive just started on it."""
    device.drive.metres_per_second = speed
    page = watched.open("/drive")
    expect(page.locator("#start")).to_be_enabled()
    page.click("#start")
    expect(page.locator("#pause")).to_be_visible()
    return page


def a_pipe(device: FakeDevice, name: str = "MH 14-MH 15") -> int:
    number: int = device.places.create_pipe(
        {"name": name, "material": "concrete", "shape": "circular", "reference_dn": 300, "note": ""}
    )["id"]
    return number


def test_pipe_and_direction_are_chosen_before_the_start(screen: Watched, device: FakeDevice) -> None:
    pipe = a_pipe(device)
    page = screen.open("/drive")
    expect(page.locator("nav a[aria-current]")).to_have_text("Drive")
    expect(page.locator("#view-cctv")).to_have_attribute("data-state", "live")
    expect(page.locator("#prompt-reason")).to_have_text("Ready.")
    expect(page.locator("#map")).to_be_hidden()
    page.select_option("#pipe", str(pipe))
    page.locator("label[for=direction-up]").click()
    page.locator(".more summary").click()
    page.get_by_label("Inner radius, mm").fill("1O5")
    page.click("#start")
    expect(page.locator("#failed")).to_have_text("Inner radius: a number above 0, or nothing.")
    page.get_by_label("Inner radius, mm").fill("152,5")
    page.get_by_label("Chainage now, m").fill("1.5")
    page.click("#start")
    expect(page.locator("#pause")).to_be_visible()
    expect(page.locator("#setup")).to_be_hidden()
    assert ("start_drive", (pipe, "upstream", pytest.approx(0.1525), 1.5)) in device.calls


def test_chainage_landmarks_and_map_go_with_the_crawler(screen: Watched, device: FakeDevice) -> None:
    page = begin(screen, device, 6.0)
    expect(page.locator(".lm-row").filter(has_text="1 Connection")).to_contain_text("passed")
    row = page.locator(".lm-row").filter(has_text="3 Deposit")
    expect(row).to_contain_text("14.10 to 17.90 m ± 4 cm · 5:10 to 6:55")
    expect(row).to_contain_text("31 hits, 4 misses")
    expect(row.locator("img")).to_have_js_property("naturalWidth", 540)
    expect(page.locator("#speed")).to_have_text("6.00")
    expect(page.locator("#sigma")).to_have_text("± 1 cm")
    expect(page.locator("#counts-line")).to_have_text(re.compile(r"^\d found, \d perhaps$"))
    assert float(page.inner_text("#chainage")) > 12
    drawn = page.locator(".unrolled .landmark")
    expect(drawn.and_(page.locator("[data-id='3']")).locator(".extent")).to_have_count(2)  # it lies across the cut
    expect(page.locator(".unrolled .crawler")).to_have_count(1)
    expect(page.locator(".unrolled .joint").nth(3)).to_be_attached(timeout=12_000)  # they come with the map, now and then
    tops = [int(number) for number in page.locator(".lm-row").evaluate_all("(rows) => rows.map((row) => row.dataset.id)")]
    assert tops == sorted(tops, reverse=True), "what was seen last comes first"


def test_pause_resume_and_end_with_the_length(screen: Watched, device: FakeDevice) -> None:
    page = begin(screen, device, 10.0)
    expect(page.locator(".lm-row").first).to_be_visible()
    page.get_by_role("button", name="Pause").click()
    expect(page.locator("#prompt-reason")).to_have_text("Paused: nothing is mapped.")
    expect(page.locator("#speed")).to_have_text("0.00")
    stands = page.inner_text("#chainage")
    page.wait_for_timeout(400)
    assert page.inner_text("#chainage") == stands
    page.get_by_role("button", name="Resume").click()
    expect(page.locator("#chainage")).not_to_have_text(stands)
    page.get_by_role("button", name="End node").click()
    page.get_by_label("Length node to node, m").fill("-3")
    page.get_by_role("button", name="End", exact=True).click()
    expect(page.locator("#end-error")).to_have_text("Length: a number above 0, or nothing.")
    page.get_by_label("Length node to node, m").fill("42.5")
    page.get_by_role("button", name="End", exact=True).click()
    expect(page.locator("#finish-bar")).to_be_visible()
    page.wait_for_url("**/surveys/*")
    assert ("end_drive", 42.5) in device.calls
    expect(page.locator("#found-count")).to_contain_text("landmark")


def test_a_mark_by_hand(screen: Watched, device: FakeDevice) -> None:
    page = begin(screen, device, 0.4)
    page.get_by_role("button", name="Mark", exact=True).click()
    dialog = page.get_by_role("dialog")
    dialog.get_by_role("button", name="Mark", exact=True).click()
    expect(page.locator("#mark-error")).to_have_text("Choose what it is.")
    dialog.get_by_text("Other").click()
    page.get_by_label("What it is").fill("liner wrinkle")
    dialog.get_by_label("Clock").select_option("4:30")
    dialog.get_by_label("Note").fill("look again")
    dialog.get_by_role("button", name="Mark", exact=True).click()
    expect(dialog).to_be_hidden()
    row = page.locator(".lm-row").filter(has_text="Liner wrinkle")
    expect(row).to_contain_text("4:30")
    expect(row).to_contain_text("marked by hand")
    page.get_by_role("button", name="Mark", exact=True).click()
    dialog.get_by_text("Roots").click()
    dialog.get_by_role("button", name="Mark", exact=True).click()
    expect(page.locator(".lm-row").filter(has_text="Roots")).to_contain_text("clock not known")
    expect(page.locator(".unrolled .unknown-clock")).to_have_count(1)
    marks = device.drive.map(device.drive.state()["survey_id"])["landmarks"]
    assert [(row["class"], row["clock"], row["note"]) for row in marks if row["marked_by_hand"]] == [
        ("liner wrinkle", 4.5, "look again"),
        ("roots", None, ""),
    ]


def test_cancelling_asks_first_and_leaves_nothing(screen: Watched, device: FakeDevice) -> None:
    page = begin(screen, device)
    page.get_by_role("button", name="Cancel").click()
    page.get_by_role("button", name="Drive on").last.click()
    assert device.drive.state()["state"] == "driving"
    page.get_by_role("button", name="Cancel").click()
    page.get_by_role("button", name="Cancel it").click()
    expect(page.locator("#start")).to_be_visible()
    expect(page.locator("#announce")).to_have_text("The drive was cancelled.")
    expect(page.locator("#failed")).to_be_hidden()
    expect(page.locator(".lm-row")).to_have_count(0)
    assert device.surveys() == []


def test_prompts_name_reason_and_remedy(screen: Watched, device: FakeDevice) -> None:
    device.drive.prompts = [SLIP]
    page = begin(screen, device)
    expect(page.locator("#prompt-reason")).to_have_text(SLIP["reason"])
    expect(page.locator("#prompt-remedy")).to_have_text(SLIP["remedy"])
    expect(page.locator("#prompt")).to_have_attribute("data-level", "fair")
    device.drive.prompts = []
    expect(page.locator("#prompt-reason")).to_have_text(re.compile("^Mapping"))
    device.drive.befall("encoder_jump", "The counter jumped by -3.00 m; the way goes on from where it was.")
    expect(page.locator("#toast")).to_contain_text("The counter jumped")


def test_lost_sensors_are_told_with_the_age_of_the_last_good_frame(screen: Watched, device: FakeDevice) -> None:
    page = begin(screen, device)
    expect(page.locator("#view-cctv")).to_have_attribute("data-state", "live")
    device.drive.grabber |= {"state": "lost", "age_s": 7.0, "message": "The stream is gone; trying again."}
    expect(page.locator("#view-cctv")).to_have_attribute("data-state", "lost")
    expect(page.locator("#cctv-veil")).to_have_text(re.compile(r"^CCTV lost\. Last good frame 7\.\d s ago\.$"))
    expect(page.locator("#prompt-reason")).to_have_text("The CCTV picture is lost.")
    expect(page.locator("#prompt-remedy")).to_have_text("The stream is gone; trying again.")
    expect(page.locator("#announce")).to_have_text("CCTV lost.")
    device.drive.grabber |= {"state": "up", "age_s": 0.03, "message": ""}
    expect(page.locator("#view-cctv")).to_have_attribute("data-state", "live")
    device.drive.encoder |= {"state": "lost", "age_s": 3.0, "message": "It was unplugged."}
    expect(page.locator("#encoder-chip")).to_have_attribute("data-state", "bad")
    expect(page.locator("#encoder-text")).to_have_text(re.compile(r"^Counter lost, 3\.\d s ago$"))


def test_the_state_between_drives_stays_fresh(watch: Callable[..., Watched], device: FakeDevice) -> None:
    page = watch().open("/drive")
    expect(page.locator("#view-cctv")).to_have_attribute("data-state", "live")
    device.drive.encoder |= {"state": "lost", "age_s": 3.0}
    expect(page.locator("#encoder-text")).to_have_text(re.compile("^Counter lost"))


def test_the_overlay_is_switched(screen: Watched, device: FakeDevice) -> None:
    asked: list[str] = []
    screen.page.on("request", lambda request: asked.append(request.url))
    page = screen.open("/drive")
    expect(page.locator("#view-cctv")).to_have_attribute("data-state", "live")
    pictures = [url for url in asked if "picture.jpg" in url]
    assert pictures
    assert all("overlay=1" in url for url in pictures)
    with page.expect_response(lambda response: "overlay=0" in response.url and response.status == 200):
        page.get_by_role("button", name="Overlay").click()
    expect(page.locator("#overlay-button")).to_have_attribute("aria-pressed", "false")


RED_PIXELS = """(picture) => {
  const canvas = document.createElement("canvas");
  [canvas.width, canvas.height] = [picture.naturalWidth ?? picture.width, picture.naturalHeight ?? picture.height];
  const pen = canvas.getContext("2d");
  pen.drawImage(picture, 0, 0);
  const data = pen.getImageData(0, 0, canvas.width, canvas.height).data;
  let count = 0;
  for (let k = 0; k < data.length; k += 4) count += data[k] > 200 && data[k + 1] < 110 && data[k + 2] < 110;
  return count;
}"""


def test_a_heatmap_is_chosen_and_given_up(screen: Watched, device: FakeDevice) -> None:
    page = screen.open("/drive")
    expect(page.locator("#view-cctv")).to_have_attribute("data-state", "live")
    choice = page.get_by_label("Heatmap of the network")
    assert choice.locator("option").all_inner_texts() == ["No heatmap", *(f"Heat: {name}" for name in CLASSES)]
    assert page.locator("#cctv").evaluate(RED_PIXELS) == 0
    with page.expect_response(lambda response: "heatmap=displaced%20joint" in response.url and response.status == 200):
        choice.select_option("displaced joint")
    wait_until(lambda: page.locator("#cctv").evaluate(RED_PIXELS) > 1000)
    with page.expect_response(lambda response: "picture.jpg" in response.url and "heatmap" not in response.url):
        choice.select_option("")
    wait_until(lambda: page.locator("#cctv").evaluate(RED_PIXELS) == 0)


def test_the_counter_is_set_zeroed_and_calibrated(screen: Watched, device: FakeDevice) -> None:
    page = screen.open("/drive")
    page.locator("#counter-details summary").click()
    counts = page.get_by_label("Counts per metre")
    expect(counts).to_have_value("1000")
    counts.fill("many")
    page.get_by_role("button", name="Set", exact=True).click()
    expect(page.locator("#counter-error")).to_have_text("Counts per metre: a number above 0.")
    counts.fill("987.5")
    page.get_by_label("Counts run").select_option("down going in")
    page.get_by_role("button", name="Set", exact=True).click()
    expect(page.locator("#toast")).to_have_text("The counter is set.")
    assert (device.drive.encoder["counts_per_metre"], device.drive.encoder["direction"]) == (987.5, -1)
    page.get_by_role("button", name="Zero here").click()
    expect(page.locator("#toast")).to_have_text("The chainage is zero here.")
    assert device.drive.encoder["zero"] == 1200.0
    expect(page.get_by_role("button", name="End here")).to_be_disabled()
    page.get_by_role("button", name="Start here").click()
    expect(page.locator("#calibrate-step")).to_contain_text("First point is set")
    page.get_by_role("button", name="End here").click()
    expect(page.locator("#counter-error")).to_have_text("Length driven: a number above 0.")
    page.get_by_label("Length driven, m").fill("20")
    page.get_by_role("button", name="End here").click()
    expect(page.locator("#toast")).to_have_text("The counter is calibrated.")
    expect(counts).to_have_value("500")
    page.click("#start")
    expect(page.locator("#counter-busy")).to_be_visible()
    expect(page.get_by_role("button", name="Zero here")).to_be_disabled()


def test_a_box_without_a_grabber_says_so(screen: Watched, device: FakeDevice) -> None:
    device.drive.available = False
    device.drive.grabber = None  # type: ignore[assignment]  # as the device states it
    device.drive.encoder = None  # type: ignore[assignment]
    device.drive.state = lambda: {**idle, "grabber": None, "encoder": None, "available": False}  # type: ignore[method-assign]
    idle = {
        "state": "idle", "survey_id": None, "pipe_id": None, "direction": "downstream", "chainage_m": None, "sigma_m": None,
        "speed_mps": None, "seconds": 0.0, "frames": 0, "dropped": 0, "fps": 0.0, "prompts": [], "progress": None,
        "counts": {"candidate": 0, "confirmed": 0, "passed": 0},
    }  # fmt: skip
    page = screen.open("/drive")
    expect(page.get_by_role("heading", name="No CCTV grabber")).to_be_visible()
    expect(page.locator("#start")).to_be_disabled()
    expect(page.locator("#counter")).to_be_hidden()
    expect(page.locator("#cctv-veil")).to_have_text("No CCTV grabber.")
    expect(page.locator("#prompt-remedy")).to_have_text("Set up its crawler first.")


def test_a_drive_cut_off_is_offered(screen: Watched, device: FakeDevice) -> None:
    number = device.drive.add(None, "interrupted")
    page = screen.open("/drive")
    expect(page.locator("#cut-off")).to_contain_text("The last drive was cut off.")
    page.get_by_role("link", name=f"survey {number}").click()
    page.wait_for_url(f"**/surveys/{number}")
    expect(page.locator("#cut-off")).to_contain_text("cut off before its end")


def test_a_page_opened_in_the_middle_of_a_drive_shows_all_of_it(screen: Watched, device: FakeDevice) -> None:
    device.drive.metres_per_second = 30.0
    device.drive.begin(None)
    page = screen.open("/drive")
    expect(page.locator("#pause")).to_be_visible()
    expect(page.locator(".lm-row")).to_have_count(7)
    page.get_by_role("button", name="Whole").click()
    expect(page.locator(".unrolled .landmark")).to_have_count(7)
    expect(page.locator("#map-follow")).to_have_attribute("aria-pressed", "false")


def test_what_was_found_before_the_stream_began_is_shown(screen: Watched, device: FakeDevice) -> None:
    def when_all_is_found(route: Route) -> None:
        wait_until(lambda: device.drive.state()["chainage_m"] == LENGTH_M)
        route.continue_()

    device.drive.metres_per_second = 30.0
    screen.page.route("**/api/v1/events*", when_all_is_found)
    device.drive.begin(None)
    page = screen.open("/drive")
    expect(page.locator(".lm-row")).to_have_count(7, timeout=3000)  # before the map is asked for again anyway


def test_without_a_stream_the_page_asks(watch: Callable[..., Watched], device: FakeDevice) -> None:
    watched = watch()
    watched.page.add_init_script(POLLS)
    page = begin(watched, device, 8.0)
    expect(page.locator("#chainage")).to_have_text(re.compile(r"^[1-9]"))
    expect(page.locator(".lm-row").first).to_be_visible(timeout=12_000)


def test_a_landmark_is_judged_while_the_crawler_drives_on(screen: Watched, device: FakeDevice) -> None:
    page = begin(screen, device, 4.0)
    page.locator(".lm-row").filter(has_text="1 Connection").click()
    expect(page.locator("#landmark-dialog")).to_be_visible()
    page.locator("#lm-note").fill("half a sen")
    page.wait_for_timeout(500)
    expect(page.locator("#lm-note")).to_have_value("half a sen")  # what comes in meanwhile leaves the form alone
    page.get_by_role("button", name="Confirm", exact=True).click()
    expect(page.locator("#lm-confirm")).to_have_attribute("aria-pressed", "true")
    page.locator("#lm-close").click()
    expect(page.locator(".lm-row[data-id='1']")).to_contain_text("confirmed by hand")
