"""Transposition of vectors, and configurations on their way into lanes and back."""

import numpy as np
import pytest
from numpy.typing import NDArray

from compiled.kernel import kernel
from compiled.simd import LANES, load, store
from compiled.simd_transpose import (
    aligned_kernel,
    gather_kernel,
    load_few,
    load_rows_kernel,
    scatter_kernel,
    store_rows_kernel,
    transpose,
)

Array = NDArray[np.float64]
#: What lies beyond an array that a kernel writes to, and must stay.
UNTOUCHED = -7.0


@kernel
def transpose_kernel(values: Array, out: Array) -> None:
    store_rows_kernel(out, 0, LANES, transpose(load_rows_kernel(values, 0, LANES)))


@kernel
def few_kernel(values: Array, at: int, count: int, out: Array) -> None:
    store(out, 0, load_few(values, at, count))


def test_columns_of_eight_vectors() -> None:
    values, out = np.arange(64.0), np.empty(64)
    transpose_kernel(values, out)
    np.testing.assert_array_equal(out.reshape(8, 8), values.reshape(8, 8).T)
    np.testing.assert_array_equal(transpose(values.reshape(8, 8)), values.reshape(8, 8).T)  # type: ignore[arg-type]


@pytest.mark.parametrize("count", range(LANES + 1))
def test_few_numbers_are_followed_by_zeros(count: int) -> None:
    values, out = np.arange(1.0, 20.0), np.full(LANES, UNTOUCHED)
    few_kernel(values, 3, count, out)
    np.testing.assert_array_equal(out, [*values[3 : 3 + count], *np.zeros(LANES - count)])
    np.testing.assert_array_equal(load_few(values, 3, count), out)


@pytest.mark.parametrize("n", [1, 2, 3, 4, 5, 6, 7, 8, 9, 12, 15, 16, 17])
def test_configurations_are_laid_out_by_joints_and_back(n: int) -> None:
    q = np.random.default_rng(n).normal(size=(LANES, n))
    lanes = np.full((n + 1) * LANES, UNTOUCHED)
    gather_kernel(q, lanes[: n * LANES])
    np.testing.assert_array_equal(lanes[: n * LANES].reshape(n, LANES), q.T)
    assert (lanes[n * LANES :] == UNTOUCHED).all()
    rows = np.full((n + 1) * LANES, UNTOUCHED)
    scatter_kernel(lanes[: n * LANES], rows[: n * LANES])
    np.testing.assert_array_equal(rows[: n * LANES].reshape(LANES, n), q)
    assert (rows[n * LANES :] == UNTOUCHED).all()


@kernel
def strided_kernel(values: Array, out: Array) -> None:
    store_rows_kernel(out, 1, 9, load_rows_kernel(values, 2, 10))
    store(out, 0, load(values, 0))


def test_rows_lie_a_stride_apart() -> None:
    values, out = np.arange(90.0), np.zeros(81)
    strided_kernel(values, out)
    for k in range(1, LANES):
        np.testing.assert_array_equal(out[1 + 9 * k : 9 + 9 * k], values[2 + 10 * k : 10 + 10 * k])


@pytest.mark.parametrize("count", [1, 8, 77, 1000])
def test_room_begins_at_a_cache_line(count: int) -> None:
    rooms = [aligned_kernel(count) for _ in range(20)]
    assert {room.ctypes.data % (8 * LANES) for room in rooms} == {0}
    for number, room in enumerate(rooms):
        room[:] = number
    assert [room.shape for room in rooms] == [(count,)] * 20
    assert [set(room) for room in rooms] == [{number} for number in range(20)]
