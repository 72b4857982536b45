"""One process's Prometheus metrics: a registry of its own, and a port of their own."""

from __future__ import annotations

from prometheus_client import CollectorRegistry, ProcessCollector, start_http_server


class Exposed:
    """Hold the metrics of one process, in a registry of its own."""

    def __init__(self) -> None:
        self._registry = CollectorRegistry(auto_describe=False)
        ProcessCollector(registry=self._registry)

    def serve(self, host: str, port: int) -> None:
        """Give the metrics at a port of their own, from a thread that ends with the process.

        Raises
        ------
        OSError
            If the port is taken.
        """
        start_http_server(port, addr=host, registry=self._registry)
