"""The program of constrained inverse kinematics: rows, objective and slopes by differences."""

import numpy as np
import pytest

from kinematics.arrays import Array
from kinematics.jacobian import geometric
from obstacles.collision.checker import Checker, collision_model
from planning.constraints.constraint_set import ConstraintSet
from planning.constraints.kinds.joint import JointConstraint
from planning.constraints.kinds.orientation import ConeConstraint
from planning.constraints.kinds.position import PositionConstraint
from planning.constraints.kinds.region import BoxRegion, PlaneRegion, SphereRegion
from planning.constraints.row_value import sideways_kernel
from planning.constraints.solvers.active_set_program import (
    Goal,
    Work,
    linearise,
    log_manipulability,
    make_goal,
    make_work,
    objective_kernel,
    search_arrays,
    slope_kernel,
)
from tests.planning.constraints.samples import some_of_each
from tests.planning.scenes import HOME, builtin, pillar

ROBOT = builtin("panda")
CHAIN = ROBOT.chain
FREE = ConstraintSet(CHAIN)


def goal(*constraints: object, metric: float = 1.0, link: int = -2, soft: object = None) -> Goal:
    held = ConstraintSet(CHAIN, tuple(constraints))  # type: ignore[arg-type]
    wished = None if soft is None else ConstraintSet(CHAIN, (soft,))  # type: ignore[arg-type]
    return make_goal(held, HOME, np.full(7, metric), soft=wished, link=link)


def rows_at(asked: Goal, q: Array) -> tuple[Array, Array, float, float]:
    """A, b of all rows but the joint limits', the worst violation and the sum of squares."""
    work = make_work(None, asked)
    count, worst, total = linearise(None, asked, q, work)
    return work.A[: count - 14], work.b[: count - 14], worst, total


def draw(seed: int) -> Array:
    return HOME + np.random.default_rng(seed).uniform(-0.4, 0.4, 7)


def test_a_joints_bounds_are_two_rows_whichever_is_nearer() -> None:
    asked = goal(JointConstraint("panda_joint3", 0.2, 0.3, 0.1))
    for value in (0.0, 0.12, 0.2, 0.45, 0.9):
        q = HOME.copy()
        q[2] = value
        A, b, worst, total = rows_at(asked, q)
        np.testing.assert_allclose(A, [np.eye(7)[2], -np.eye(7)[2]], atol=1e-12)
        np.testing.assert_allclose(b, [0.5 - value, value - 0.1], atol=1e-12)
        violated = max(value - 0.5, 0.1 - value, 0.0)
        assert worst == pytest.approx(violated)
        assert total == pytest.approx(violated**2)


def test_violations_add_up_in_squares_and_the_worst_is_told() -> None:
    asked = goal(
        JointConstraint("panda_joint1", 0.5, 0.1, 0.1),
        JointConstraint("panda_joint3", -0.6, 0.1, 0.1),
        JointConstraint("panda_joint7", float(HOME[6]), 0.1, 0.1),
    )
    _, _, worst, total = rows_at(asked, HOME)
    assert worst == pytest.approx(0.5)
    assert total == pytest.approx(0.4**2 + 0.5**2)


@pytest.mark.parametrize("seed", range(4))
def test_rows_are_the_constraints_to_first_order(seed: int) -> None:
    """Along any small step each row's room changes by A dq, for kinds of every sort."""
    constraints = ConstraintSet(CHAIN, tuple(c for c in some_of_each(CHAIN, 3)))
    asked = make_goal(constraints, HOME, np.ones(7))
    q, dq = draw(seed), 1e-6 * np.random.default_rng(seed).normal(size=7)
    work, ahead = make_work(None, asked), make_work(None, asked)
    linearise(None, asked, q, work)
    linearise(None, asked, q + dq, ahead)
    # Rows of both bounds come before those across, which violated rows alone have.
    at, after = 0, 0
    checked = 0
    for i, row in enumerate(constraints.packed):
        for bound in (row[16], row[15]):
            if np.isinf(bound):
                continue
            change = work.A[at] @ dq
            if abs(change) > 1e-9:
                assert ahead.b[after] - work.b[at] == pytest.approx(-change, abs=1e-9)
                checked += 1
            at, after = at + 1, after + 1
        at += 2 * _across(asked, work, i)
        after += 2 * _across(asked, ahead, i)
    assert checked > 20


