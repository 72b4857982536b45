"""Serve the dashboard's built files. They are a client of the public API and have no door of their own."""

from __future__ import annotations

from pathlib import Path

from fastapi import APIRouter, HTTPException
from fastapi.responses import FileResponse

DIST = Path(__file__).with_name("dist")
CONTENT_SECURITY_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; "
    "connect-src 'self'; worker-src 'self'; manifest-src 'self'; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
_MEDIA_TYPES = {
    ".css": "text/css",
    ".html": "text/html",
    ".js": "text/javascript",
    ".png": "image/png",
    ".svg": "image/svg+xml",
    ".webmanifest": "application/manifest+json",
}
_FOR_EVER = "public, max-age=31536000, immutable"
_ASK_AGAIN = "no-cache"
_AT_THE_ROOT = ("icon.svg", "icon-192.png", "icon-512.png", "manifest.webmanifest", "tablet-worker.js")

router = APIRouter(include_in_schema=False)


@router.get("/")
@router.get("/tablet")
def get_page() -> FileResponse:
    """Return the page; which part of it is shown, it decides itself."""
    return _file(DIST / "index.html", caching=_ASK_AGAIN)


@router.get("/docs")
def get_reference() -> FileResponse:
    """Return the API's reference for people, which asks no other server for anything."""
    return _file(DIST / "docs.html", caching=_ASK_AGAIN)


@router.get("/assets/{name}")
def get_asset(name: str) -> FileResponse:
    """Return a file that is named by its content, to be kept for ever."""
    found = DIST / "assets" / name
    if found.parent != DIST / "assets" or not found.is_file():
        raise HTTPException(404)
    return _file(found, caching=_FOR_EVER)


def _file(path: Path, *, caching: str) -> FileResponse:
    headers = {"Content-Security-Policy": CONTENT_SECURITY_POLICY, "Cache-Control": caching}
    return FileResponse(path, headers=headers, media_type=_MEDIA_TYPES[path.suffix])


def _serve_at_the_root(name: str) -> None:
    def get_file() -> FileResponse:
        return _file(DIST / name, caching=_ASK_AGAIN)

    router.get(f"/{name}")(get_file)


for _name in _AT_THE_ROOT:
    _serve_at_the_root(_name)
