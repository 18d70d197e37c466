"""The site's page over the real store: manholes with coordinates, pipes, the plan, deletions undone."""

from playwright.sync_api import expect

from tests.browser.conftest import Watched
from tests.browser.fake_device import FakeDevice


def test_manholes_get_names_and_coordinates_and_are_drawn(screen: Watched, device: FakeDevice) -> None:
    page = screen.open("/site")
    expect(page.locator("#plan")).to_be_hidden()
    for name, east, north in (("M1", "565000,5", "5933000"), ("M2", "565040.5", "5933030")):
        page.get_by_role("button", name="New manhole").click()
        page.get_by_label("Name", exact=True).fill(name)
        expect(page.locator("#node-check")).to_have_text(f"{name} is free.")
        page.get_by_label("Easting, m").fill(east)
        page.get_by_role("button", name="Save manhole").click()
        expect(page.locator("#node-error")).to_have_text("Easting and northing: both, or neither.")
        page.get_by_label("Northing, m").fill(north)
        page.get_by_role("button", name="Save manhole").click()
        expect(page.get_by_role("rowheader", name=name, exact=True)).to_be_visible()
    assert [(node["easting"], node["northing"]) for node in device.places.nodes()] == [(565000.5, 5933000), (565040.5, 5933030)]

    page.get_by_role("button", name="New pipe").click()
    page.get_by_label("From manhole").fill("M1")
    page.get_by_label("To manhole").fill("M2")
    page.get_by_label("Length, m").fill("50")
    page.get_by_role("button", name="Save pipe").click()
    expect(page.locator("#plan")).to_be_visible()
    expect(page.locator("#plan .pipe-name")).to_have_text("M1-M2")
    flow = page.locator("#plan line").first
    start, end = (float(flow.get_attribute(name) or "nan") for name in ("y1", "y2"))
    assert end < start, "M2 lies north of M1: up on the plan"

    page.get_by_role("button", name="M2", exact=True).click()
    page.get_by_label("Level, m").fill("9.75")
    page.get_by_role("button", name="Save manhole").click()
    expect(page.get_by_role("row", name="M2 565040.5")).to_contain_text("9.75")
    page.get_by_role("button", name="M2", exact=True).click()
    page.locator("#node-delete").click()
    page.locator("#delete-confirm").click()
    expect(page.locator("#node-error")).to_have_text("M2 stays: a pipe (or one that was deleted) or a survey belongs to it.")
    screen.complaints.clear()  # the refused request itself is told in the console


def test_a_pipe_is_deleted_after_a_question_and_comes_back(screen: Watched, device: FakeDevice) -> None:
    device.places.create_pipe({"name": "Elm Road"})
    page = screen.open("/site")
    page.get_by_role("button", name="Delete Elm Road").click()
    page.get_by_role("button", name="Keep it").click()
    assert len(device.places.pipes()) == 1
    page.get_by_role("button", name="Delete Elm Road").click()
    page.locator("#delete-confirm").click()
    expect(page.locator("#undo")).to_be_visible()
    assert device.places.pipes() == []
    page = screen.open("/site")
    page.get_by_text("Deleted pipes").click()
    page.get_by_role("button", name="Restore Elm Road").click()
    expect(page.get_by_role("row", name="Elm Road")).to_be_visible()
    page.get_by_role("button", name="Delete Elm Road").click()
    page.locator("#delete-confirm").click()
    page.get_by_role("button", name="Undo").click()
    expect(page.get_by_role("row", name="Elm Road")).to_be_visible()


def test_the_site_is_named_and_has_a_reference_system(screen: Watched, device: FakeDevice) -> None:
    page = screen.open("/site")
    page.get_by_label("Name of the site").fill("Hafencity")
    page.locator("#s-crs").fill("two")
    page.locator("#site-form").get_by_role("button", name="Save").click()
    expect(page.locator("#site-failed")).to_contain_text("EPSG number")
    page.locator("#s-crs").fill("EPSG:25832")
    page.locator("#site-form").get_by_role("button", name="Save").click()
    expect(page.get_by_role("heading", level=1)).to_have_text("Hafencity: manholes and pipes")
    assert device.places.site()["crs"] == 25832
