"""Residuals of constraints and verdicts on edges beside pinocchio, scipy and dense samples."""

import math
from collections.abc import Callable

import numpy as np
import pytest
from numpy.polynomial import polynomial as power_basis
from scipy.spatial.transform import Rotation

from kinematics.arrays import Array
from kinematics.errors import ArmwrightError
from kinematics.forward import forward, frames_kernel
from kinematics.model.chain import Chain
from kinematics.pose import transform
from kinematics.robots import builtin_chain, builtin_names
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
from planning.constraints.kinds.constraint import (
    BoxRegion,
    ClearanceConstraint,
    ConeConstraint,
    Constraint,
    JointConstraint,
    LineRegion,
    LookAtConstraint,
    OrientationConstraint,
    PlaneRegion,
    PositionConstraint,
    RelativePoseConstraint,
    SphereRegion,
    ToolSpeedConstraint,
    TorqueConstraint,
)
from planning.constraints.row import Column
from tests.dynamics.samples import random_chain
from tests.kinematics.samples import random_rotation
from tests.planning.constraints.samples import some_of_each
from tests.planning.pinocchio_arm import PinocchioArm

CHAINS = [builtin_chain(name) for name in builtin_names()]
CHAINS += [random_chain(seed, 3 + seed) for seed in range(4)]


def draw(chain: Chain, seed: int, count: int) -> Array:
    return np.random.default_rng(seed).uniform(*chain.sampling_bounds(), (count, chain.n))


ORACLE = PinocchioArm()
LINK, SEEN_FROM = "panda_link6", "panda_link2"
POINT = np.array([0.05, -0.1, 0.2])


@pytest.mark.parametrize("seen_from", [None, SEEN_FROM, "panda_link7"])
def test_every_kind_against_pinocchio(seen_from: str | None) -> None:
    rng = np.random.default_rng(5)
    T = transform(random_rotation(rng), rng.normal(size=3) * 0.3)
    n, c, a = rng.normal(size=3), rng.normal(size=3) * 0.3, rng.normal(size=3)
    u, b = n / np.linalg.norm(n), a / np.linalg.norm(a)
    chain, where = ORACLE.chain, (LINK, POINT, seen_from)
    constraints = ConstraintSet(
        chain,
        (
            PositionConstraint(BoxRegion(T, np.array([0.2, 0.3, np.inf])), *where),
            PositionConstraint(SphereRegion(c, 0.3), *where),
            PositionConstraint(PlaneRegion(c, n, 0.01), *where),
            PositionConstraint(LineRegion(c, n, 0.02, 0.4), *where),
            ConeConstraint(a, n, 0.2, LINK, seen_from),
            OrientationConstraint(T[:3, :3], [0.1, 0.2, 0.3], LINK, seen_from),
            LookAtConstraint(a, 3.0 * c, 0.1, LINK, POINT, seen_from),
            RelativePoseConstraint(T, LINK, seen_from, [0.1, 0.2, 0.3], [0.1, 0.2, 4.0]),
        ),
    )
    for q in draw(chain, 1, 200):
        base = np.eye(4) if seen_from is None else ORACLE.pose(q, seen_from)
        X = np.linalg.inv(base) @ ORACLE.pose(q, LINK)
        x = X[:3, :3] @ POINT + X[:3, 3]
        local = T[:3, :3].T @ (x - T[:3, 3])
        axis, sight = X[:3, :3] @ b, 3.0 * c - x
        left = Rotation.from_matrix(T[:3, :3].T @ X[:3, :3]).as_rotvec()
        origin = T[:3, :3].T @ (X[:3, 3] - T[:3, 3])
        expected = [
            abs(local[0]) - 0.1,
            abs(local[1]) - 0.15,
            np.linalg.norm(x - c) - 0.3,
            abs(u @ (x - c)) - 0.01,
            np.linalg.norm(np.cross(u, x - c)) - 0.02,
            abs(u @ (x - c)) - 0.2,
            np.arccos(np.clip(axis @ u, -1.0, 1.0)) - 0.2,
            *(np.abs(left) - [0.1, 0.2, 0.3]),
            np.arccos(axis @ sight / np.linalg.norm(sight)) - 0.1,
            *(np.abs(origin) - [0.1, 0.2, 0.3]),
            *(np.abs(left[:2]) - [0.1, 0.2]),
        ]
        np.testing.assert_allclose(constraints.residuals(q), expected, atol=1e-7)


@pytest.mark.parametrize("chain", CHAINS, ids=lambda chain: chain.name)
def test_jacobian_is_the_slope_of_the_residual(chain: Chain) -> None:
    constraints = ConstraintSet(chain, tuple(some_of_each(chain, 3)))
    h = 1e-6
    for q in draw(chain, 2, 20):
        residuals, J = constraints.evaluate(q)
        np.testing.assert_array_equal(residuals, constraints.residuals(q))
        steps = h * np.eye(chain.n)
        ahead, behind = constraints.residuals(q + steps), constraints.residuals(q - steps)
        slopes = (ahead - behind).T / (2.0 * h)
        # A corner of a residual (the middle of two bounds, half a turn) has no slope.
        bend = np.abs(ahead + behind - 2.0 * residuals).max(axis=0)
        smooth = bend < 1e-9
        assert smooth.mean() > 0.9
        np.testing.assert_allclose(J[smooth], slopes[smooth], atol=2e-5)


