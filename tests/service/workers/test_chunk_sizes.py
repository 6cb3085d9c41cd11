"""Sizes of chunks: all problems, a few seconds each, small at the end."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from service.workers.chunk_sizes import LONGEST, SHORTEST, Pace, chunk_sizes


@given(
    count=st.integers(1, 3000),
    mean=st.floats(1e-4, 100.0),
    workers=st.integers(1, 16),
    agents=st.integers(1, 20),
)
def test_chunks_hold_all_problems_and_take_neither_too_long_nor_too_short(
    count: int, mean: float, workers: int, agents: int
) -> None:
    pace = Pace(mean, workers, workers * agents)
    sizes = chunk_sizes(count, pace)
    assert sum(sizes) == count
    assert min(sizes) >= 1
    assert sizes == sorted(sizes, reverse=True), "the last ones are the smallest"
    seconds = [size * mean / workers for size in sizes]
    # One problem for each worker may take longer than any chunk should.
    assert max(seconds) <= max(LONGEST + mean / workers, mean) * (1.0 + 1e-9)
    for size, duration in zip(sizes[:-1], seconds[:-1], strict=True):
        assert duration >= SHORTEST * (1.0 - 1e-9)
        assert size >= workers, "no worker is left without a problem"


def test_a_batch_of_half_a_second_stays_whole() -> None:
    assert chunk_sizes(40, Pace(0.01, 1, 2)) == [40]


def test_two_agents_get_equal_shares_of_a_batch() -> None:
    sizes = chunk_sizes(1000, Pace(0.01, 1, 2))
    loads = [0, 0]
    for size in sizes:  # each takes the next chunk when it is free
        loads[loads.index(min(loads))] += size
    assert max(loads) == pytest.approx(500, abs=50)
    assert max(sizes) == 250


def test_chunks_of_unknown_workers_are_those_of_one_agent() -> None:
    assert chunk_sizes(100, Pace(1.0, 2, 0)) == chunk_sizes(100, Pace(1.0, 2, 2))
