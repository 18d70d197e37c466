"""The pages over the real device, workers and store, with cameras on the bench: what the fake promises, the device keeps."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import expect

from tests.browser.conftest import Watched
from tests.browser.fake_device import FakeDevice
from tests.browser.serving import served
from tests.hil.rig import PATIENCE_S, Bench, PipeCamera
from web_ui.app import create_app

PATIENCE_MS = PATIENCE_S * 1000


@pytest.fixture
def camera(request: pytest.FixtureRequest) -> PipeCamera:
    return PipeCamera("front", radius_m=getattr(request, "param", 0.1))


@pytest.fixture
def box(camera: PipeCamera, tmp_path: Path) -> Iterator[Bench]:
    bench = Bench(tmp_path / "data", camera).up()
    yield bench
    bench.close()


@pytest.fixture
def root(box: Bench) -> Iterator[str]:
    """In place of the fake's: the pages over the real device."""
    with served(create_app(box.device)) as port:
        yield f"http://127.0.0.1:{port}"
        box.device.end_streams()


def shape(value: Any) -> Any:
    """The keys of nested objects; of a list, those of its first object."""
    if isinstance(value, dict):
        return {key: shape(item) for key, item in value.items()}
    if isinstance(value, list) and value and isinstance(value[0], dict):
        return [shape(value[0])]
    return None


def missing(promised: Any, kept: Any, path: str = "") -> list[str]:
    """Where `kept` lacks a key of `promised`; nothing is asked of what is null in either."""
    if isinstance(promised, list) and isinstance(kept, list):
        return missing(promised[0], kept[0], path + "[]")
    if not isinstance(promised, dict) or not isinstance(kept, dict):
        return []
    lacking = [f"{path}.{key}" for key in promised if key not in kept]
    return lacking + [place for key in promised if key in kept for place in missing(promised[key], kept[key], f"{path}.{key}")]


def test_from_a_new_pipe_to_a_deleted_survey(watch: Callable[..., Watched], box: Bench) -> None:
    watched = watch(1280, 800)
    page = watched.open("/")
    expect(page.locator("#level-text")).to_have_text("Ready", timeout=PATIENCE_MS)
    expect(page.locator("#view-depth")).to_have_attribute("data-state", "live")
    assert page.locator("#overlay polyline.line").count() >= 1
    page.get_by_role("button", name="New").click()
    page.get_by_label("From manhole").fill("MH 14")
    page.get_by_label("To manhole").fill("MH 15")
    page.get_by_label("Material").select_option("concrete")
    page.get_by_label("DN on the map").fill("200")
    page.get_by_role("button", name="Save pipe").click()
    expect(page.locator("#pipe option:checked")).to_have_text("MH 14-MH 15 · DN 200 · concrete")
    page.click("#start")
    page.wait_for_url("**/surveys/*", timeout=PATIENCE_MS)
    expect(page.get_by_role("heading", name="ACCEPT")).to_be_visible()
    expect(page.locator("#verdict")).to_contain_text("DN 200")
    expect(page.locator("#verdict")).to_contain_text("Agrees with the map (DN 200)")
    expect(page.locator("#cross svg .measured").first).to_be_visible()
    assert page.locator("#boxes svg circle").count() == 12

    page.get_by_role("button", name="Show the point cloud").click()
    expect(page.locator("#cloud canvas")).to_be_visible()
    page.locator("label[for=cloud_is_pipe-no]").click()
    page.locator("label[for=verdict-retry]").click()
    page.get_by_label("Your name").fill("Ann")
    page.get_by_role("button", name="Save my answers").click()
    expect(page.get_by_role("heading", name="RETRY")).to_be_visible()

    page.get_by_role("button", name="Delete this survey").click()
    page.get_by_role("button", name="Delete", exact=True).click()
    page.get_by_role("button", name="Undo").click()
    expect(page.locator(".row")).to_have_count(1)
    expect(page.locator(".row")).to_contain_text("MH 14-MH 15")

    page.get_by_role("link", name="Reports").click()
    page.get_by_role("button", name="Begin a report").click()
    with page.expect_download() as taken:
        page.locator(".recordings a").click()
    assert taken.value.path().read_bytes().startswith(b"\x89MCAP"), "the report hands out the raw data of its surveys"


@pytest.mark.parametrize("camera", [0.2], indirect=True)
def test_a_wide_pipe_is_measured_at_two_positions(watch: Callable[..., Watched], box: Bench) -> None:
    page = watch().open("/")
    expect(page.locator("#level-text")).to_have_text("Ready", timeout=PATIENCE_MS)
    page.click("#start")
    page.wait_for_url("**/surveys/*", timeout=PATIENCE_MS)
    page.get_by_role("link", name="Measure in the middle").click()
    page.get_by_role("button", name="Measure in the middle").click()
    page.wait_for_url("**/surveys/*", timeout=PATIENCE_MS)
    expect(page.get_by_role("heading", name="Recordings")).to_be_visible()
    expect(page.get_by_role("heading", name="ACCEPT")).to_be_visible()


def test_a_lost_camera_and_its_return(watch: Callable[..., Watched], camera: PipeCamera) -> None:
    page = watch().open("/")
    expect(page.locator("#level-text")).to_have_text("Ready", timeout=PATIENCE_MS)
    camera.fault = "gone"
    expect(page.locator("#view-depth")).to_have_attribute("data-state", "lost", timeout=PATIENCE_MS)
    expect(page.locator("#diameter")).to_have_text("–")
    camera.fault = ""
    expect(page.locator("#view-depth")).to_have_attribute("data-state", "live", timeout=PATIENCE_MS)


def test_cancelling_leaves_no_survey(watch: Callable[..., Watched], box: Bench) -> None:
    page = watch().open("/")
    expect(page.locator("#level-text")).to_have_text("Ready", timeout=PATIENCE_MS)
    page.evaluate("import('/static/js/api.js').then((m) => m.ask('/measure', { method: 'POST', body: { frames: 500 } }))")
    page.get_by_role("button", name="Cancel").click()
    expect(page.locator("#start")).to_be_visible()
    assert box.device.surveys() == []


def test_the_device_keeps_what_the_fake_promises(box: Bench) -> None:
    """Every key the pages were developed against is there in the real answers."""
    fake, device = FakeDevice(), box.device
    fake_pipe = fake.places.create_pipe({"name": "P", "material": "concrete", "reference_dn": 200})["id"]
    pipe = device.places.create_pipe({"name": "P", "material": "concrete", "reference_dn": 200})["id"]
    number = device.measure(pipe_id=pipe)["survey_id"]
    assert box.finish(number)["state"] == "saved"
    fake_number = fake.add_survey(None, fake_pipe, "top", "accept")
    box.wait_for("live")
    pairs = {
        "status": (fake.status(), device.status()),
        "live": (fake.live(), device.live()),
        "survey": (fake.survey(fake_number), device.survey(number)),
        "surveys": (fake.surveys(), device.surveys()),
        "pipes": (fake.places.pipes(), device.places.pipes()),
        "cloud": (fake.cloud(fake_number), device.cloud(number)),
        "node": (fake.places.create_node("N"), device.places.create_node("N")),
    }
    fake.close()
    for name, (promised, kept) in pairs.items():
        assert kept, name
        assert missing(shape(promised), shape(kept), name) == []
