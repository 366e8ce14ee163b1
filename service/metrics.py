"""What the service counts about itself, for Prometheus."""

from __future__ import annotations

from collections.abc import Mapping
from typing import get_args

from prometheus_client import CollectorRegistry, Counter, Gauge, Histogram, generate_latest

from service.domain import EditStatus

BUCKETS = (0.005, 0.02, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5, 5.0, 10.0, 30.0, 60.0)


class Metrics:
    """One app's counters, in their own registry."""

    def __init__(self) -> None:
        self.registry = CollectorRegistry()
        self._requests = Counter(
            "quasiface_http_requests",
            "HTTP requests by method, route and status",
            ("method", "route", "status"),
            registry=self.registry,
        )
        self._seconds = Histogram(
            "quasiface_http_request_seconds",
            "Seconds until a response was complete",
            ("method", "route"),
            buckets=BUCKETS,
            registry=self.registry,
        )
        self._edits = Gauge(
            "quasiface_edits", "Edits by status", ("status",), registry=self.registry
        )

    def request(self, method: str, route: str, status: int, seconds: float) -> None:
        """Count a request."""
        self._requests.labels(method, route, str(status)).inc()
        self._seconds.labels(method, route).observe(seconds)

    def exposition(self, edits: Mapping[str, int]) -> bytes:
        """Everything counted so far, and ``edits`` by status, as Prometheus reads it."""
        for status in get_args(EditStatus):
            self._edits.labels(status).set(edits.get(status, 0))
        return generate_latest(self.registry)