def _across(asked: Goal, work: Work, i: int) -> int:
    residual, row = work.rows.residuals[i], asked.hard[i]
    above = work.rows.values[i] - row[16] >= row[15] - work.rows.values[i]
    if residual <= 0.0 or not above:
        return 0
    frames = work.rows.frames
    return sum(not np.isinf(sideways_kernel(frames, row, second)[0]) for second in (False, True))


def test_joint_limits_are_rows_and_a_joint_past_its_limit_has_no_room() -> None:
    q = HOME.copy()
    q[1] = CHAIN.limits.upper[1] + 0.1
    asked = goal()
    work = make_work(None, asked)
    count, worst, _ = linearise(None, asked, q, work)
    assert count == 14
    assert worst == 0.0
    A, b = work.A[:14].reshape(7, 2, 7), work.b[:14].reshape(7, 2)
    for j in range(7):
        np.testing.assert_array_equal(A[j], [np.eye(7)[j], -np.eye(7)[j]])
        rooms = CHAIN.limits.upper[j] - q[j], q[j] - CHAIN.limits.lower[j]
        np.testing.assert_allclose(b[j], np.maximum(rooms, 0.0), atol=1e-15)
    assert b[1, 0] == 0.0


def test_near_pairs_have_rows_of_their_distances() -> None:
    model = collision_model(ROBOT, pillar(0.0, 0.62))
    checker, asked = Checker(model), goal()
    work = make_work(model.arrays, asked)
    count, worst, _ = linearise(model.arrays, asked, HOME, work)
    near = checker.gradient(HOME, 0.04)
    assert len(near.distances) > 0
    assert count == len(near.distances) + 14
    order, found = np.argsort(near.distances), np.argsort(work.b[: count - 14])
    np.testing.assert_allclose(work.b[found], near.distances[order], atol=1e-9)
    np.testing.assert_allclose(work.A[found], -near.gradients[order], atol=1e-9)
    assert worst == pytest.approx(max(0.0, -near.distances.min()))


def test_headroom_is_kept_from_obstacles_and_from_the_robot_itself() -> None:
    model = collision_model(ROBOT, pillar(0.0, 0.62))
    plain, wide = search_arrays(model), search_arrays(model, 0.03)
    np.testing.assert_allclose(wide.margin, plain.margin + 0.03)
    np.testing.assert_allclose(wide.own_margin, plain.own_margin + 0.03)
    asked = goal()
    least = []
    for arrays in (plain, wide):
        work = make_work(arrays, asked)
        count, _, _ = linearise(arrays, asked, HOME, work)
        least.append(work.b[: count - 14].min())
    assert least[0] - least[1] == pytest.approx(0.03, abs=1e-6)


def test_the_objective_is_the_weighed_square_of_the_way_from_the_posture() -> None:
    metric = np.arange(7.0)
    asked = make_goal(FREE, HOME, metric)
    for seed in range(5):
        q = draw(seed)
        wanted = 0.5 * metric @ (q - HOME) ** 2
        assert objective_kernel(asked, q, make_work(None, asked)) == pytest.approx(wanted)


def test_soft_rows_cost_half_their_weighed_square_where_violated_alone() -> None:
    wish = JointConstraint("panda_joint2", float(HOME[1]) + 0.1, 0.05, 0.05, weight=6.0)
    asked = goal(metric=0.0, soft=wish)
    work = make_work(None, asked)
    assert objective_kernel(asked, HOME, work) == pytest.approx(3.0 * 0.05**2)
    assert objective_kernel(asked, HOME + 0.1 * np.eye(7)[1], work) == 0.0


