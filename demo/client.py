"""A small client of the public HTTP API, as a tablet, a robot or an admin would write one."""

from __future__ import annotations

import secrets
import time
from dataclasses import dataclass, field
from typing import Any

import httpx

from demo.console import DemoFailed

_PATIENCE_S = 600.0
_PAUSE_S = 0.1


@dataclass(frozen=True)
class Client:
    """Speak to one service with one key.

    Parameters
    ----------
    address : str
        Such as ``http://127.0.0.1:8000``.
    key : str
        An API key; its role decides what is allowed.
    """

    address: str
    key: str = field(repr=False)

    def request(self, method: str, path: str, *, expected: tuple[int, ...], **more: Any) -> httpx.Response:
        """Return the answer if its status is an expected one.

        Raises
        ------
        DemoFailed
            With the problem document's sentence, if the service refuses or does not answer.
        """
        headers = {"Authorization": f"Bearer {self.key}", **more.pop("headers", {})}
        try:
            answer = httpx.request(method, self.address + path, headers=headers, timeout=60.0, **more)
        except httpx.HTTPError as broken:
            raise DemoFailed(f"{method} {path}: no answer ({broken})") from broken
        if answer.status_code not in expected:
            wanted = " or ".join(str(status) for status in expected)
            raise DemoFailed(
                f"{method} {path}: {answer.status_code} instead of {wanted}: {_sentence(answer)}"
            )
        return answer

    def get(self, path: str) -> dict[str, Any]:
        """Return a JSON document."""
        document: dict[str, Any] = self.request("GET", path, expected=(200,)).json()
        return document

    def post(self, path: str, body: dict[str, Any] | None = None, **more: Any) -> dict[str, Any]:
        """Return what a POST made; a lost answer could be asked for again with the same idempotency key."""
        headers = {"Idempotency-Key": secrets.token_hex(16), **more.pop("headers", {})}
        content = {} if body is None else {"json": body}
        answer = self.request("POST", path, expected=(200, 201, 202), headers=headers, **content, **more)
        document: dict[str, Any] = answer.json()
        return document

    def done(self, job: dict[str, Any]) -> dict[str, Any]:
        """Return the job once it has succeeded.

        Raises
        ------
        DemoFailed
            With the job's problem, if it failed, was cancelled, or took longer than ten minutes.
        """
        deadline = time.monotonic() + _PATIENCE_S
        while time.monotonic() < deadline:
            state = job["state"]
            if state == "succeeded":
                return job
            if state in {"failed", "cancelled"}:
                problem = job.get("problem") or {}
                raise DemoFailed(f"job {job['id']} ({job['kind']}) {state}: {problem.get('detail', problem)}")
            time.sleep(_PAUSE_S)
            job = self.get(f"/v1/jobs/{job['id']}")
        raise DemoFailed(f"job {job['id']} ({job['kind']}) is still {job['state']} after {_PATIENCE_S:.0f} s")


def _sentence(answer: httpx.Response) -> str:
    """Return what a problem document says, or the beginning of whatever came instead."""
    try:
        problem = answer.json()
    except ValueError:
        return answer.text[:200]
    return f"{problem.get('title')}: {problem.get('detail')} {problem.get('errors', '')}".strip()
