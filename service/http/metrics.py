"""Counters of the service, answered at ``/metrics`` in Prometheus's text format.

Labels take few values: paths are templates of routes, and methods, statuses, codes of problems and
names of stages are ours. Nothing that a caller chooses becomes a label.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

from fastapi import FastAPI
from prometheus_client import CollectorRegistry, Counter, Histogram, generate_latest
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric
from prometheus_client.registry import Collector

from service.http.errors import KINDS
from service.storage.stores.job_store import STATUSES, Status
from service.workers.supervisor import WorkerSupervisor

#: Inline kinematics take a millisecond, the longest plans minutes [s].
_SECONDS = (0.001, 0.0025, 0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5, 5, 10, 30, 60, 300)
_METHODS = ("GET", "POST", "PUT", "DELETE", "HEAD", "OPTIONS", "PATCH")
_OTHER = "other"
#: What becomes of work that workers are given, and how often workers were replaced after it.
_OUTCOMES = ("finished", "crashed", "overrun", "cancelled", "rejected", "yielded", "recycled")


class Metrics:
    """The counters of one application.

    Args:
        app: Application whose workers are counted when somebody asks.
    """

    def __init__(self, app: FastAPI) -> None:
        self.registry = CollectorRegistry()
        self._requests = Counter(
            "armwright_requests",
            "Requests that were answered",
            ("route", "method", "status"),
            registry=self.registry,
        )
        self._seconds = Histogram(
            "armwright_request_seconds",
            "Time until an answer was complete",
            ("route", "method"),
            registry=self.registry,
            buckets=_SECONDS,
        )
        self._plans = Counter(
            "armwright_plans",
            "Plans by outcome, SUCCESS or the code of the problem, and by the stage that won",
            ("code", "planner"),
            registry=self.registry,
        )
        self._audits = Counter(
            "armwright_audits",
            "Second looks at certified answers, by outcome",
            ("outcome",),
            registry=self.registry,
        )
        self._stages = Histogram(
            "armwright_stage_seconds",
            "Time that stages of planning took",
            ("stage",),
            registry=self.registry,
            buckets=_SECONDS,
        )
        self.registry.register(_State(app))

    def count_request(self, route: str, method: str, status: int, seconds: float) -> None:
        """Count a request."""
        named = method if method in _METHODS else _OTHER
        self._requests.labels(route, named, status).inc()
        self._seconds.labels(route, named).observe(seconds)

    def count_plan(self, planner: str, stages: Iterable[tuple[str, float]]) -> None:
        """Count a plan, and its stages with their durations [s]."""
        self._plans.labels("SUCCESS", planner).inc()
        self._observe(stages)

    def count_failure(self, code: str, stages: Any) -> None:
        """Count a problem in place of a plan, and its stages where they are known."""
        self._plans.labels(code if code in KINDS else _OTHER, "").inc()
        if isinstance(stages, Sequence):
            self._observe((stage["name"], 1e-3 * stage["milliseconds"]) for stage in stages)

    def count_audit(self, outcome: str) -> None:
        """Count a second look: "agreed", "disputed" or "left out"."""
        self._audits.labels(outcome).inc()

    def _observe(self, stages: Iterable[tuple[str, float]]) -> None:
        for name, seconds in stages:
            self._stages.labels(name).observe(seconds)

    def text(self, jobs: Mapping[Status, int], waiting: int | None = None) -> bytes:
        """All metrics in the text format.

        Args:
            jobs: How many there are of each status.
            waiting: Jobs and chunks of batches that wait for an agent; None without agents.
        """
        return generate_latest(self.registry) + jobs_text(jobs, waiting)


def jobs_text(jobs: Mapping[Status, int], waiting: int | None = None) -> bytes:
    """Numbers of jobs in the text format.

    Args:
        jobs: How many there are of each status.
        waiting: Jobs and chunks of batches that wait for an agent; None if that is not told.
    """
    counts = CollectorRegistry()
    counts.register(_Jobs(jobs, waiting))
    return generate_latest(counts)


class _State(Collector):
    """The state of the workers, read when metrics are asked for."""

    def __init__(self, app: FastAPI) -> None:
        self._app = app

    def collect(self) -> Iterator[Metric]:
        supervisor: WorkerSupervisor | None = getattr(self._app.state, "supervisor", None)
        if supervisor is None:
            return
        queue = GaugeMetricFamily(
            "armwright_queue_length", "Work that waits for a worker", labels=("kind",)
        )
        queue.add_metric(["interactive"], supervisor.waiting)
        queue.add_metric(["background"], supervisor.background_waiting)
        yield queue
        workers = GaugeMetricFamily("armwright_workers", "Worker processes", labels=("state",))
        workers.add_metric(["wanted"], supervisor.count)
        workers.add_metric(["alive"], supervisor.alive)
        workers.add_metric(["busy"], supervisor.busy)
        workers.add_metric(["spare"], supervisor.spare)
        yield workers
        counters = supervisor.counters
        yield CounterMetricFamily(
            "armwright_worker_starts",
            "Worker processes that were started; beyond the first ones, replacements",
            supervisor.started_workers,
        )
        outcomes = CounterMetricFamily(
            "armwright_work", "Work given to workers, by what became of it", labels=("outcome",)
        )
        for outcome in _OUTCOMES:
            outcomes.add_metric([outcome], getattr(counters, outcome))
        yield outcomes


class _Jobs(Collector):
    """Jobs by status."""

    def __init__(self, counts: Mapping[Status, int], waiting: int | None) -> None:
        self._counts = counts
        self._waiting = waiting

    def collect(self) -> Iterator[Metric]:
        family = GaugeMetricFamily("armwright_jobs", "Jobs that are kept", labels=("status",))
        for status in STATUSES:
            family.add_metric([status], self._counts[status])
        yield family
        if self._waiting is not None:
            yield GaugeMetricFamily(
                "armwright_agent_queue_length",
                "Jobs and chunks of batches that wait for an agent",
                self._waiting,
            )