@pytest.mark.parametrize("name", ["panda", "ur5e", "scara", "planar_rr"])
def test_manipulability_is_that_of_the_jacobians_singular_values(name: str) -> None:
    chain = builtin(name).chain
    asked = make_goal(ConstraintSet(chain), np.zeros(chain.n), np.zeros(chain.n), link=-1)
    J = np.empty((6, chain.n))
    for seed in range(5):
        q = np.random.default_rng(seed).uniform(*chain.sampling_bounds())
        singular = np.linalg.svd(geometric(chain, q), compute_uv=False)[: min(6, chain.n)]
        found = log_manipulability(asked, q, J)
        if singular.min() > 1e-3:
            assert found == pytest.approx(np.log(singular).sum(), abs=1e-5)
        else:
            assert found < -5.0


@pytest.mark.parametrize("case", ["posture", "soft", "manipulability"])
@pytest.mark.parametrize("seed", range(3))
def test_slopes_are_those_of_differences(case: str, seed: int) -> None:
    wish = PositionConstraint(SphereRegion([0.3, 0.3, 0.6], 0.05), weight=40.0)
    asked = {
        "posture": goal(metric=2.0),
        "soft": goal(metric=0.5, soft=wish),
        "manipulability": goal(metric=0.0, link=-1),
    }[case]
    q, work, H = draw(seed), make_work(None, asked), np.empty((7, 7))
    before = q.copy()
    slope_kernel(asked, q, work, H)
    np.testing.assert_array_equal(q, before)
    slope = work.slope.copy()
    h = 1e-6
    for j in range(7):
        step = h * np.eye(7)[j]
        ahead, behind = (objective_kernel(asked, x, work) for x in (q + step, q - step))
        assert slope[j] == pytest.approx((ahead - behind) / (2.0 * h), abs=2e-4)
    np.testing.assert_allclose(H, H.T, atol=1e-12)
    assert np.linalg.eigvalsh(H).min() > 0.0


def test_the_matrix_has_the_squares_of_soft_rows_alone_where_violated() -> None:
    wish = JointConstraint("panda_joint2", float(HOME[1]) + 0.3, 0.1, 0.1, weight=6.0)
    asked = goal(metric=0.5, soft=wish)
    work, H = make_work(None, asked), np.empty((7, 7))
    slope_kernel(asked, HOME.copy(), work, H)
    np.testing.assert_allclose(H, np.diag(0.5 + 6.0 * np.eye(7)[1]), atol=1e-12)
    slope_kernel(asked, HOME + 0.3 * np.eye(7)[1], work, H)
    np.testing.assert_allclose(H, 0.5 * np.eye(7), atol=1e-12)


def test_a_goal_has_arrays_of_its_own_and_rows_in_place_of_the_constraints() -> None:
    held = ConstraintSet(
        CHAIN,
        (
            ConeConstraint([0, 0, 1], [0, 0, -1], 0.3),
            PositionConstraint(BoxRegion(np.eye(4), np.ones(3))),
            PositionConstraint(PlaneRegion([0, 0, 0.4], [0, 0, 1], 0.1), weight=3.0),
        ),
    )
    asked = make_goal(held, HOME, np.ones(7))
    assert len(asked.hard) == 5
    assert len(asked.soft) == len(asked.weights) == 0
    for array in (asked.hard, asked.lower, asked.upper, asked.posture, asked.metric):
        assert array.flags.writeable
    other = make_goal(held, HOME, np.ones(7), rows=held.packed[:1])
    np.testing.assert_array_equal(other.hard, held.packed[:1])
    np.testing.assert_array_equal(asked.lower, CHAIN.limits.lower)
    np.testing.assert_array_equal(asked.upper, CHAIN.limits.upper)
