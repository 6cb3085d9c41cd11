"""Stopping rules of a planner, one at a time."""

import math

import pytest

from planning.sampling import watch as module
from planning.sampling.watch import Watch
from planning.values.deadline import Deadline

LATER = 1000.0


class Edges:
    """A count of edges that a test sets."""

    count = 0

    def __call__(self) -> int:
        return self.count


def test_it_stops_when_time_is_up() -> None:
    assert not Watch(Deadline.after(LATER), Edges())()
    late = Watch(Deadline.after(-1.0), Edges())
    assert late()
    assert late.reason == "time"


def test_it_stops_after_so_many_questions() -> None:
    watch = Watch(Deadline.after(LATER), Edges(), max_iterations=3)
    assert [watch() for _ in range(4)] == [False, False, True, True]
    assert watch.reason == "iterations"
    assert watch.iterations == 3, "a question after the end is not counted"


def test_it_stops_after_so_many_edges() -> None:
    edges = Edges()
    watch = Watch(Deadline.after(LATER), edges, max_edges=10)
    edges.count = 9
    assert not watch()
    edges.count = 10
    assert watch()
    assert watch.reason == "edges"


@pytest.mark.parametrize("rule", ["share", "turn"])
def test_a_run_without_a_path_ends_with_its_share(rule: str) -> None:
    edges = Edges()
    share, turn = (5.0, math.inf) if rule == "share" else (math.inf, 1.0)
    watch = Watch(Deadline.after(LATER), edges, share=share, turn=turn)
    edges.count = 5
    assert watch()
    assert watch.reason == "share"
    going_on = Watch(Deadline.after(LATER), edges, share=share, turn=turn)
    going_on.note(2.0)
    assert not going_on(), "a run that has a path goes on for a shorter one"


def test_progress_keeps_shorter_paths_only() -> None:
    edges = Edges()
    watch = Watch(Deadline.after(LATER), edges)
    for count, length in enumerate((math.inf, 0.0, 3.0, 3.0, 3.0 * (1.0 - 1e-9), 2.0, 2.5, 1.0)):
        edges.count = count
        watch.note(length)
    assert [item.length for item in watch.progress] == [3.0, 2.0, 1.0]
    assert [item.edges for item in watch.progress] == [2, 5, 7]
    assert all(item.milliseconds >= 0.0 for item in watch.progress)


def test_a_path_that_is_short_enough_ends_it() -> None:
    lengths = iter((3.0, 2.0, 1.5))
    watch = Watch(Deadline.after(LATER), Edges(), threshold=2.0, best=lambda: next(lengths))
    assert [watch(), watch()] == [False, True]
    assert watch.reason == "threshold"


def test_memory_is_looked_at_now_and_then(monkeypatch: pytest.MonkeyPatch) -> None:
    watch = Watch(Deadline.after(LATER), Edges())
    full = watch.memory + module.MAX_MEMORY
    monkeypatch.setattr(module, "resident", lambda: full)
    assert not any(watch() for _ in range(2000)), "just full is not too full"
    monkeypatch.setattr(module, "resident", lambda: full + 1)
    asked = next(k for k in range(1, 2000) if watch())
    assert asked <= 512
    assert watch.reason == "memory"


def test_memory_of_this_process() -> None:
    assert 1 << 20 < module.resident() < 1 << 40
