"""The tablet page over HTTPS: it can be installed, and opens again without a network."""

from __future__ import annotations

import re
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, expect

from tests.browser.conftest import FLAGS
from tests.journeys.test_tls import up


@pytest.fixture
def trusting(chromium: Browser) -> Iterator[Browser]:
    """Give a browser that trusts every certificate, as a tablet on which ours is installed."""
    program, playwright = shutil.which("chromium"), chromium.browser_type
    browser = playwright.launch(executable_path=program, args=[*FLAGS, "--ignore-certificate-errors"])
    yield browser
    browser.close()


def test_over_https_the_page_is_installable_and_opens_without_a_network(
    trusting: Browser, tmp_path: Path
) -> None:
    with up(tmp_path / "data", "--tls") as address:
        key = re.search(r"\bgp_[\w\-]+", (tmp_path / "up.log").read_text(encoding="utf-8"))
        assert key is not None
        context = trusting.new_context(ignore_https_errors=True, has_touch=True, locale="en-GB")
        page = context.new_page()
        page.goto(f"{address}/tablet")
        page.get_by_label("Your key").fill(key.group())
        page.get_by_role("button", name="Sign in").click()
        expect(page.get_by_role("button", name="Begin")).to_be_visible()
        assert page.evaluate("isSecureContext")
        expect(page.get_by_text("only where Groundplan is reached by HTTPS")).to_have_count(0)
        scope = page.evaluate("navigator.serviceWorker.ready.then(worker => new URL(worker.scope).pathname)")
        assert scope == "/tablet"
        manifest = page.evaluate("fetch('/manifest.webmanifest').then(answer => answer.json())")
        assert (manifest["start_url"], manifest["display"]) == ("/tablet", "standalone")
        (cookie,) = context.cookies()
        assert (cookie["httpOnly"], cookie["secure"], cookie["sameSite"]) == (True, True, "Strict")
        page.reload()
        expect(page.get_by_role("button", name="Begin")).to_be_visible()
        context.set_offline(True)
        page.reload()
        expect(page.get_by_role("button", name="Begin")).to_be_visible()
        context.close()
