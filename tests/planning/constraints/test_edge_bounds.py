"""Verdicts on edges agree with dense samples, and are sharp."""

import numpy as np
import pytest
from numpy.polynomial import polynomial as power_basis

from kinematics.arrays import Array
from kinematics.forward import forward
from kinematics.model.chain import Chain
from kinematics.robots import builtin_chain
from planning.constrained.checker import narrow_rows
from planning.constraints.constraint_set import ConstraintSet
from planning.constraints.edge_bounds import TOLERANCE, EdgeVerdict, edge_holds, edge_kernel
from planning.constraints.kinds.orientation import ConeConstraint
from planning.constraints.kinds.position import PositionConstraint
from planning.constraints.kinds.region import PlaneRegion
from planning.constraints.row import Column
from tests.planning.constraints.samples import some_of_each

NAMES = ["panda", "stanford", "scara"]


def random_curve(chain: Chain, rng: np.random.Generator) -> Array:
    return np.asarray(rng.normal(size=(chain.n, 5)) * np.array([1.0, 0.5, 0.3, 0.1, 0.05]))


def sampled(curve: Array, times: Array) -> Array:
    return np.asarray(power_basis.polyval(times, curve.T).T)


def verdict_on(
    chain: Chain, packed: Array, curve: Array, max_cells: int = 200_000
) -> tuple[int, float]:
    verdict, time = edge_kernel(chain.model, packed, curve, max_cells)
    return int(verdict), float(time)


@pytest.mark.parametrize("name", NAMES)
def test_edges_hold_that_dense_samples_keep_and_no_others(name: str) -> None:
    chain = builtin_chain(name)
    constraints = ConstraintSet(chain, tuple(some_of_each(chain, 1)))
    rng = np.random.default_rng(7)
    for _ in range(6):
        curve = random_curve(chain, rng)
        highest = constraints.residuals(sampled(curve, np.linspace(0.0, 1.0, 4001))).max(axis=0)
        for spare, expected in ((1e-3, EdgeVerdict.HOLDS), (-1e-4, EdgeVerdict.VIOLATED)):
            packed = np.array(constraints.packed)
            packed[:, Column.UPPER] += highest + spare
            packed[:, Column.LOWER] -= highest + spare
            assert verdict_on(chain, packed, curve)[0] == expected
            assert edge_holds(chain, packed, curve) == (expected == EdgeVerdict.HOLDS)


@pytest.mark.parametrize("name", NAMES)
def test_the_first_violation_is_found(name: str) -> None:
    chain = builtin_chain(name)
    constraints = ConstraintSet(chain, tuple(some_of_each(chain, 2)))
    rng = np.random.default_rng(8)
    times = np.linspace(0.0, 1.0, 4001)
    for _ in range(5):
        curve = random_curve(chain, rng)
        residuals = constraints.residuals(sampled(curve, times)).max(axis=1)
        assert (residuals > TOLERANCE).any()
        verdict, time = verdict_on(chain, np.array(constraints.packed), curve)
        assert verdict == EdgeVerdict.VIOLATED
        assert time <= times[np.argmax(residuals > TOLERANCE)] + 1e-3
        assert constraints.residuals(sampled(curve, np.array([time])))[0].max() > TOLERANCE


def test_a_violation_between_samples_is_found() -> None:
    chain = builtin_chain("planar_rr")
    aside = forward(chain, [np.pi / 2.0, 0.0])[:3, 3]
    tip = PositionConstraint(
        PlaneRegion([0.0, 0.0, 0.0], aside, 0.5 * float(np.linalg.norm(aside)))
    )
    constraints = ConstraintSet(chain, (tip,))
    high = np.linspace(0.0, 1.5, 2000)
    outside = constraints.residuals(np.column_stack([high, np.zeros_like(high)]))[:, 0] > 0.0
    top = high[np.argmax(outside)] + 1e-4
    # q_0 = top - 0.3 (s - 0.28)^2, outside between two samples only.
    curve = np.array([[top - 0.3 * 0.28**2, 0.6 * 0.28, -0.3], [0.0, 0.0, 0.0]])
    coarse = constraints.residuals(sampled(curve, np.linspace(0.0, 1.0, 17)))
    assert coarse.max() < 0.0
    verdict, time = verdict_on(chain, np.array(constraints.packed), curve)
    assert verdict == EdgeVerdict.VIOLATED
    assert abs(time - 0.28) < 0.03


def test_a_bound_that_is_met_exactly_holds() -> None:
    chain = builtin_chain("panda")
    q = np.array([0.3, -0.5, 0.1, -2.0, 0.2, 1.6, 0.4])
    free = ConstraintSet(chain, (ConeConstraint([0, 0, 1], [0, 0, 1], 1.0),))
    tight = ConstraintSet(chain, (ConeConstraint([0, 0, 1], [0, 0, 1], float(free.values(q)[0])),))
    # Only the last joint turns: the axis stays where it is, on the cone.
    turn = np.zeros(7)
    turn[6] = 1.0
    assert edge_holds(chain, tight.packed, np.column_stack([q, turn]))
    turn[5] = 0.2
    ends = [edge_holds(chain, tight.packed, np.column_stack([q, s * turn])) for s in (1.0, -1.0)]
    assert sorted(ends) == [False, True]


def test_too_many_cells_are_told_as_undecided() -> None:
    chain = builtin_chain("panda")
    constraints = ConstraintSet(
        chain, (PositionConstraint(PlaneRegion([0, 0, 0.4], [0, 0, 1], 1.0)),)
    )
    curve = random_curve(chain, np.random.default_rng(0))
    values = constraints.values(sampled(curve, np.linspace(0.0, 1.0, 100)))
    packed = np.array(constraints.packed)
    packed[:, Column.UPPER], packed[:, Column.LOWER] = values.max() + 1e-5, values.min() - 1e-5
    assert verdict_on(chain, packed, curve, max_cells=5)[0] == EdgeVerdict.UNDECIDED
    assert verdict_on(chain, packed, curve)[0] == EdgeVerdict.HOLDS


def test_narrowed_rows_keep_their_middle() -> None:
    chain = builtin_chain("panda")
    constraints = ConstraintSet(
        chain,
        (
            PositionConstraint(PlaneRegion([0, 0, 0.4], [0, 0, 1], 0.1)),
            ConeConstraint([0, 0, 1], [0, 0, 1], 0.2),
        ),
    )
    rows = narrow_rows(constraints, 0.25)
    np.testing.assert_allclose(rows[:, Column.UPPER], [0.075, 0.15])
    np.testing.assert_allclose(rows[:, Column.LOWER], [-0.075, -np.inf])
    np.testing.assert_allclose(narrow_rows(constraints, 0.25, 0.01)[:, Column.UPPER], [0.09, 0.19])
