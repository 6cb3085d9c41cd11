"""Bounds over cells of time and verdicts on edges beside dense samples, and sharp."""

import numpy as np
import pytest
from numpy.polynomial import polynomial as power_basis

from kinematics.arrays import Array
from kinematics.forward import forward, frames_kernel
from kinematics.model.chain import Chain
from kinematics.robots import builtin_chain
from kinematics.tree.serial_chain import serial_chain
from kinematics.urdf.urdf import parse_urdf
from planning.constraints.constraint_set import ConstraintSet
from planning.constraints.edge_bounds import (
    TOLERANCE,
    EdgeVerdict,
    bound_kernel,
    edge_holds,
    edge_kernel,
    expand_kernel,
)
from planning.constraints.kinds.constraint import ConeConstraint, PositionConstraint
from planning.constraints.kinds.region import PlaneRegion
from planning.constraints.row import Column
from tests.dynamics.samples import random_chain
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


#: A turntable with a slide across it.
POLAR = """<robot name="polar"><link name="base"/><link name="table"/><link name="tip"/>
<joint name="turn" type="revolute"><parent link="base"/><child link="table"/><axis xyz="0 0 1"/>
<limit lower="-3" upper="3" velocity="1" effort="1"/></joint>
<joint name="out" type="prismatic"><parent link="table"/><child link="tip"/><axis xyz="1 0 0"/>
<limit lower="-1" upper="1" velocity="1" effort="1"/></joint></robot>"""
CELL_CHAINS = [builtin_chain("panda"), builtin_chain("stanford"), random_chain(2, 5)]


def cubic_curve(chain: Chain, rng: np.random.Generator) -> Array:
    return np.asarray(rng.normal(size=(chain.n, 4)) * np.array([1.0, 0.6, 0.4, 0.2]))


def bounds(chain: Chain, packed: Array, curve: Array, middle: float, half: float) -> Array:
    """Residual in the middle and bound over the cell of each row, shape (m, 2)."""
    q, linear, curved = np.empty(chain.n), np.empty(chain.n), np.empty(chain.n)
    expand_kernel(curve, middle, half, q, linear, curved)
    frames = np.empty((chain.n, 4, 4))
    frames_kernel(chain.model, q, frames)
    E = np.empty((3, 3))
    return np.array(
        [bound_kernel(chain.model, q, frames, row, linear, curved, E) for row in packed]
    )


@pytest.mark.parametrize("chain", CELL_CHAINS, ids=lambda chain: chain.name)
@pytest.mark.parametrize("half", [0.5, 0.1, 0.01])
def test_no_sample_of_a_cell_is_above_its_bound(chain: Chain, half: float) -> None:
    constraints = ConstraintSet(chain, tuple(some_of_each(chain, 5)))
    packed, rng = np.array(constraints.packed), np.random.default_rng(6)
    for _ in range(8):
        curve, middle = cubic_curve(chain, rng), rng.uniform(half, 1.0 - half)
        found = bounds(chain, packed, curve, middle, half)
        times = middle + half * np.linspace(-1.0, 1.0, 401)
        samples = constraints.residuals(power_basis.polyval(times, curve.T).T)
        np.testing.assert_allclose(found[:, 0], samples[200], atol=1e-9)
        assert (samples.max(axis=0) <= found[:, 1] + 1e-9).all()


def test_a_slide_that_turns_while_it_moves_out_is_bounded() -> None:
    """From the middle of a turntable, y = r sin(theta): no velocity there, only the product."""
    chain = serial_chain(parse_urdf(POLAR))
    slab = ConstraintSet(chain, (PositionConstraint(PlaneRegion([0, 0, 0], [0, 1, 0], 0.0)),))
    for out, turn in ((0.5, 0.2), (0.2, 0.5), (0.1, 0.1)):
        curve = np.array([[0.0, turn], [0.0, out]])
        q, linear, curved = np.zeros(2), curve[:, 1], np.zeros(2)
        frames = np.empty((2, 4, 4))
        frames_kernel(chain.model, q, frames)
        row = np.array(slab.packed)[0]
        _, bound = bound_kernel(chain.model, q, frames, row, linear, curved, np.empty((3, 3)))
        highest = out * np.sin(turn)
        assert highest <= bound <= 1.3 * out * turn
