"""Prometheus metrics of one service: requests as they come, jobs as the database has them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

from prometheus_client import Counter, Histogram, generate_latest
from prometheus_client.core import GaugeMetricFamily
from prometheus_client.registry import Collector

from service.exposition import Exposed
from service.storage.room import Space
from service.usecases.stats import JobFigures

MEDIA_TYPE = "text/plain; version=0.0.4; charset=utf-8"


class _Jobs(Collector):
    def __init__(self, look: Callable[[], JobFigures]) -> None:
        self._look = look

    def collect(self) -> Iterator[GaugeMetricFamily]:
        figures = self._look()
        jobs = GaugeMetricFamily("groundplan_jobs", "Jobs by state.", labels=["state"])
        for state, number in figures.by_state.items():
            jobs.add_metric([state], number)
        yield jobs
        yield GaugeMetricFamily(
            "groundplan_queue_age_seconds",
            "Seconds for which the oldest queued job that is due has waited.",
            value=figures.queue_age_s,
        )


class _Storage(Collector):
    def __init__(self, look: Callable[[], Sequence[Space]]) -> None:
        self._look = look

    def collect(self) -> Iterator[GaugeMetricFamily]:
        spaces = self._look()
        for name, told in (
            ("free_bytes", "Bytes that are free on a file system."),
            ("reserve_bytes", "Bytes that are kept free on it."),
            ("is_full", "1 while uploads and jobs are refused for want of room on it."),
        ):
            gauge = GaugeMetricFamily(
                f"groundplan_storage_{name.removeprefix('is_')}", told, labels=["holds"]
            )
            for space in spaces:
                gauge.add_metric([space.name], getattr(space, name))
            yield gauge


class Metrics(Exposed):
    """Hold the counters of one app."""

    def __init__(self, *, jobs: Callable[[], JobFigures], spaces: Callable[[], Sequence[Space]]) -> None:
        super().__init__()
        self._requests = Counter(
            "groundplan_http_requests",
            "Requests answered.",
            ["method", "route", "status"],
            registry=self._registry,
        )
        self._seconds = Histogram(
            "groundplan_http_request_seconds",
            "Seconds until a request was answered in full.",
            ["route"],
            registry=self._registry,
        )
        self._jobs = jobs
        self._registry.register(_Storage(spaces))

    def watch_jobs(self) -> None:
        """Report jobs too; only once the database is known to be usable."""
        self._registry.register(_Jobs(self._jobs))

    def count(self, method: str, route: str, *, status: int, seconds: float) -> None:
        """Count one answered request of a route's pattern (never of a path: those have no bound)."""
        known = method if method in {"GET", "HEAD", "POST", "PATCH", "DELETE", "OPTIONS", "PUT"} else "other"
        self._requests.labels(known, route, str(status)).inc()
        self._seconds.labels(route).observe(seconds)

    def text(self) -> bytes:
        """Return all metrics in Prometheus' text format."""
        return generate_latest(self._registry)
