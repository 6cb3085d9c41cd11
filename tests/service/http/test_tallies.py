"""Tallies tell what the counters and histograms of Prometheus's client tell."""

import math
import random
import re

from prometheus_client import CollectorRegistry, Counter, Histogram, generate_latest

from service.http.tallies import Tally, TimeTally

LIMITS = (0.001, 0.01, 1, 60)
PLACES = ("/v1/plan", 'with "quotes"', "/v1/ik\n")


def text(registry: CollectorRegistry) -> str:
    """What is told, but for the instants at which counting began."""
    return re.sub(r"(_created\{.*\}) .*", r"\1", generate_latest(registry).decode())


def test_they_tell_what_the_client_tells() -> None:
    mine, theirs = CollectorRegistry(), CollectorRegistry()
    tally = Tally("asked", "Requests", ("place", "kind"), mine)
    times = TimeTally("seconds", "Times", ("place",), LIMITS, mine)
    counter = Counter("asked", "Requests", ("place", "kind"), registry=theirs)
    histogram = Histogram("seconds", "Times", ("place",), buckets=LIMITS, registry=theirs)
    assert text(mine) == text(theirs), "before anything is counted"
    draw = random.Random(0)
    for _ in range(500):
        place, kind = draw.choice(PLACES), draw.choice("ab")
        tally.count(place, kind)
        counter.labels(place, kind).inc()
        drawn = draw.uniform(0.0, 2.0), draw.expovariate(1.0)
        seconds = draw.choice([0.0, *LIMITS, math.inf, *drawn])
        times.observe(seconds, place)
        histogram.labels(place).observe(seconds)
    assert text(mine) == text(theirs)
