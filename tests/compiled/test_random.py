"""The generator beside its definition in Python integers, and its uniformity."""

import numpy as np
import pytest
from scipy.stats import chisquare, kstest

from compiled.random import uniform_kernel

MASK = 2**64 - 1


def splitmix64(state: int) -> tuple[int, int]:
    """The published recurrence: the next state and the output."""
    state = (state + 0x9E3779B97F4A7C15) & MASK
    x = ((state ^ (state >> 30)) * 0xBF58476D1CE4E5B9) & MASK
    x = ((x ^ (x >> 27)) * 0x94D049BB133111EB) & MASK
    return state, x ^ (x >> 31)


@pytest.mark.parametrize("seed", [0, 1, 1234567, MASK])
def test_numbers_are_those_of_the_definition(seed: int) -> None:
    state, expected = np.array([seed], dtype=np.uint64), seed
    for _ in range(100):
        expected, x = splitmix64(expected)
        assert uniform_kernel(state) == (x >> 11) / 2**53
    assert int(state[0]) == expected


def test_the_published_first_outputs_of_a_seed() -> None:
    # Of the reference implementation in C for the seed 1234567.
    outputs, state = [], 1234567
    for _ in range(3):
        state, x = splitmix64(state)
        outputs.append(x)
    assert outputs == [6457827717110365317, 3203168211198807973, 9817491932198370423]


def test_numbers_are_uniform() -> None:
    state = np.zeros(1, dtype=np.uint64)
    drawn = [uniform_kernel(state) for _ in range(20_000)]
    assert kstest(drawn, "uniform").pvalue > 1e-3
    assert abs(np.corrcoef(drawn[:-1], drawn[1:])[0, 1]) < 0.03


def drawn(seed: int, count: int) -> list[float]:
    """Numbers of a generator."""
    state = np.array([seed], dtype=np.uint64)
    return [uniform_kernel(state) for _ in range(count)]


def test_every_number_is_at_least_0_and_below_1_in_steps_of_the_last_digit() -> None:
    numbers = drawn(7, 5000)
    assert min(numbers) >= 0.0
    assert max(numbers) < 1.0
    assert all((x * 2.0**53).is_integer() for x in numbers)
    # The last digit is drawn, too.
    assert 0.4 < np.mean([x * 2.0**53 % 2.0 for x in numbers]) < 0.6


@pytest.mark.parametrize("seed", [0, 1, 2**63, MASK])
def test_pairs_fill_the_square_evenly(seed: int) -> None:
    numbers = np.array(drawn(seed, 8000)).reshape(-1, 2)
    counts, _, _ = np.histogram2d(numbers[:, 0], numbers[:, 1], bins=8, range=[[0, 1], [0, 1]])
    assert chisquare(counts.ravel()).pvalue > 1e-3


def test_neighbouring_seeds_draw_unlike_numbers() -> None:
    rows = np.array([drawn(seed, 400) for seed in range(6)])
    others = np.corrcoef(rows)[np.triu_indices(6, 1)]
    assert np.abs(others).max() < 0.2


def test_the_state_alone_decides_what_comes_next() -> None:
    state = np.array([5], dtype=np.uint64)
    first = [uniform_kernel(state) for _ in range(3)]
    again = state.copy()
    assert uniform_kernel(state) == uniform_kernel(again)
    assert first == drawn(5, 3)
