"""What tests of the API ask again and again, and what every refusal has to look like."""

from __future__ import annotations

from itertools import count
from typing import Any

import httpx

from tests.patience import soon
from tests.service.by_hand import ByHand

_names = count(1)


def refused(answer: httpx.Response, status: int, slug: str) -> dict[str, Any]:
    """Return the problem document of an answer that has to be this refusal."""
    assert answer.status_code == status, answer.text
    assert answer.headers["content-type"] == "application/problem+json"
    problem: dict[str, Any] = answer.json()
    assert problem["status"] == status
    assert problem["type"] == f"{answer.request.url.copy_with(raw_path=b'/problems/' + slug.encode())}"
    assert problem["title"]
    assert problem["detail"]
    return problem


def ok(answer: httpx.Response, status: int = 200) -> dict[str, Any]:
    """Return the JSON of an answer that has to have this status."""
    assert answer.status_code == status, answer.text
    body: dict[str, Any] = answer.json()
    return body


def a_map(admin: httpx.Client) -> str:
    """Return the id of a new map."""
    made = ok(admin.post("/v1/maps", json={"site": "Plant", "name": f"floor {next(_names)}"}), 201)
    map_id: str = made["id"]
    return map_id


def a_ready_revision(admin: httpx.Client, by_hand: ByHand, map_id: str, **body: Any) -> int:
    """Return the number of a new ready revision."""
    if "base" not in body:
        body.setdefault("drawing_id", by_hand.drawing(map_id))
    made = ok(admin.post(f"/v1/maps/{map_id}/revisions", json=body), 202)
    by_hand.build(made["job"]["id"])
    n: int = made["revision"]["n"]
    return n


def a_placement(admin: httpx.Client, by_hand: ByHand, map_id: str, *, verdict: str = "accepted") -> str:
    """Return the id of a finished placement of a new scan on the map's latest ready revision."""
    where = f"/v1/scans/{by_hand.scan(map_id)}/placements"
    asked = ok(admin.post(where, json={"rough_pose": {"x_m": 1.0, "y_m": 2.0}}), 202)
    by_hand.place(asked["job"]["id"], verdict=verdict)
    placement_id: str = asked["placement"]["id"]
    return placement_id


def ended(client: httpx.Client, job_id: str) -> dict[str, Any]:
    """Return a job once it has ended, well or not."""

    def final() -> dict[str, Any] | None:
        job = ok(client.get(f"/v1/jobs/{job_id}"))
        return job if job["state"] in {"succeeded", "failed", "cancelled"} else None

    return soon(final, lambda: ok(client.get(f"/v1/jobs/{job_id}")))
