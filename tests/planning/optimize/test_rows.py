"""Linear rows of limits, ends and what is seen along a motion."""

from dataclasses import replace

import numpy as np
import pytest

from kinematics.arrays import Array
from planning.optimize.iterate import Iterate
from planning.optimize.rows import Rows, end_rows, limit_rows, local_matrix, stack_rows
from planning.optimize.spline import SplineSpace
from planning.optimize.task import End, Task
from tests.planning.optimize.motions import PANDA, SPACE, iterate, packed, task, unpacked

JERK = np.full(7, 300.0)


def limited() -> Task:
    asked = task()
    return replace(asked, bounds={**asked.bounds, "jerk": JERK})


def control_shares(at: Iterate, order: int, limits: Array) -> Array:
    """Control points of a derivative in time as shares of its limits, in the order of the rows."""
    controls = at.space.differences[order - 1] @ at.points / at.duration**order
    return np.asarray((controls / limits).ravel())


@pytest.mark.parametrize("hair", [0.0, 0.01])
def test_where_they_were_linearised_rows_are_the_limits_themselves(hair: float) -> None:
    at, asked = iterate(1), limited()
    blocks = limit_rows(asked, at, hair)
    assert len(blocks) == 6
    for i, block in enumerate(blocks):
        order, sign = 1 + i // 2, (1.0, -1.0)[i % 2]
        shares = sign * control_shares(at, order, asked.orders[order])
        room = block.upper - block.A @ packed(at)
        np.testing.assert_allclose(room, (1.0 - hair) - shares, atol=1e-12)
        assert np.isneginf(block.lower).all()


@pytest.mark.parametrize("order", [1, 2, 3])
def test_rows_are_tangent_to_the_limits_in_points_and_duration(order: int) -> None:
    """Of D P - limit T^r, in units of the limit and of T^r where it was linearised."""
    at, asked, rng = iterate(2), limited(), np.random.default_rng(order)
    block = limit_rows(asked, at, 0.0)[2 * (order - 1)]
    limits, T = asked.orders[order], at.duration
    direction = np.append(rng.normal(size=len(packed(at)) - 1), 0.0)

    def excess(step: float) -> Array:
        moved = unpacked(packed(at) + step * direction)
        rate = (moved.space.differences[order - 1] @ moved.points / limits).ravel()
        return np.asarray((rate - moved.duration**order) / T**order)

    slope = (excess(1e-6) - excess(-1e-6)) / 2e-6
    np.testing.assert_allclose(block.A @ direction, slope, atol=1e-6 * np.abs(slope).max())


def test_a_joint_without_a_limit_has_rows_that_bound_nothing() -> None:
    bounds = {**task().bounds, "jerk": np.where(np.arange(7) == 3, 50.0, np.inf)}
    jerk = limit_rows(replace(task(), bounds=bounds), iterate(3), 0.0)[4]
    touched = np.abs(jerk.A.toarray()[:, :-2]).sum(axis=1).reshape(-1, 7) > 0.0
    assert touched[:, 3].all()
    assert not np.delete(touched, 3, axis=1).any()


def test_only_ends_that_move_have_rows() -> None:
    rng = np.random.default_rng(4)
    still = End.at_rest(rng.normal(size=7), smooth=True)
    moving, turning = End(*rng.normal(size=(2, 7))), End(*rng.normal(size=(3, 7)))
    at = iterate(5)
    assert end_rows(at, still, still) == []
    assert len(end_rows(at, moving, still)) == 1
    assert len(end_rows(at, still, turning)) == 2
    assert len(end_rows(at, turning, moving)) == 3


@pytest.mark.parametrize("start", [True, False])
def test_rows_of_ends_have_the_derivatives_slopes(start: bool) -> None:
    """A z - known is (D_r P - value T^r) / T^r to first order about where it was linearised."""
    rng, at = np.random.default_rng(6), iterate(7)
    moving, still = End(*rng.normal(size=(3, 7))), End.at_rest(np.zeros(7), smooth=False)
    blocks = end_rows(at, *((moving, still) if start else (still, moving)))
    direction = np.append(rng.normal(size=len(packed(at)) - 1), 0.0)
    place = 0.0 if start else 1.0

    def off(step: float, order: int) -> Array:
        moved = unpacked(packed(at) + step * direction)
        rate = moved.sample(np.array([place]), order)[0]
        return np.asarray(rate - moving.derivatives[order] * moved.duration**order)

    for order, block in enumerate(blocks, 1):
        scale = at.duration**order
        np.testing.assert_array_equal(block.lower, block.upper)
        here = block.A @ packed(at) - block.lower
        np.testing.assert_allclose(here, off(0.0, order) / scale, atol=1e-9)
        slope = (off(1e-6, order) - off(-1e-6, order)) / (2e-6 * scale)
        np.testing.assert_allclose(block.A @ direction, slope, atol=1e-5 * np.abs(slope).max())


def test_local_rows_sum_up_what_derivatives_at_their_places_give() -> None:
    rng, at = np.random.default_rng(8), iterate(9)
    places = np.array([0.0, 0.21, 0.5, 0.99, 1.0])
    gradients = list(rng.normal(size=(3, 5, 7)))
    in_time = rng.normal(size=5)
    A = local_matrix(at, places, gradients, in_time, -0.3)
    z = rng.normal(size=len(packed(at)))
    moved = unpacked(z)
    wanted = sum((g * moved.sample(places, order)).sum(axis=1) for order, g in enumerate(gradients))
    np.testing.assert_allclose(A @ z, wanted + in_time * z[-2] - 0.3 * z[-1], atol=1e-9)
    # A place touches the control points of its piece alone.
    assert (np.diff(A.indptr) == (SPACE.degree + 1) * 7 + 2).all()
    plain = local_matrix(at, places, gradients[:1])
    np.testing.assert_array_equal(plain.toarray()[:, -2:], 0.0)


def test_no_places_give_no_rows() -> None:
    at = iterate(10)
    A = local_matrix(at, np.zeros(0), [np.zeros((0, 7))])
    assert A.shape == (0, len(packed(at)))


def test_stacked_rows_keep_their_order_and_bounds() -> None:
    first = Rows.below(np.array([[1.0, 2.0]]), np.array([3.0]))
    second = Rows(np.array([[4.0, 5.0], [6.0, 7.0]]), np.array([-1.0, 0.0]), np.array([1.0, 2.0]))
    both = stack_rows([first, second])
    np.testing.assert_array_equal(both.A.toarray(), [[1, 2], [4, 5], [6, 7]])
    np.testing.assert_array_equal(both.lower, [-np.inf, -1.0, 0.0])
    np.testing.assert_array_equal(both.upper, [3.0, 1.0, 2.0])


def test_limits_of_the_same_names_but_other_numbers_are_not_mixed_up() -> None:
    """Rows of limits are kept for the next round: by space, order and limits."""
    at, asked = iterate(11), task()
    halved = replace(asked, bounds={k: 0.5 * v for k, v in asked.bounds.items()})
    other = Iterate(SplineSpace.uniform(4, 11), at.points, at.duration)
    for _ in range(2):
        whole, half = (limit_rows(t, at, 0.0)[0] for t in (asked, halved))
        np.testing.assert_allclose(
            half.A.toarray()[:, :-2], 2.0 * whole.A.toarray()[:, :-2], atol=1e-12
        )
        again = limit_rows(asked, other, 0.0)[0]
        np.testing.assert_array_equal(again.A.toarray(), whole.A.toarray())
    assert PANDA.n == 7
