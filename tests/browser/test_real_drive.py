"""The Drive page over the real device: a crawler on the bench goes through a textured pipe, from Start to the deleted map."""

import re
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from playwright.sync_api import expect

from tests.browser.conftest import Watched
from tests.browser.fake_device import FakeDevice
from tests.browser.serving import served
from tests.browser.test_real_device import missing, shape
from tests.hil.crawler_rig import Bench, Thing
from web_ui.app import create_app

PATIENCE_MS = 60_000
THINGS = (Thing("connection", 1.5, -2.4), Thing("roots", 2.6, 0.2))


@pytest.fixture
def box(tmp_path: Path) -> Iterator[Bench]:
    bench = Bench(tmp_path / "data", THINGS)
    bench.up()
    bench.moving = False
    yield bench
    bench.close()


@pytest.fixture
def root(box: Bench) -> Iterator[str]:
    """In place of the fake's: the pages over the real device."""
    with served(create_app(box.device)) as port:
        yield f"http://127.0.0.1:{port}"
        box.device.end_streams()


def test_from_start_to_a_deleted_map(watch: Callable[..., Watched], box: Bench) -> None:
    page = watch().open("/drive")
    expect(page.locator("#view-cctv")).to_have_attribute("data-state", "live", timeout=PATIENCE_MS)
    page.locator("#counter-details summary").click()
    page.get_by_role("button", name="Zero here").click()
    expect(page.locator("#toast")).to_have_text("The chainage is zero here.")
    page.get_by_role("button", name="Start", exact=True).click()
    expect(page.locator("#pause")).to_be_visible()
    expect(page.locator("#list-empty")).to_have_text("Nothing found yet.")
    box.moving = True
    expect(page.locator(".lm-row").filter(has_text="Connection")).to_contain_text("passed", timeout=PATIENCE_MS)
    row = page.locator(".lm-row").filter(has_text="Connection")
    expect(row.locator("img")).to_be_visible(timeout=PATIENCE_MS)
    row.click()
    page.get_by_role("button", name="Confirm", exact=True).click()
    expect(page.locator("#lm-confirm")).to_have_attribute("aria-pressed", "true")
    page.locator("#lm-close").click()
    expect(page.locator(".lm-row").filter(has_text="Roots")).to_contain_text("passed", timeout=PATIENCE_MS)
    page.get_by_role("button", name="Mark", exact=True).click()
    page.get_by_role("dialog").get_by_text("Deposit").click()
    page.get_by_role("dialog").get_by_role("button", name="Mark", exact=True).click()
    expect(page.locator(".lm-row").filter(has_text="Deposit")).to_contain_text("marked by hand")
    page.get_by_role("button", name="End node").click()
    page.get_by_role("button", name="End", exact=True).click()
    page.wait_for_url("**/surveys/*", timeout=PATIENCE_MS)
    box.moving = False
    expect(page.locator("#found-count")).to_have_text("3 landmarks")
    rows = page.locator(".lm-row")
    expect(rows.nth(0)).to_have_text(re.compile(r"Connection.*confirmed by hand.*1\.[3-7]\d m"))
    expect(rows.nth(1)).to_have_text(re.compile(r"Roots.*2\.[4-8]\d m"))
    page.get_by_role("button", name="Delete this survey").click()
    page.get_by_role("button", name="Delete", exact=True).click()
    page.get_by_role("button", name="Undo").click()
    expect(page.locator(".row")).to_contain_text("3 landmarks")


def test_the_device_keeps_what_the_fake_promises_of_a_drive(box: Bench) -> None:
    """Every key the pages were developed against is there in the real answers."""
    fake, device = FakeDevice(), box.device
    survey_id = device.drive.begin()["survey_id"]
    fake_id = fake.drive.begin()["survey_id"]
    box.wait(lambda: device.drive.state()["chainage_m"] is not None)
    device.drive.mark("roots", 4.5, "seen")
    fake.drive.mark("roots", 4.5, "seen")
    events = {"fake": fake.subscribe(), "real": device.subscribe()}
    told = {}
    for whose, subscription in events.items():
        while whose not in told:
            event = subscription.get(10.0)
            assert event is not None
            if event.name == "drive" and event.data["state"] == "driving":
                told[whose] = event.data
    pairs = {
        "drive": (fake.drive.state(), device.drive.state()),
        "event": ({**told["fake"], "landmarks": None}, told["real"]),
        "map": ({**fake.drive.map(fake_id), "faults": [], "rings": []}, device.drive.map(survey_id)),
        "encoder": (fake.drive.encoder, device.drive.state()["encoder"]),
    }
    device.drive.end()
    box.finished()
    pairs["survey"] = (fake.survey(fake.drive.add()), device.survey(survey_id))
    pairs["surveys"] = (fake.surveys()[0], device.surveys()[0])
    fake.close()
    for name, (promised, kept) in pairs.items():
        assert kept, name
        if isinstance(promised, dict):
            promised = {key: value for key, value in promised.items() if value is not None and value != []}
        lacking = missing(shape(promised), shape(kept), name)
        assert [key for key in lacking if ".belief." not in key] == []  # a belief is by class: its keys are no promise
