"""Debian's Chromium before the real service; every page is watched for errors of any kind."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import httpx
import pytest
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Browser, BrowserContext, Page, expect, sync_playwright

from tests import web
from tests.patience import PATIENCE_S
from tests.server import Server

FLAGS = [
    "--headless=new",
    "--no-sandbox",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
]
GRAVE = {"serious", "critical"}
CALM = {"viewport": {"width": 1280, "height": 800}, "locale": "en-GB", "reduced_motion": "reduce"}
"""A colour on its way from light to dark has neither's contrast: what is looked at stands still."""
_PATIENCE_MS = 1000.0 * PATIENCE_S
expect.set_options(timeout=_PATIENCE_MS)


@pytest.fixture(scope="session")
def chromium() -> Iterator[Browser]:
    """Give the browser, started once."""
    found = shutil.which("chromium")
    assert found, "Chromium is missing: `tools/setup --tests` installs it"
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=found, args=FLAGS)
        yield browser
        browser.close()


@dataclass
class Watched:
    """Hold a page, and what went wrong on it so far."""

    page: Page
    url: str
    faults: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        """Listen from the first moment on."""
        self.page.on("console", lambda said: self._said(said.type, said.text))
        self.page.on("pageerror", lambda error: self.faults.append(str(error)))
        self.page.add_init_script(
            "document.addEventListener('securitypolicyviolation',"
            " e => console.error('CSP ' + e.violatedDirective + ' ' + e.blockedURI))"
        )

    def _said(self, kind: str, text: str) -> None:
        if kind == "error":
            self.faults.append(text)

    def sign_in(self, key: str) -> None:
        """Sign in as a person does."""
        self.page.goto(self.url)
        self.page.get_by_label("Your key").fill(key)
        self.page.get_by_role("button", name="Sign in").click()
        expect(self.page.get_by_role("heading", name="Overview")).to_be_visible()
        self.faults = [fault for fault in self.faults if "401" not in fault]

    def accessible(self) -> None:
        """Pass when axe finds nothing serious on what is shown now."""
        found = Axe().run(self.page).response["violations"]
        grave = [one for one in found if one["impact"] in GRAVE]
        assert grave == [], [(one["id"], [node["html"] for node in one["nodes"]]) for one in grave]

    def clean(self) -> None:
        """Pass when nothing went wrong, refused requests and policy violations included."""
        assert self.faults == []


Visit = Callable[..., Watched]


@pytest.fixture
def visit(chromium: Browser) -> Iterator[Visit]:
    """Give a function: a watched page of a new person, with cookies of their own."""
    contexts: list[BrowserContext] = []

    def open_page(url: str, **options: Any) -> Watched:
        chosen: dict[str, Any] = CALM | options
        contexts.append(chromium.new_context(**chosen))
        contexts[-1].set_default_timeout(_PATIENCE_MS)
        return Watched(contexts[-1].new_page(), url)

    yield open_page
    for context in contexts:
        context.close()


@pytest.fixture
def signed_in(visit: Visit, server: Server) -> Watched:
    """Give the page of an admin on the service without a worker."""
    watched = visit(server.url)
    watched.sign_in(server.admin_key)
    return watched


@contextmanager
def with_cookie(url: str, secret: str) -> Iterator[httpx.Client]:
    """Give a client that has signed in like the page, and sends no header of ours afterwards."""
    with web.Client(base_url=url) as client:
        answer = client.put("/v1/session", json={"key": secret}, headers={"X-Groundplan-Session": "1"})
        assert answer.status_code == 200, answer.text
        yield client


@pytest.fixture(scope="session")
def pictures() -> Path:
    """Give the folder for screenshots; those that the documents show are copied from here."""
    folder = Path(__file__).resolve().parents[2] / "build" / "pictures"
    folder.mkdir(parents=True, exist_ok=True)
    return folder
