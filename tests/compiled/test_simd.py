"""Vectors of eight numbers, each lane as one number would be; transposition into lanes and back."""

import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from compiled import simd
from compiled.compiler.fingerprint import fingerprint
from compiled.kernel import kernel
from compiled.simd import (
    LANES,
    anywhere,
    bits,
    choose,
    fill,
    first,
    floor,
    lane,
    load,
    on_stack,
    store,
)
from compiled.simd_transpose import (
    aligned_kernel,
    gather_kernel,
    scatter_kernel,
)

Array = NDArray[np.float64]
ODD = [0.0, -0.0, 1.5, -2.5, 1e-310, 1e300, np.inf, -np.inf, np.nan, 1.0 / 3.0, -1e-9, 7.0]


@kernel
def arithmetic_kernel(a: float, b: float) -> tuple[float, ...]:
    c = a + b
    c += 2
    c -= a
    c *= 0.5
    return (
        a + b, a - b, a * b, a / b, -a, abs(a), max(a, b), min(a, b), math.sqrt(a), floor(a),
        c, 3.0 * a, a - 1.0, 1 / b, max(a, 0.25), choose(a < b, a, b), choose(a >= b, a, 2.0),
        choose((a <= b) & (b > 0.5), a, -1.0), choose((a > b) | (b < 0.0), 1.0, b),
    )  # fmt: skip


@kernel
def numeric_simd_kernel(a: Array, b: Array, out: Array) -> None:
    i = 0
    for value in arithmetic_kernel(load(a, 0), load(b, 0)):
        store(out, i, value)
        i += LANES


def test_lanes_are_what_numbers_are_to_the_last_bit() -> None:
    random = np.random.default_rng(1)
    with np.errstate(all="ignore"):
        for _ in range(200):
            a, b = random.choice([*ODD, *random.normal(size=12)], (2, LANES))
            out = np.empty((19, LANES))
            numeric_simd_kernel(a, b, out.reshape(-1))
            for k in range(LANES):
                alone = np.array(arithmetic_kernel(a[k], b[k]))
                # NaN has many bit patterns, all the others are the very same.
                same = (alone.view(np.int64) == out[:, k].view(np.int64)) | np.isnan(alone)
                assert same.all()
                assert (np.isnan(alone) == np.isnan(out[:, k])).all()


@kernel
def conditions_kernel(a: Array, b: Array) -> tuple[bool, bool, int]:
    below = load(a, 3) < load(b, 3)
    return anywhere(below), anywhere(a[0] < b[0]), bits(below)


def test_conditions_as_bits_and_anywhere() -> None:
    a, b = np.zeros(11), np.zeros(11)
    assert conditions_kernel(a, b) == (False, False, 0)
    b[[4, 10]] = 1.0
    assert conditions_kernel(a, b) == (True, False, 0b10000010)
    b[0] = 1.0
    assert conditions_kernel(a, b)[1]


@kernel
def first_kernel(a: Array, out: Array) -> float:
    few = first(a)
    store(out, 1, few)
    total = 0.0
    for k in range(LANES):
        total += lane(few, k)
    return total


@pytest.mark.parametrize("count", range(1, LANES + 1))
def test_fewer_numbers_than_lanes_repeat_the_last(count: int) -> None:
    a, out = np.arange(1.0, count + 1.0), np.zeros(LANES + 2)
    assert first_kernel(a, out) == a.sum() + (LANES - count) * count
    np.testing.assert_array_equal(out[1:-1], np.minimum(np.arange(1.0, LANES + 1.0), count))
    assert out[0] == out[-1] == 0.0


_ROOM = 3 * 5


@kernel(allocates=False)
def stack_kernel(depth: int) -> float:
    """What each of some calls in calls finds in its own room."""
    room = on_stack(_ROOM).reshape((3, 5))
    for i in range(3):
        for j in range(5):
            room[i, j] = depth
    deeper = stack_kernel(depth - 1) if depth > 0 else 0.0
    return deeper + float(room[2, 4] - room[0, 0]) + float(room.sum())


def test_room_on_the_stack_is_the_own_of_each_call() -> None:
    assert stack_kernel(100) == _ROOM * 5050.0
    assert on_stack(4).shape == (4,)


def test_bodies_in_python_say_the_same() -> None:
    a = np.arange(12.0)
    np.testing.assert_array_equal(load(a, 2), a[2:10])
    store(a, 4, fill(-1.0))
    assert (a[4:] == -1.0).all()
    assert first(a[:3])[-1] == a[2]  # type: ignore[index]
    assert lane(a, 3) == 3.0  # type: ignore[arg-type]
    where: Any = a > 0.0
    assert bits(where[:LANES]) == 0b00001110
    assert anywhere(where)
    assert not anywhere(where & False)
    np.testing.assert_array_equal(floor(choose(where, 0.5, -0.5)), np.where(where, 0.0, -1.0))


def test_a_revision_makes_machine_code_stale(monkeypatch: pytest.MonkeyPatch) -> None:
    before = fingerprint(numeric_simd_kernel)
    assert fingerprint(numeric_simd_kernel) == before
    monkeypatch.setattr(simd.load, "revision", -1)
    assert fingerprint(numeric_simd_kernel) != before


#: What lies beyond an array that a kernel writes to, and must stay.
UNTOUCHED = -7.0


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


@pytest.mark.parametrize("count", [1, 8, 77, 1000])
def test_room_begins_at_a_cache_line(count: int) -> None:
    rooms = [aligned_kernel(count) for _ in range(20)]
    assert {room.ctypes.data % (8 * LANES) for room in rooms} == {0}
    for number, room in enumerate(rooms):
        room[:] = number
    assert [room.shape for room in rooms] == [(count,)] * 20
    assert [set(room) for room in rooms] == [{number} for number in range(20)]
