"""Prometheus metrics of one worker: what its jobs took and how they ended."""

from __future__ import annotations

from prometheus_client import Counter, Gauge, Histogram

from service.exposition import Exposed

_SECONDS = (0.1, 0.3, 1, 3, 10, 30, 100, 300, 1000, 3000)
_BYTES = tuple(float(2**power) for power in range(26, 35))
"""From 64 MiB, less than a job's process has at rest, to 16 GiB."""


class Figures(Exposed):
    """Hold the counters of one worker."""

    def __init__(self) -> None:
        super().__init__()
        self._ended = Counter(
            "groundplan_worker_attempts",
            "Attempts at jobs that ended here: done, failed, died without a word, or broken-off.",
            ["kind", "outcome"],
            registry=self._registry,
        )
        self._seconds = Histogram(
            "groundplan_worker_attempt_seconds",
            "Seconds that an attempt took.",
            ["kind"],
            buckets=_SECONDS,
            registry=self._registry,
        )
        self._cpu = Counter(
            "groundplan_worker_attempt_cpu_seconds",
            "CPU seconds that attempts took.",
            ["kind"],
            registry=self._registry,
        )
        self._peak = Histogram(
            "groundplan_worker_attempt_peak_bytes",
            "Most memory that an attempt held.",
            ["kind"],
            buckets=_BYTES,
            registry=self._registry,
        )
        self._running = Gauge("groundplan_worker_running", "Jobs that run here now.", registry=self._registry)

    def begin(self) -> None:
        """Count a job that begins."""
        self._running.inc()

    def end(self, kind: str, outcome: str, *, seconds: float, cpu_s: float, peak_bytes: int) -> None:
        """Count an attempt that has ended."""
        self._running.dec()
        self._ended.labels(kind, outcome).inc()
        self._seconds.labels(kind).observe(seconds)
        self._cpu.labels(kind).inc(cpu_s)
        self._peak.labels(kind).observe(peak_bytes)
