"""Bounds over single cells of time: never below dense samples, and tight on small cells."""

import numpy as np
import pytest
from numpy.polynomial import Polynomial
from numpy.polynomial import polynomial as power_basis

from kinematics.arrays import Array
from kinematics.forward import forward, frames_kernel
from kinematics.model.chain import Chain
from kinematics.robots import builtin_chain
from kinematics.tree.serial_chain import serial_chain
from kinematics.urdf.urdf import parse_urdf
from planning.constraints.constraint_set import ConstraintSet
from planning.constraints.edge_bounds import bound_kernel, expand_kernel
from planning.constraints.kinds.orientation import ConeConstraint
from planning.constraints.kinds.position import PositionConstraint
from planning.constraints.kinds.region import PlaneRegion
from planning.constraints.row import Column, RowKind
from tests.dynamics.samples import random_chain
from tests.planning.constraints.samples import some_of_each

#: A turntable with a slide across it.
POLAR = """<robot name="polar"><link name="base"/><link name="table"/><link name="tip"/>
<joint name="turn" type="revolute"><parent link="base"/><child link="table"/><axis xyz="0 0 1"/>
<limit lower="-3" upper="3" velocity="1" effort="1"/></joint>
<joint name="out" type="prismatic"><parent link="table"/><child link="tip"/><axis xyz="1 0 0"/>
<limit lower="-1" upper="1" velocity="1" effort="1"/></joint></robot>"""
CHAINS = [builtin_chain("panda"), builtin_chain("stanford"), random_chain(2, 5)]


def random_curve(chain: Chain, rng: np.random.Generator) -> Array:
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


@pytest.mark.parametrize("chain", CHAINS, ids=lambda chain: chain.name)
@pytest.mark.parametrize("half", [0.5, 0.1, 0.01])
def test_no_sample_of_a_cell_is_above_its_bound(chain: Chain, half: float) -> None:
    constraints = ConstraintSet(chain, tuple(some_of_each(chain, 5)))
    packed, rng = np.array(constraints.packed), np.random.default_rng(6)
    for _ in range(8):
        curve, middle = random_curve(chain, rng), rng.uniform(half, 1.0 - half)
        found = bounds(chain, packed, curve, middle, half)
        times = middle + half * np.linspace(-1.0, 1.0, 401)
        samples = constraints.residuals(power_basis.polyval(times, curve.T).T)
        np.testing.assert_allclose(found[:, 0], samples[200], atol=1e-9)
        assert (samples.max(axis=0) <= found[:, 1] + 1e-9).all()


@pytest.mark.parametrize("kind", list(RowKind))
def test_what_a_bound_adds_shrinks_with_the_cell(kind: RowKind) -> None:
    """On a cell of a tenth of the length it is at most a seventh, for rows of every kind."""
    chain = CHAINS[0]
    constraints = ConstraintSet(chain, tuple(some_of_each(chain, 5)))
    rows = np.flatnonzero(constraints.packed[:, Column.KIND] == kind)
    packed, rng = np.array(constraints.packed[rows]), np.random.default_rng(7)
    for _ in range(6):
        curve = random_curve(chain, rng)
        excess = []
        for half in (1e-3, 1e-4):
            times = 0.5 + half * np.linspace(-1.0, 1.0, 401)
            samples = constraints.residuals(power_basis.polyval(times, curve.T).T)[:, rows]
            excess.append(bounds(chain, packed, curve, 0.5, half)[:, 1] - samples.max(axis=0))
        assert (excess[1] <= excess[0] / 7.0 + 1e-9).all()


def test_distances_angles_and_coordinates_are_bounded_to_second_order() -> None:
    """Where they are smooth: the excess over dense samples falls as the square of the cell."""
    chain = CHAINS[0]
    constraints = ConstraintSet(chain, tuple(some_of_each(chain, 5)))
    second = [RowKind.COORDINATE, RowKind.DISTANCE, RowKind.JOINT]
    rows = np.flatnonzero(np.isin(constraints.packed[:, Column.KIND], second))
    packed, rng = np.array(constraints.packed[rows]), np.random.default_rng(8)
    shares = []
    for _ in range(10):
        curve = random_curve(chain, rng)
        excess = []
        for half in (1e-2, 1e-3):
            times = 0.5 + half * np.linspace(-1.0, 1.0, 401)
            samples = constraints.residuals(power_basis.polyval(times, curve.T).T)[:, rows]
            excess.append(bounds(chain, packed, curve, 0.5, half)[:, 1] - samples.max(axis=0))
        shares.append(excess[1] / np.maximum(excess[0], 1e-12))
    # But for corners of the residual: the middle between two bounds, the point of a cone.
    assert np.median(shares) < 0.02


def test_a_curve_is_expanded_about_the_middle_of_the_cell() -> None:
    rng = np.random.default_rng(9)
    for size in (1, 2, 3, 6):
        curve, middle, half = rng.normal(size=(3, size)), 0.37, 0.2
        q, linear, curved = np.empty(3), np.empty(3), np.empty(3)
        expand_kernel(curve, middle, half, q, linear, curved)
        for j in range(3):
            moved = Polynomial(curve[j])(Polynomial([middle, half])).coef
            moved = np.append(moved, np.zeros(6))
            assert q[j] == pytest.approx(moved[0], abs=1e-12)
            assert linear[j] == pytest.approx(moved[1], abs=1e-12)
            assert curved[j] == pytest.approx(np.abs(moved[2:]).sum(), abs=1e-12)


def test_a_joint_along_the_axis_does_not_widen_the_bound_of_a_cone() -> None:
    """The last joint turns about the tool's z axis: the angle stays, however far it turns."""

    chain = CHAINS[0]
    q = np.array([0.3, -0.5, 0.1, -2.0, 0.2, 1.6, 0.4])
    z = forward(chain, q)[:3, 2]
    cone = ConstraintSet(chain, (ConeConstraint([0, 0, 1], z + np.array([0.3, 0.0, 0.1]), 0.5),))
    turn = np.column_stack([q, 2.0 * np.eye(7)[6]])
    ((middle, bound),) = bounds(chain, np.array(cone.packed), turn, 0.5, 0.5)
    assert bound == pytest.approx(middle, abs=1e-7)
    aside = np.column_stack([q, 2.0 * np.eye(7)[5]])
    ((middle, bound),) = bounds(chain, np.array(cone.packed), aside, 0.5, 0.5)
    assert bound > middle + 0.1


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
