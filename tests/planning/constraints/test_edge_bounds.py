"""What is told to hold for every instant does so at dense samples, and sharply."""

import numpy as np
import pytest

from kinematics.arrays import Array
from kinematics.chain import Chain
from kinematics.forward import forward
from kinematics.robots import builtin_chain
from kinematics.trajectory import Trajectory
from planning.constrained.checker import narrowed
from planning.constraints.constraint_set import ConstraintSet
from planning.constraints.edge_bounds import (
    HOLDS,
    TOLERANCE,
    UNDECIDED,
    VIOLATED,
    hold_kernel,
    holds,
)
from planning.constraints.orientation import ConeConstraint
from planning.constraints.position import PositionConstraint
from planning.constraints.region import PlaneRegion
from planning.constraints.row import LOWER, UPPER
from tests.planning.constraints.samples import some_of_each

NAMES = ["panda", "stanford", "scara"]


def motion(chain: Chain, rng: np.random.Generator) -> Trajectory:
    scale = np.array([1.0, 0.5, 0.3, 0.1, 0.05])
    return Trajectory(
        chain.joint_names, np.array([0.0, 1.0, 1.7]), rng.normal(size=(2, chain.n, 5)) * scale
    )


def looked_at(
    chain: Chain, packed: Array, given: Trajectory, gap: float = 1e-3
) -> tuple[int, Array, Array, Array]:
    m = len(packed)
    worst, times, found = np.empty(m), np.empty(m), np.empty(4)
    verdict = hold_kernel(
        chain.model, packed, np.array(given.breaks),
        np.array(given.coefficients), np.full(m, gap), TOLERANCE, 2_000_000, worst, times, found,
    )  # fmt: skip
    return int(verdict), worst, times, found


@pytest.mark.parametrize("name", NAMES)
def test_bounds_lie_above_dense_samples_and_near_them(name: str) -> None:
    chain = builtin_chain(name)
    constraints = ConstraintSet(chain, tuple(some_of_each(chain, 1)))
    rng = np.random.default_rng(7)
    for _ in range(6):
        given = motion(chain, rng)
        sampled = constraints.residuals(given.sample(np.linspace(0.0, 1.7, 4001))).max(axis=0)
        wider = np.maximum(sampled + rng.choice([1e-3, 1e-2, 0.1]), 0.0)
        packed = np.array(constraints.packed)
        packed[:, UPPER] += wider
        packed[:, LOWER] -= wider
        verdict, worst, times, _ = looked_at(chain, packed, given)
        assert verdict == HOLDS
        assert (worst >= sampled - wider - 1e-12).all()
        # Samples may miss the top; where it was found it is that high.
        reached = np.diag(constraints.residuals(given.sample(times))) - wider
        assert (worst <= reached + 1e-3 + 1e-9).all()


@pytest.mark.parametrize("name", NAMES)
def test_the_first_violation_is_found(name: str) -> None:
    chain = builtin_chain(name)
    constraints = ConstraintSet(chain, tuple(some_of_each(chain, 2)))
    rng = np.random.default_rng(8)
    for _ in range(5):
        given = motion(chain, rng)
        times = np.linspace(0.0, 1.7, 4001)
        residuals = constraints.residuals(given.sample(times)).max(axis=1)
        assert (residuals > TOLERANCE).any()
        verdict, _, _, found = looked_at(chain, np.array(constraints.packed), given)
        assert verdict == VIOLATED
        assert found[0] <= times[np.argmax(residuals > TOLERANCE)] + 1e-3
        at = constraints.residuals(given.sample([found[0]])[0])
        assert abs(at[int(found[1])] - found[2]) < 1e-9


def test_a_violation_between_samples_is_found() -> None:
    chain = builtin_chain("planar_rr")
    aside = forward(chain, [np.pi / 2.0, 0.0])[:3, 3]
    tip = PositionConstraint(
        PlaneRegion([0.0, 0.0, 0.0], aside, 0.5 * float(np.linalg.norm(aside)))
    )
    constraints = ConstraintSet(chain, (tip,))
    # Out and back within a thousandth of the motion's time.
    times = np.array([0.0, 1.0, 1.0005, 1.001, 2.0])
    q = np.zeros((5, 2))
    high = np.linspace(0.0, 1.5, 2000)
    outside = constraints.residuals(np.column_stack([high, np.zeros_like(high)]))[:, 0] > 0.0
    q[2, 0] = high[np.argmax(outside)] + 0.01
    rates = np.diff(q, axis=0) / np.diff(times)[:, None]
    spike = Trajectory(chain.joint_names, times, np.stack([q[:-1], rates], axis=2))
    verdict, _, _, found = looked_at(chain, np.array(constraints.packed), spike)
    assert verdict == VIOLATED
    assert 1.0 < found[0] < 1.001


def test_a_bound_that_is_met_exactly_holds() -> None:
    chain = builtin_chain("panda")
    q = np.array([0.3, -0.5, 0.1, -2.0, 0.2, 1.6, 0.4])
    free = ConstraintSet(chain, (ConeConstraint([0, 0, 1], [0, 0, 1], 1.0),))
    tight = ConstraintSet(chain, (ConeConstraint([0, 0, 1], [0, 0, 1], float(free.values(q)[0])),))
    # Only the last joint turns: the axis stays where it is, on the cone.
    turn = np.zeros(7)
    turn[6] = 1.0
    assert holds(chain, tight.packed, np.column_stack([q, turn]))
    turn[5] = 0.2
    ends = [holds(chain, tight.packed, np.column_stack([q, s * turn])) for s in (1.0, -1.0)]
    assert sorted(ends) == [False, True]


def test_too_many_cells_are_told_as_undecided() -> None:
    chain = builtin_chain("panda")
    constraints = ConstraintSet(
        chain, (PositionConstraint(PlaneRegion([0, 0, 0.4], [0, 0, 1], 1.0)),)
    )
    rng = np.random.default_rng(0)
    given = motion(chain, rng)
    values = constraints.values(given.sample(np.linspace(0.0, 1.7, 100)))
    packed = np.array(constraints.packed)
    packed[:, UPPER], packed[:, LOWER] = values.max() + 1e-2, values.min() - 1e-2
    m, worst, found = 1, np.empty(1), np.empty(4)
    verdict = hold_kernel(
        chain.model, packed, np.array(given.breaks),
        np.array(given.coefficients), np.full(m, 1e-9), TOLERANCE, 20, worst, np.empty(m), found,
    )  # fmt: skip
    assert verdict == UNDECIDED


def test_narrowed_rows_keep_their_middle() -> None:
    chain = builtin_chain("panda")
    constraints = ConstraintSet(
        chain,
        (
            PositionConstraint(PlaneRegion([0, 0, 0.4], [0, 0, 1], 0.1)),
            ConeConstraint([0, 0, 1], [0, 0, 1], 0.2),
        ),
    )
    rows = narrowed(constraints, 0.25)
    np.testing.assert_allclose(rows[:, UPPER], [0.075, 0.15])
    np.testing.assert_allclose(rows[:, LOWER], [-0.075, -np.inf])
    np.testing.assert_allclose(narrowed(constraints, 0.25, 0.01)[:, UPPER], [0.09, 0.19])
