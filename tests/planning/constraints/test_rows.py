"""Residuals beside pinocchio and scipy, Jacobians by differences, and what is no constraint."""

import math
from collections.abc import Callable

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from kinematics.arrays import Array
from kinematics.errors import ArmwrightError, InvalidLinkName
from kinematics.forward import forward
from kinematics.model.chain import Chain
from kinematics.pose import transform
from kinematics.robots import builtin_chain, builtin_names
from planning.constraints.constraint_set import ConstraintSet
from planning.constraints.kinds.constraint import (
    ClearanceConstraint,
    ConeConstraint,
    Constraint,
    JointConstraint,
    LookAtConstraint,
    OrientationConstraint,
    PositionConstraint,
    RelativePoseConstraint,
    ToolSpeedConstraint,
    TorqueConstraint,
)
from planning.constraints.kinds.region import BoxRegion, LineRegion, PlaneRegion, SphereRegion
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


def test_an_unknown_link_lists_those_there_are() -> None:
    with pytest.raises(InvalidLinkName) as caught:
        ConstraintSet(PANDA, (ConeConstraint([0, 0, 1], [0, 0, 1], 0.1, link="nose"),))
    assert "panda_hand" in str(caught.value.hint)


def test_a_motion_s_limits_are_known_and_have_no_rows() -> None:
    limits = (ClearanceConstraint(0.02), ClearanceConstraint(0.01), ToolSpeedConstraint(0.5))
    made = ConstraintSet(PANDA, (*limits, TorqueConstraint()))
    assert made.rows == ()
    assert (made.margin, made.tool_speed) == (0.02, 0.5)
    assert made.torque == TorqueConstraint()
    assert made.residuals(np.zeros(7)).shape == (0,)
    assert made.residuals(np.zeros((3, 7))).shape == (3, 0)


def test_free_axes_have_no_rows() -> None:
    upright = OrientationConstraint(np.eye(3), [0.1, 0.1, 4.0])
    assert len(ConstraintSet(PANDA, (upright,)).rows) == 2
