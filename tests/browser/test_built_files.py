"""What is built is of these sources, small, kept by browsers, and under a strict policy."""

from __future__ import annotations

import gzip
import hashlib
import re
from pathlib import Path

from service.web.pages import DIST
from tests import web
from tests.server import Server
from tests.service.snapshot import SNAPSHOT

APP = DIST.with_name("app")
NOT_SOURCES = {"node_modules", "schema.d.ts", "tests"}
FIRST_LOAD_BYTES = 250_000


def _sources(folder: Path) -> list[Path]:
    kept = [path for path in folder.iterdir() if path.name not in NOT_SOURCES]
    return [found for path in kept for found in (_sources(path) if path.is_dir() else [path])]


def _recorded_as(sources: list[Path]) -> str:
    whole = hashlib.sha256()
    for path in sorted(sources, key=lambda one: one.relative_to(APP).as_posix()):
        content = hashlib.sha256(path.read_bytes()).hexdigest()
        whole.update(f"{path.relative_to(APP).as_posix()}\0{content}\n".encode())
    whole.update(f"openapi.json\0{hashlib.sha256(SNAPSHOT.read_bytes()).hexdigest()}\n".encode())
    return whole.hexdigest()


def test_the_built_files_are_of_these_sources() -> None:
    built_of = (DIST / "sources.sha256").read_text(encoding="utf-8").strip()
    assert built_of == _recorded_as(_sources(APP)), "run tools/build-dashboard and commit service/web/dist"


def test_the_first_load_is_small() -> None:
    page = (DIST / "index.html").read_text(encoding="utf-8")
    linked = re.findall(r'"(/assets/[^"]+)"', page)
    assert any(name.endswith(".js") for name in linked)
    assert any(name.endswith(".css") for name in linked)
    whole = sum(len(gzip.compress((DIST / name.lstrip("/")).read_bytes())) for name in linked)
    assert whole + len(gzip.compress(page.encode())) <= FIRST_LOAD_BYTES


def test_hashed_files_are_kept_for_ever_and_the_page_is_asked_for(server: Server) -> None:
    page = web.get(server.url)
    assert page.headers["cache-control"] == "no-cache"
    for name in re.findall(r'"(/assets/[^"]+)"', page.text):
        asset = web.get(server.url + name)
        assert asset.status_code == 200
        assert asset.headers["cache-control"] == "public, max-age=31536000, immutable"
        assert asset.content == (DIST / name.lstrip("/")).read_bytes()
    for name in ("manifest.webmanifest", "tablet-worker.js", "icon.svg", "icon-192.png", "tablet"):
        assert web.get(f"{server.url}/{name}").headers["cache-control"] == "no-cache"


def test_the_policy_allows_our_own_files_alone(server: Server) -> None:
    policy = web.get(server.url).headers["content-security-policy"]
    directives = dict(part.strip().split(" ", 1) for part in policy.split(";"))
    assert directives["default-src"] == "'none'"
    assert directives["script-src"] == directives["style-src"] == directives["connect-src"] == "'self'"
    assert directives["frame-ancestors"] == "'none'"
    assert "unsafe" not in policy
    assert "http" not in policy


def test_nothing_beside_the_built_files_is_given(server: Server) -> None:
    for path in (
        "/assets/..%2findex.html",
        "/assets/%2e%2e",
        "/assets/nothing.js",
        "/sources.sha256",
        "/app/index.html",
    ):
        assert web.get(server.url + path).status_code == 404, path
