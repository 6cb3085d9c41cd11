"""Poses shared among threads: every pose once, errors told, the caller at work too."""

import threading
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from kinematics.ik import batch
from kinematics.ik.batch import processors, shared


def slices(count: int, threads: int | None) -> list[tuple[int, int]]:
    """Begin and end of the parts in order."""
    parts: list[tuple[int, int]] = []
    shared(lambda part: parts.append((part.start, part.stop)), count, threads)
    return sorted(parts)


@given(st.integers(0, 3000), st.integers(1, 6))
def test_the_parts_are_the_whole_range_once(count: int, threads: int) -> None:
    parts = slices(count, threads)
    assert parts[0][0] == 0
    assert parts[-1][1] == count
    assert all(one[1] == other[0] for one, other in pairwise(parts))
    sizes = [end - begin for begin, end in parts]
    assert max(sizes) - min(sizes) <= 1
    assert len(parts) <= threads


def test_the_threads_are_those_of_the_processors_where_none_are_named(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(batch, "processors", lambda: 3)
    assert len(slices(10_000, None)) == 3
    assert len(slices(10_000, 0)) == 3


def test_the_parts_run_side_by_side_and_one_in_the_callers_thread() -> None:
    barrier, names = threading.Barrier(3, timeout=10.0), set()

    def part(_: slice) -> None:
        barrier.wait()  # nobody passes before all three are here
        names.add(threading.get_ident())

    shared(part, 300, 3)
    assert len(names) == 3
    assert threading.get_ident() in names


@pytest.mark.parametrize("failing", [0, 1, 2])
def test_an_error_of_any_part_reaches_the_caller(failing: int) -> None:
    def part(some: slice) -> None:
        if some.start == failing * 100:
            raise ValueError(f"part {failing}")

    with pytest.raises(ValueError, match=f"part {failing}"):
        shared(part, 300, 3)


def test_processors_are_those_that_this_process_may_use(monkeypatch: pytest.MonkeyPatch) -> None:
    assert processors() >= 1
    monkeypatch.setattr("os.sched_getaffinity", lambda _: {4, 7}, raising=False)
    assert processors() == 2
    monkeypatch.delattr("os.sched_getaffinity")
    monkeypatch.setattr("os.cpu_count", lambda: 5)
    assert processors() == 5
    monkeypatch.setattr("os.cpu_count", lambda: None)
    assert processors() == 1
