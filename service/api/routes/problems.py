"""The public page of each problem type."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, HTTPException, Path
from fastapi.responses import HTMLResponse

from service.api.problems import page

router = APIRouter(prefix="/problems", tags=["problems"])


@router.get("/{slug}", response_class=HTMLResponse)
def get_problem_page(slug: Annotated[str, Path(max_length=100)]) -> HTMLResponse:
    """Explain a problem type: what it means and what to do. Needs no key."""
    found = page(slug)
    if found is None:
        raise HTTPException(404)
    return found
