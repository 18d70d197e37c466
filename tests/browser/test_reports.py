"""Reports in a browser, over the real device and store: read, edited, taken home; axe looks at the pages."""

import re
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import expect

from device.clock import Clock
from device.inspections.demo import demo_inspection
from device.store import Store
from tests.browser.conftest import Watched
from tests.browser.serving import served
from tests.hil.rig import Bench, PipeCamera
from tests.waiting import wait_until
from web_ui.app import create_app


@pytest.fixture(scope="module")
def demo(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A data folder with one demo inspection; made once, since it maps and measures."""
    folder = tmp_path_factory.mktemp("reports") / "data"
    store = Store(folder, Clock())
    demo_inspection(store, 3)
    store.close()
    return folder


@pytest.fixture
def root(demo: Path, tmp_path: Path) -> Iterator[str]:
    """The pages over a device whose store is a copy of the demo's."""
    folder = tmp_path / "data"
    folder.mkdir()
    for file in demo.iterdir():
        (folder / file.name).write_bytes(file.read_bytes())
    bench = Bench(folder, PipeCamera("front", radius_m=0.1))
    with served(create_app(bench.device)) as port:
        yield f"http://127.0.0.1:{port}"
        bench.device.end_streams()
    bench.close()


def test_a_report_is_read_edited_and_undone(screen: Watched) -> None:
    page = screen.open("/inspections")
    page.get_by_role("link", name=re.compile("M3-0A-M3-0B")).click()
    expect(page.get_by_role("heading", name="M3-0A-M3-0B")).to_be_visible()
    rows = page.locator("table.observations tbody tr")
    before = rows.count()
    assert before >= 10
    assert page.evaluate("document.documentElement.scrollWidth") <= page.viewport_size["width"]  # type: ignore[index]

    rows.nth(1).get_by_role("button", name="Edit").click()
    page.get_by_label("Remark").fill("seen twice")
    page.locator("#save").click()
    expect(rows.nth(1)).to_contain_text("seen twice")
    rows.nth(1).get_by_role("button", name="Edit").click()
    page.locator("#remove").click()
    expect(rows).to_have_count(before - 1)
    page.get_by_role("button", name="Undo the last edit").click()
    expect(rows).to_have_count(before)
    expect(rows.nth(1)).to_contain_text("seen twice")


def test_what_breaks_a_rule_is_said_before_it_goes_out(watch: Callable[..., Watched]) -> None:
    page = watch(390, 844).open("/inspections/1")
    expect(page.locator(".faults")).to_have_count(0)
    page.get_by_role("button", name="Add").click()
    page.get_by_label("Station (m)").fill("24")
    page.locator("#e-code").select_option("BBC")
    page.get_by_label("Continuous").fill("A9")
    page.locator("#save").click()
    expect(page.locator(".faults")).to_contain_text("the continuous defect 9 never ends")


def test_files_are_taken_home(watch: Callable[..., Watched]) -> None:
    page = watch(1280, 800).open("/inspections/1")
    page.locator("#language").select_option("de")
    for label, start in (("Report (PDF)", b"%PDF"), ("Everything (ZIP)", b"PK"), ("ISYBAU XML", b"<?xml")):
        with page.expect_download() as waiting:
            page.get_by_role("link", name=label).click()
        assert Path(waiting.value.path()).read_bytes().startswith(start)


def test_a_deleted_report_comes_back(watch: Callable[..., Watched]) -> None:
    page = watch(390, 844).open("/inspections/1")
    # a photo that is asked for after the deletion is not there any more: let all of them come first
    page.evaluate("document.querySelectorAll('img').forEach((img) => { img.loading = 'eager'; })")
    wait_until(lambda: page.evaluate("[...document.images].every((img) => img.complete)"))
    page.on("dialog", lambda dialog: dialog.accept())
    page.get_by_role("button", name="Delete this report").click()
    expect(page.get_by_text("Report 1 was deleted")).to_be_visible()
    page.get_by_role("button", name="Undo").click()
    expect(page.get_by_role("heading", name="M3-0A-M3-0B")).to_be_visible()


def test_a_report_outlives_its_pipe(watch: Callable[..., Watched]) -> None:
    page = watch(1280, 800).open("/site")
    page.get_by_role("button", name="Delete M3-0A-M3-0B").click()
    page.locator("#delete-confirm").click()
    expect(page.locator("#undo")).to_be_visible()
    page.get_by_role("link", name="Reports", exact=True).first.click()
    page.get_by_role("link", name=re.compile("M3-0A-M3-0B")).click()
    with page.expect_download() as waiting:
        page.get_by_role("link", name="Report (PDF)").click()
    assert Path(waiting.value.path()).read_bytes().startswith(b"%PDF")


def test_a_second_report_is_begun_and_compared(watch: Callable[..., Watched]) -> None:
    page = watch(1280, 800).open("/inspections")
    page.get_by_label("Operator").fill("Ann")
    page.get_by_role("button", name="Begin a report").click()
    page.wait_for_url("**/inspections/2")
    page.get_by_role("button", name="Compare").click()
    expect(page.get_by_role("heading", name=re.compile("what changed"))).to_be_visible()
    expect(page.get_by_role("heading", name=re.compile(r"Gone \(\d+\)"))).to_be_visible()


def test_a_pipe_list_is_imported(watch: Callable[..., Watched], tmp_path: Path) -> None:
    listed = tmp_path / "pipes.csv"
    listed.write_text("name,upstream,downstream,material,dn,length_m\nA-B,A,B,clay,300,41.5\nB-C,B,C,,250,\n")
    watched = watch(390, 844)
    page = watched.open("/site")
    page.get_by_text("Import a pipe list").click()
    page.locator("#i-file").set_input_files(str(listed))
    page.get_by_role("button", name="Import", exact=True).click()
    expect(page.locator("#import-said")).to_have_text("2 pipes and 3 manholes added, 0 pipes were there already. Show them")
    listed.write_text("name,upstream\nA-B,A\n")
    page.locator("#i-file").set_input_files(str(listed))
    page.get_by_role("button", name="Import", exact=True).click()
    expect(page.locator("#import-said")).to_contain_text("lacks the column downstream")
    (refusal,) = watched.complaints
    assert "422" in refusal
    watched.complaints.clear()


@pytest.mark.parametrize("path", ["/inspections", "/inspections/1"])
def test_axe_finds_nothing_serious(watch: Callable[..., Watched], path: str) -> None:
    page = watch(360, 740).open(path)
    page.wait_for_load_state("networkidle")
    assert page.evaluate("document.documentElement.scrollWidth") <= 360
    found = Axe().run(page).response["violations"]
    serious = [f"{one['id']}: {one['nodes'][0]['html']}" for one in found if one["impact"] in ("serious", "critical")]
    assert serious == []
