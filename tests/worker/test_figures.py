"""Metrics at ports of their own: the service's, and what a worker's jobs took and how they ended."""

from __future__ import annotations

import re
import socket
from pathlib import Path

import pytest

from service.domain.lifecycle import JobState
from service.settings import Settings
from tests import web
from tests.patience import soon
from tests.server import running
from tests.worker.workbench import Workbench, a_small_drawing


def a_free_port() -> int:
    """Return a port that nobody listens at."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port


def _figures(port: int) -> dict[str, float]:
    """Return every sample by its name and labels."""
    text = web.get(f"http://127.0.0.1:{port}/metrics").text
    return {name: float(value) for name, value in re.findall(r"^([^# ]\S*) (\S+)$", text, flags=re.MULTILINE)}


def test_a_worker_tells_what_its_jobs_took(sqlite_bench: Workbench, tmp_path: Path) -> None:
    port = a_free_port()
    broken = tmp_path / "broken.png"
    broken.write_bytes(b"\x89PNG\r\n\x1a\n no picture")
    with sqlite_bench.worker(worker_metrics_port=str(port)):
        good = sqlite_bench.add_drawing(a_small_drawing(tmp_path / "plan.png"))
        assert sqlite_bench.wait_final(good).state == JobState.SUCCEEDED, sqlite_bench.log()
        bad = sqlite_bench.add_drawing(broken)
        assert sqlite_bench.wait_final(bad).state == JobState.FAILED

        def both_ended() -> dict[str, float] | None:
            told = _figures(port)
            ended = told.get(_ATTEMPTS % "failed") == 1.0 and not told["groundplan_worker_running"]
            return told if ended else None

        told = soon(both_ended, lambda: _figures(port))
    assert told[_ATTEMPTS % "done"] == 1.0
    assert told['groundplan_worker_attempt_seconds_count{kind="read-drawing"}'] == 2.0
    assert told['groundplan_worker_attempt_seconds_sum{kind="read-drawing"}'] > 0.0
    assert told['groundplan_worker_attempt_cpu_seconds_total{kind="read-drawing"}'] > 0.0
    assert told['groundplan_worker_attempt_peak_bytes_sum{kind="read-drawing"}'] > 1 << 20
    assert told["process_resident_memory_bytes"] > 1 << 20


_ATTEMPTS = 'groundplan_worker_attempts_total{kind="read-drawing",outcome="%s"}'


def test_the_service_has_a_port_for_its_metrics_alone(tmp_path: Path) -> None:
    port = a_free_port()
    with running(Settings(data_dir=tmp_path), GROUNDPLAN_METRICS_PORT=str(port)) as server:
        assert server.client(server.admin_key).get("/v1/maps").status_code == 200
        told = _figures(port)
        assert told['groundplan_http_requests_total{method="GET",route="/v1/maps",status="200"}'] == 1.0
        assert told['groundplan_jobs{state="queued"}'] == 0.0
        assert "items" not in web.get(f"http://127.0.0.1:{port}/v1/maps").text


def test_a_taken_port_is_told_in_one_line(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(RuntimeError, match="Address already in use"):
            running(Settings(data_dir=tmp_path), GROUNDPLAN_METRICS_PORT=str(port)).__enter__()