def test_rotation_near_the_target_and_half_a_turn_away() -> None:
    chain = ORACLE.chain
    rng = np.random.default_rng(0)
    for q in draw(chain, 4, 20):
        R = forward(chain, q)[:3, :3]
        for angle in (0.0, 1e-12, 1e-9, 1e-5, 1e-3, 3.0, 3.14159, np.pi - 1e-9):
            axis = rng.normal(size=3)
            axis /= np.linalg.norm(axis)
            target = Rotation.from_matrix(R) * Rotation.from_rotvec(-angle * axis)
            constraint = OrientationConstraint(target.as_matrix(), [1.0, 1.0, 1.0])
            values = ConstraintSet(chain, (constraint,)).values(q)
            np.testing.assert_allclose(np.abs(values), np.abs(angle * axis), atol=1e-7)


def test_at_the_middle_of_a_cone_and_opposite_to_it() -> None:
    chain = ORACLE.chain
    q = draw(chain, 5, 1)[0]
    z = forward(chain, q)[:3, 2]
    inside = ConstraintSet(chain, (ConeConstraint([0, 0, 1], z, 0.1),))
    r, J = inside.evaluate(q)
    assert abs(r[0] + 0.1) < 1e-7
    assert np.isfinite(J).all()
    r, J = ConstraintSet(chain, (ConeConstraint([0, 0, 1], -z, 0.1),)).evaluate(q)
    assert abs(r[0] - (np.pi - 0.1)) < 1e-7
    # From there every way leads towards the cone, and a projection has to take one.
    assert np.linalg.norm(J) > 0.1


def test_hash_tells_constraints_apart() -> None:
    chain = ORACLE.chain
    first = ConstraintSet(chain, (JointConstraint("panda_joint1", 0.0, 0.1, 0.1),))
    same = ConstraintSet(chain, (JointConstraint("panda_joint1", 0.0, 0.1, 0.1),))
    soft = ConstraintSet(chain, (JointConstraint("panda_joint1", 0.0, 0.1, 0.1, 1.0),))
    assert first == same
    assert hash(first) == hash(same)
    assert first != soft
    assert soft.soft == soft
    assert not soft.hard
    assert first.hard == first


PANDA = builtin_chain("panda")
BALL = SphereRegion([0.4, 0.0, 0.4], 0.1)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: JointConstraint("panda_joint1", math.nan), "not finite"),
        (lambda: JointConstraint("panda_joint1", 0.0, -0.1), "tolerance_above"),
        (lambda: JointConstraint("elbow", 0.0), "no joint 'elbow'"),
        (lambda: PositionConstraint(BALL, link="nose"), "nose"),
        (lambda: PositionConstraint(BALL, link="panda_link0"), "does not move"),
        (lambda: PositionConstraint(BALL, "panda_hand", reference_link="panda_link7"), "not move"),
        (lambda: PositionConstraint(BALL, point=[0.0, 0.0]), "point"),
        (lambda: SphereRegion([0, 0, 0], -1.0), "radius"),
        (lambda: PlaneRegion([0, 0, 0], [0, 0, 0], 0.1), "normal"),
        (lambda: LineRegion([0, 0, 0], [0, 0, 1], 0.1, -1.0), "length"),
        (lambda: BoxRegion(np.eye(4), np.array([1.0, -1.0, 1.0])), "size"),
        (lambda: BoxRegion(np.eye(3), np.ones(3)), "pose"),
        (lambda: ConeConstraint([0, 0, 0], [0, 0, 1], 0.1), "axis"),
        (lambda: ConeConstraint([0, 0, 1], [0, 0, 1], 4.0), "cone_angle"),
        (lambda: OrientationConstraint(2.0 * np.eye(3), 0.1), "rotation"),
        (lambda: OrientationConstraint(np.eye(3), [0.1, 0.1]), "axis_tolerances"),
        (lambda: LookAtConstraint([0, 0, 1], [math.inf, 0, 0], 0.1), "target"),
        (lambda: RelativePoseConstraint(np.eye(4), position_tolerances=-1.0), "position_tol"),
        (lambda: ClearanceConstraint(-0.1), "margin"),
        (lambda: ToolSpeedConstraint(0.0), "tool speed"),
        (lambda: TorqueConstraint([1.0, -1.0]), "positive"),
        (lambda: TorqueConstraint([1.0]), "7 joints"),
        (lambda: ConeConstraint([0, 0, 1], [0, 0, 1], 0.1, weight=0.0), "weight"),
    ],
)
def test_malformed_constraints_are_refused(make: Callable[[], Constraint], words: str) -> None:
    with pytest.raises(ArmwrightError) as caught:
        ConstraintSet(PANDA, (make(),))
    assert words in f"{caught.value.message} {caught.value.hint}"


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
