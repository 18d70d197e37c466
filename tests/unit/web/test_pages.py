"""The server-rendered pages: what they say, that nothing in them is inline or foreign, and that the first load is small."""

import gzip
import re
from html.parser import HTMLParser
from pathlib import Path

from flask.testing import FlaskClient

import web_ui
from tests.browser.fake_device import FakeDevice
from web_ui.wording import millimetres, percent, when

FIRST_LOAD_BYTES = 150_000
NASTY = "<img src=x onerror=alert(1)>\"'&</script>"


class Tags(HTMLParser):
    """All tags of a page with their attributes."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))


def all_pages(device: FakeDevice) -> list[str]:
    pipe = device.places.create_pipe(
        {"name": NASTY, "material": "PVC", "shape": "circular", "reference_dn": 200, "note": NASTY}
    )["id"]
    device.places.create_node(NASTY)
    numbers = [device.add_survey(None, pipe, "top", outcome) for outcome in ("accept", "retry", "second")]
    answers = {"image_good": False, "cloud_is_pipe": None, "fit_aligned": True, "verdict": "retry", "by": NASTY, "note": NASTY}
    device.answer(numbers[0], answers)
    drive = device.drive.add(pipe, "interrupted")
    return [
        "/",
        "/drive",
        f"/surveys/{drive}",
        "/surveys",
        f"/?second={numbers[2]}",
        f"/?pipe={pipe}",
        "/surveys?deleted=3",
        "/nothing",
    ] + [f"/surveys/{number}" for number in numbers]


def test_no_page_holds_inline_code_or_foreign_addresses(client: FlaskClient, device: FakeDevice) -> None:
    for path in all_pages(device):
        page = client.get(path)
        tags = Tags(page.text).tags
        assert tags[0][0] == "html", path
        assert ("html", {"lang": "en"}) in tags
        for tag, attributes in tags:
            assert not [name for name in attributes if name.startswith("on") or name == "style"], (path, tag)
            for name in ("src", "href", "action"):
                target = attributes.get(name) or ""
                assert target == "" or target[0] in "/#", (path, tag, target)
                assert not target.startswith("//"), (path, tag, target)
            assert tag != "style"
            if tag == "script":
                assert attributes.get("src") or attributes.get("type") == "application/json", (path, attributes)
        assert "onerror=alert" not in re.sub(r"&lt;img[^<]*|\\u003cimg[^<]*", "", page.text)


def test_every_control_has_a_label(client: FlaskClient, device: FakeDevice) -> None:
    for path in all_pages(device):
        tags = Tags(client.get(path).text).tags
        labelled = {attributes.get("for") for tag, attributes in tags if tag == "label"}
        for tag, attributes in tags:
            if tag in ("select", "textarea") or (tag == "input" and attributes.get("type") != "hidden"):
                assert attributes.get("id") in labelled or attributes.get("aria-label"), (path, attributes)
        ids = [attributes["id"] for _, attributes in tags if "id" in attributes]
        assert len(ids) == len(set(ids)), (path, "an id is used twice")
        assert sum(tag == "h1" for tag, _ in tags) == 1, path
        assert sum(tag == "main" for tag, _ in tags) == 1, path


def test_an_accepted_survey_reads_as_one(client: FlaskClient, device: FakeDevice) -> None:
    text = client.get(f"/surveys/{device.add_survey(None, None, 'top', 'accept')}").text
    assert "ACCEPT" in text
    assert "RETRY" not in text
    for words in ("398", "395 to 401 mm", "DN 400", "98\u00a0%", "Agrees with the map (DN 400)", "48 mm deep"):
        assert words in text, words


def test_a_refused_survey_names_reasons_remedies_and_no_trusted_number(client: FlaskClient, device: FakeDevice) -> None:
    text = client.get(f"/surveys/{device.add_survey(None, None, 'top', 'retry')}").text
    assert "RETRY" in text
    assert "ACCEPT" not in text
    for words in (
        "The radius changed from frame to frame.",
        "Rest the box on the invert",
        "Estimate, not to be used",
        "Measure again",
    ):
        assert words in text, words
    accept = next(a for tag, a in Tags(text).tags if a.get("id") == "verdict-accept")
    assert "disabled" in accept, "a refusal of the device cannot be overruled"


def test_a_second_position_is_asked_for_with_its_button(client: FlaskClient, device: FakeDevice) -> None:
    number = device.add_survey(None, None, "top", "second")
    text = client.get(f"/surveys/{number}").text
    assert "Measure in the middle" in text
    assert "First position, to be confirmed" in text
    assert "not to be used" not in text
    assert f'href="/?second={number}"' in text
    assert "Measure in the middle" in client.get(f"/?second={number}").text
    assert client.get("/?second=999").status_code == 404


def test_a_survey_without_a_finding_or_profile_is_shown(client: FlaskClient, device: FakeDevice) -> None:
    number = device.add_survey(None, None, "top", "retry")
    empty = dict.fromkeys(("diameter_mm", "interval_mm", "radius_std_mm", "dn", "reference", "profile", "mean_mm"))
    device.survey(number)["result"] |= {**empty, "inlier_weighted_mean_mm": None, "frames": [], "proxies": {}, "position": None}
    assert client.get(f"/surveys/{number}").status_code == 200
    assert client.get("/surveys").status_code == 200
    device.survey(number)["result"] = None
    assert client.get(f"/surveys/{number}").status_code == 200
    assert client.get(f"/?second={number}").status_code == 200


def test_the_history_is_newest_first_in_pages_and_says_when_it_is_empty(client: FlaskClient, device: FakeDevice) -> None:
    assert "Nothing measured yet" in client.get("/surveys").text
    pipe = device.places.create_pipe(
        {"name": "Elm Road", "material": "clay", "shape": "circular", "reference_dn": None, "note": ""}
    )["id"]
    assert "has not been measured yet" in client.get(f"/surveys?pipe_id={pipe}").text
    numbers = [device.add_survey(None, pipe if n == 7 else None, "top", "accept") for n in range(60)]
    shown = [int(n) for n in re.findall(r'class="row" href="/surveys/(\d+)"', client.get("/surveys").text)]
    assert shown == numbers[:9:-1]
    assert f"/surveys?before={numbers[10]}" in client.get("/surveys").text
    rest = [int(n) for n in re.findall(r'class="row" href="/surveys/(\d+)"', client.get(f"/surveys?before={numbers[10]}").text)]
    assert rest == numbers[9::-1]
    assert re.findall(r'class="row" href="/surveys/(\d+)"', client.get(f"/surveys?pipe_id={pipe}").text) == [str(numbers[7])]


def test_the_first_load_is_small(client: FlaskClient, device: FakeDevice) -> None:
    """Everything a phone fetches before the first picture, each gzipped by itself."""
    page = client.get("/").text
    static = Path(web_ui.__file__).parent / "static"
    loaded = [path for path in static.rglob("*") if path.is_file() and path.name != "cloud.js"]
    assert len(loaded) > 10
    total = len(gzip.compress(page.encode())) + sum(len(gzip.compress(path.read_bytes())) for path in loaded)
    assert total < FIRST_LOAD_BYTES


def test_a_browser_finds_its_icon(client: FlaskClient) -> None:
    for path in ("/favicon.ico", "/static/favicon.svg"):
        assert client.get(path).mimetype == "image/svg+xml"


def test_modules_the_page_preloads_exist(client: FlaskClient) -> None:
    for tag, attributes in Tags(client.get("/").text).tags:
        target = attributes.get("href") if tag == "link" else attributes.get("src")
        if target:
            response = client.get(target)
            assert response.status_code == 200, target
            if target.endswith(".js"):
                assert response.mimetype == "text/javascript"


def test_words_for_numbers() -> None:
    assert [millimetres(value) for value in (None, 398.46, 0.0)] == ["–", "398", "0"]
    assert [percent(value) for value in (None, 0.0, 0.001, 0.98, 0.9999, 1.0)] == [
        "–",
        "0\u00a0%",
        "<\u00a01\u00a0%",
        "98\u00a0%",
        ">\u00a099\u00a0%",
        "100\u00a0%",
    ]
    assert when({"created": "2026-11-02T02:14:09Z"}) == "2 Nov 2026, 02:14 UTC"
    assert when({"created": None}) == "time unknown"
