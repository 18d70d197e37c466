"""Chromium against a served fake device, at the size of a phone and of a laptop."""

import os
import shutil
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from urllib.parse import urlsplit

import pytest
from playwright.sync_api import Browser, Page, Playwright, sync_playwright

from tests.browser.fake_device import FakeDevice
from tests.browser.serving import served
from tests.pairing import browser_cookie, pair
from web_ui.app import create_app

NAMES = ("chromium", "chromium-browser", "google-chrome", "chrome")
ARGUMENTS = [
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--disable-dev-shm-usage",
]
SIZES = {"phone": (390, 844), "laptop": (1280, 800)}


@dataclass
class Watched:
    """A page of the box, with everything it wrote to the console and every address it asked."""

    page: Page
    root: str
    complaints: list[str] = field(default_factory=list)
    foreign: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.page.on("console", lambda message: self._complain(message.type, message.text))
        self.page.on("pageerror", lambda error: self.complaints.append(str(error)))
        self.page.on("request", lambda request: self._asked(request.url))

    def _complain(self, kind: str, text: str) -> None:
        if kind in ("error", "warning"):
            self.complaints.append(text)

    def _asked(self, url: str) -> None:
        if not url.startswith((self.root + "/", "data:", "blob:")):
            self.foreign.append(url)

    def open(self, path: str) -> Page:
        """The page at `path`, loaded."""
        self.page.goto(self.root + path)
        return self.page

    @property
    def path(self) -> str:
        return urlsplit(self.page.url).path


@pytest.fixture(scope="session")
def chromium() -> Iterator[Browser]:
    """A running Chromium; without one the tests are skipped, but fail where CI=true."""
    executable = next(filter(None, map(shutil.which, NAMES)), None)
    if executable is None:
        message = f"no browser: none of {', '.join(NAMES)} is installed"
        if os.environ.get("CI") == "true":
            pytest.fail(message)
        pytest.skip(message)
    playwright: Playwright
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=executable, args=ARGUMENTS)
        yield browser
        browser.close()


@pytest.fixture
def device() -> Iterator[FakeDevice]:
    fake = FakeDevice(seconds=0.8)
    yield fake
    fake.close()


@pytest.fixture
def root(device: FakeDevice) -> Iterator[str]:
    app = create_app(device)  # type: ignore[arg-type]  # a fake with the facade's methods
    with served(app) as port:
        yield f"http://127.0.0.1:{port}"
        device.close()


@pytest.fixture
def watch(chromium: Browser, root: str) -> Iterator[Callable[..., Watched]]:
    """Make a watched page: `watch(width, height, **context options)`, paired; all of a test's pages share the session.

    At the end nothing may have complained.
    """
    made: list[Watched] = []
    shared = pair(int(root.rsplit(":", 1)[1]))

    def make(width: int = 390, height: int = 844, **options: object) -> Watched:
        context = chromium.new_context(viewport={"width": width, "height": height}, **options)  # type: ignore[arg-type]  # passed on
        context.set_default_timeout(8000)
        context.add_cookies([browser_cookie(shared, root)])
        watched = Watched(context.new_page(), root)
        made.append(watched)
        return watched

    yield make
    for watched in made:
        watched.page.context.close()
        assert watched.foreign == [], "a request left the box"
        assert watched.complaints == [], "the console was not silent"


@pytest.fixture(params=list(SIZES))
def screen(request: pytest.FixtureRequest, watch: Callable[..., Watched]) -> Watched:
    """A watched page at the size of a phone, then of a laptop."""
    width, height = SIZES[request.param]
    return watch(width, height, has_touch=request.param == "phone")
