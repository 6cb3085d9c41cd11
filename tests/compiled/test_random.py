"""The generator beside its definition in Python integers, and its uniformity."""

import numpy as np
import pytest
from scipy.stats import kstest

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
