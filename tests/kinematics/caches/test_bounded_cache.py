"""Caches bounded by memory: what is kept, what is dropped, and that memory is given back."""

import gc
import resource
from pathlib import Path
from typing import Any, NamedTuple

import casadi
import numpy as np
import pytest

from dynamics.symbolic import symbolic_inverse_dynamics
from kinematics.arrays import Array
from kinematics.caches import bounded_cache as module
from kinematics.caches.bounded_cache import allocated_bytes, array_bytes, bounded_cache
from kinematics.model.chain import Chain
from tests.dynamics.samples import random_chain

MEBIBYTE = 2**20


def resident() -> int:
    return int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize()


def test_what_is_allocated_is_seen_and_what_is_freed_too() -> None:
    before = allocated_bytes()
    block = np.ones(5 * MEBIBYTE // 8)
    assert abs(allocated_bytes() - before - block.nbytes) < 0.1 * MEBIBYTE
    del block
    assert abs(allocated_bytes() - before) < 0.1 * MEBIBYTE


def test_memory_stays_within_the_limit_while_values_come_and_go() -> None:
    made: list[int] = []

    @bounded_cache(maxsize=1000, limit=8 * MEBIBYTE)
    def block(number: int) -> "np.ndarray[tuple[int], np.dtype[np.float64]]":
        made.append(number)
        return np.full(MEBIBYTE // 8, float(number))

    before, first = allocated_bytes(), resident()
    for number in range(200):
        assert block(number)[0] == number
        assert block(number) is block(number)
        assert allocated_bytes() - before < 8.5 * MEBIBYTE
    assert resident() - first < 12 * MEBIBYTE
    assert made == list(range(200)), "what was asked for last is kept"


def test_arrays_in_tuples_are_weighed_without_measuring() -> None:
    class Two(NamedTuple):
        block: Array
        rest: tuple[Array | None, float]

    two = Two(np.zeros((3, 4)), (np.zeros(5), 1.0))
    assert array_bytes(two) == 8 * 17
    assert array_bytes((None, "text")) == 0
    made: list[int] = []

    @bounded_cache(maxsize=1000, limit=8 * MEBIBYTE, weigh=array_bytes)
    def block(number: int) -> Two:
        made.append(number)
        return Two(np.full(MEBIBYTE // 8, float(number)), (None, 0.0))

    for number in range(9):
        block(number)
    assert made == list(range(9))
    assert block.cache_info().currsize == 1, "all older ones were dropped"


def test_small_values_are_bounded_by_their_number() -> None:
    @bounded_cache(maxsize=3)
    def twice(number: int) -> int:
        return 2 * number

    for number in range(10):
        assert twice(number) == 2 * number
    assert twice.cache_info().currsize == 3


def test_one_value_beyond_the_limit_is_kept_alone() -> None:
    @bounded_cache(maxsize=10, limit=MEBIBYTE)
    def block(size: int) -> "np.ndarray[tuple[int], np.dtype[np.float64]]":
        return np.zeros(size)

    small, large = block(10), block(MEBIBYTE)
    assert block(MEBIBYTE) is large
    assert block(10) is not small


def test_keys_count_too() -> None:
    @bounded_cache(maxsize=1000, limit=4 * MEBIBYTE)
    def length(key: bytes) -> int:
        return len(key)

    before = allocated_bytes()
    for number in range(50):
        assert length(number.to_bytes(4, "big") * (MEBIBYTE // 4)) == MEBIBYTE
        assert allocated_bytes() - before < 5.5 * MEBIBYTE


def test_a_failure_is_not_kept() -> None:
    @bounded_cache(maxsize=10)
    def half(number: int) -> int:
        if number % 2:
            raise ValueError(number)
        return number // 2

    with pytest.raises(ValueError, match="3"):
        half(3)
    assert (half(4), half.cache_info().currsize) == (2, 1)


def test_without_the_c_library_s_word_the_number_bounds(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "_mallinfo", lambda: None)

    @bounded_cache(maxsize=2, limit=1)
    def block(number: int) -> "np.ndarray[tuple[int], np.dtype[np.float64]]":
        return np.full(1000, float(number))

    assert allocated_bytes() == 0
    for number in range(5):
        assert block(number)[0] == number
    assert block.cache_info().currsize == 2


def test_programs_of_many_robots_take_bounded_memory() -> None:
    def function(chain: Chain) -> Any:
        symbols = [casadi.SX.sym(name, chain.n) for name in ("q", "qd", "qdd")]
        torque = symbolic_inverse_dynamics(chain, *symbols)
        slopes = casadi.jacobian(torque, casadi.vertcat(*symbols))
        return casadi.Function("equations", symbols, [torque, slopes])

    function(random_chain(0, 4))  # what is loaded once
    limit = MEBIBYTE
    equations = bounded_cache(64, limit)(function)
    gc.collect()  # what others left does not count
    before, most = allocated_bytes(), 0
    for seed in range(12):
        equations(random_chain(seed, 4))
        most = max(most, allocated_bytes() - before)
    assert most < 1.7 * limit
    assert 0 < equations.cache_info().currsize < 12
