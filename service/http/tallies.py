"""Counters and histograms of one thread, in the form that Prometheus's client collects.

The client's own take a lock for each number, and go through the limits of a histogram one by one:
to count a plan by them costs as much as to send its answer.
"""

import time
from bisect import bisect_left
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import accumulate

from prometheus_client.core import Metric
from prometheus_client.registry import Collector, CollectorRegistry
from prometheus_client.utils import floatToGoString

_INFINITE = float("inf")


@dataclass(slots=True)
class _Counted:
    """One count, and since when there is one."""

    value: float = 0.0
    created: float = field(default_factory=time.time)


class Tally(Collector):
    """A counter.

    Args:
        name: Of the metric.
        documentation: Of the metric.
        labels: Their names.
        registry: What collects it.
    """

    def __init__(
        self, name: str, documentation: str, labels: Sequence[str], registry: CollectorRegistry
    ) -> None:
        self._name = name
        self._documentation = documentation
        self._labels = labels
        self._counts: dict[tuple[str, ...], _Counted] = {}
        registry.register(self)

    def count(self, *values: str) -> None:
        """Count one, with values of the labels in their order."""
        counted = self._counts.get(values)
        if counted is None:
            counted = self._counts[values] = _Counted()
        counted.value += 1.0

    def collect(self) -> Iterator[Metric]:
        """The counts."""
        metric = Metric(self._name, self._documentation, "counter")
        for values, counted in self._counts.items():
            labels = dict(zip(self._labels, values, strict=True))
            metric.add_sample(f"{self._name}_total", labels, counted.value)
            metric.add_sample(f"{self._name}_created", labels, counted.created)
        yield metric


@dataclass(slots=True)
class _Times:
    """Counts of times between limits, the sum of all, and since when there are any."""

    counts: list[int]
    sum: float = 0.0
    created: float = field(default_factory=time.time)


class TimeTally(Collector):
    """A histogram of times.

    Args:
        name: Of the metric.
        documentation: Of the metric.
        labels: Their names.
        limits: Upper limits of what is counted together, ascending [s].
        registry: What collects it.
    """

    def __init__(
        self,
        name: str,
        documentation: str,
        labels: Sequence[str],
        limits: Sequence[float],
        registry: CollectorRegistry,
    ) -> None:
        self._name = name
        self._documentation = documentation
        self._labels = labels
        self._limits = [*map(float, limits), _INFINITE]
        self._times: dict[tuple[str, ...], _Times] = {}
        registry.register(self)

    def observe(self, seconds: float, *values: str) -> None:
        """Note a time [s], with values of the labels in their order."""
        times = self._times.get(values)
        if times is None:
            times = self._times[values] = _Times([0] * len(self._limits))
        times.counts[bisect_left(self._limits, seconds)] += 1
        times.sum += seconds

    def collect(self) -> Iterator[Metric]:
        """The counts below each limit, and the sums."""
        metric = Metric(self._name, self._documentation, "histogram")
        for values, times in self._times.items():
            labels = dict(zip(self._labels, values, strict=True))
            below = [float(count) for count in accumulate(times.counts)]
            for limit, count in zip(self._limits, below, strict=True):
                told: str = floatToGoString(limit)  # type: ignore[no-untyped-call]
                metric.add_sample(f"{self._name}_bucket", labels | {"le": told}, count)
            metric.add_sample(f"{self._name}_count", labels, below[-1])
            metric.add_sample(f"{self._name}_sum", labels, times.sum)
            metric.add_sample(f"{self._name}_created", labels, times.created)
        yield metric
