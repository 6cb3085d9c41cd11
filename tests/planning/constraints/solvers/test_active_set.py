"""Programs of constrained inverse kinematics beside those of scipy, and conflicts."""

import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy.optimize import OptimizeResult, linprog, minimize, nnls

from kinematics.arrays import Array
from kinematics.forward import forward
from kinematics.model.dh import DhRow, DhTable, chain_from_dh
from obstacles.collision.checker import Checker
from planning.constraints.constraint_set import ConstraintSet
from planning.constraints.kinds.constraint import (
    ConeConstraint,
    JointConstraint,
    PlaneRegion,
    PositionConstraint,
    SphereRegion,
)
from planning.constraints.solvers.active_set import (
    FEASIBLE,
    descend,
)
from planning.constraints.solvers.active_set_program import (
    Goal,
    make_goal,
    make_work,
    objective_kernel,
    search_arrays,
)
from planning.constraints.solvers.conflict import conflict
from planning.constraints.solvers.least_distance import least_distance
from planning.values.deadline import Deadline
from tests.planning.scenes import HOME, builtin, pillar

ROBOT = builtin("panda")
CHAIN = ROBOT.chain
UPRIGHT = ConeConstraint([0, 0, 1], [0, 0, -1], 0.1)
SHELF = PositionConstraint(PlaneRegion([0, 0, 0.35], [0, 0, 1], 0.005))


def down(asked: Goal, start: Array) -> tuple[Array, float, float]:
    """Where a descent ends, its worst violation and its objective."""
    q, found = start.copy(), np.empty(2)
    descend(None, asked, q, found)
    return q, float(found[0]), float(found[1])


def held(*constraints: object) -> ConstraintSet:
    return ConstraintSet(CHAIN, tuple(constraints))  # type: ignore[arg-type]


def by_scipy(
    constraints: ConstraintSet, start: Array, objective: Callable[[Array], float]
) -> OptimizeResult:
    """The same program by sequential least squares."""
    keep: Any = {"type": "ineq", "fun": lambda x: -constraints.residuals(x)}
    bounds = list(zip(CHAIN.limits.lower, CHAIN.limits.upper, strict=True))
    minimise: Any = minimize
    answer: OptimizeResult = minimise(
        objective, start, bounds=bounds, constraints=keep, method="SLSQP"
    )
    return answer


def draw(seed: int, spread: float = 0.5) -> Array:
    return HOME + np.random.default_rng(seed).uniform(-spread, spread, 7)


def test_under_bounds_of_joints_it_ends_at_the_projection_of_the_posture() -> None:
    """Each joint for itself: the posture's value, clipped into its bounds."""
    names = CHAIN.joint_names
    low, high = HOME - 0.1, HOME + 0.1
    constraints = held(*(JointConstraint(names[j], float(HOME[j]), 0.1, 0.1) for j in range(5)))
    for seed in range(6):
        posture = draw(seed, 0.4)
        asked = make_goal(constraints, posture, np.ones(7))
        q, worst, _ = down(asked, draw(seed + 50))
        wanted = np.append(np.clip(posture, low, high)[:5], posture[5:])
        assert worst <= FEASIBLE
        np.testing.assert_allclose(q, wanted, atol=1e-5)


@pytest.mark.parametrize("seed", range(5))
def test_it_holds_everything_and_ends_no_worse_than_scipy(seed: int) -> None:
    constraints = held(UPRIGHT, SHELF)
    asked = make_goal(constraints, HOME, np.ones(7))
    start = draw(seed)
    q, worst, value = down(asked, start)
    assert worst <= FEASIBLE
    assert constraints.residuals(q).max() <= FEASIBLE
    assert (q >= CHAIN.limits.lower).all()
    assert (q <= CHAIN.limits.upper).all()
    assert value == pytest.approx(0.5 * np.square(q - HOME).sum())
    scipys = by_scipy(constraints, start, lambda x: 0.5 * float(np.square(x - HOME).sum()))
    # The cone's residual has a point in its middle: scipy may end early, or in another branch.
    if scipys.success and constraints.residuals(scipys.x).max() < 1e-6:
        near = np.abs(scipys.x - q).max() < 0.5
        assert value <= scipys.fun * 1.001 + 1e-5 or not near


def test_what_contradicts_itself_ends_between_with_a_violation() -> None:
    """Two planes 0.2 m apart: the tip ends between them, 0.1 m from either."""
    low = PositionConstraint(PlaneRegion([0, 0, 0.3], [0, 0, 1], 0.0))
    high = PositionConstraint(PlaneRegion([0, 0, 0.5], [0, 0, 1], 0.0))
    asked = make_goal(held(low, high), HOME, np.ones(7))
    q, worst, _ = down(asked, HOME)
    assert worst == pytest.approx(0.1, abs=0.01)
    assert forward(CHAIN, q)[2, 3] == pytest.approx(0.4, abs=0.01)


def test_manipulability_grows_inside_the_constraints() -> None:
    constraints = held(UPRIGHT, SHELF)
    near = make_goal(constraints, HOME, np.ones(7))
    strong = make_goal(constraints, HOME, np.zeros(7), link=-1)
    work = make_work(None, strong)
    for seed in range(3):
        q, worst, _ = down(near, draw(seed))
        better, held_too, value = down(strong, q)
        assert max(worst, held_too) <= FEASIBLE
        assert value < objective_kernel(strong, q, work) - 0.01
        assert constraints.residuals(better).max() <= FEASIBLE


def test_a_wish_is_met_nearly_as_far_as_scipy_finds_that_the_constraints_let_it() -> None:
    """A ball above the slab that the tip is held in."""
    ball = ConstraintSet(
        CHAIN, (PositionConstraint(SphereRegion([0.5, 0.2, 0.5], 0.01), weight=1e2),)
    )
    constraints = held(SHELF)
    asked = make_goal(constraints, HOME, np.ones(7), soft=ball)
    q, worst, value = down(asked, HOME)
    assert worst <= FEASIBLE

    def objective(x: Array) -> float:
        missed = float(np.maximum(ball.residuals(x), 0.0)[0])
        return 0.5 * float(np.square(x - HOME).sum()) + 50.0 * missed**2

    scipys = by_scipy(constraints, q, objective)
    assert scipys.success
    assert value == pytest.approx(objective(q), rel=1e-9)
    assert value <= 1.01 * scipys.fun
    assert value < 0.5 * objective(down(make_goal(constraints, HOME, np.ones(7)), HOME)[0])


def test_it_comes_out_of_an_obstacle_with_headroom() -> None:
    model = Checker.of(ROBOT, pillar(0.0, 0.4)).model
    checker = Checker(model)
    assert not checker.valid(HOME)
    asked = make_goal(held(), HOME, np.ones(7))
    for headroom in (0.0, 0.01):
        q, found = HOME.copy(), np.empty(2)
        descend(search_arrays(model, headroom), asked, q, found)
        assert found[0] <= FEASIBLE
        distance, _ = checker.clearance(q)
        assert distance >= headroom - 1e-6
        # As near to the posture as the post lets it: something touches what it may.
        assert distance <= headroom + 0.01


def test_against_linear_programs_and_optimality_conditions() -> None:
    rng = np.random.default_rng(0)
    solved = impossible = 0
    for case in range(300):
        n, m = int(rng.integers(1, 9)), int(rng.integers(1, 20))
        A, b = rng.normal(size=(m, n)), rng.normal(size=m) + 0.7 * (case % 3)
        if case % 5 == 0 and m > 2:
            # An equality as two inequalities.
            A[1], b[1] = -A[0], -b[0]
        d, x = 2.0 * rng.normal(size=n), np.empty(n)
        found = least_distance(A, b, m, d, x)
        bounds = [(None, None)] * n
        feasible = linprog(np.zeros(n), A_ub=A, b_ub=b, bounds=bounds).status == 0
        assert found == feasible
        if not found:
            impossible += 1
            continue
        solved += 1
        assert (A @ x - b).max() < 1e-9 * (1.0 + np.abs(x).max())
        active = A @ x - b > -1e-8
        # d - x is a combination of the active rows with positive weights.
        rest = nnls(A[active].T, d - x)[1] if active.any() else np.linalg.norm(d - x)
        assert rest < 1e-6 * (1.0 + np.linalg.norm(d - x))
    assert min(solved, impossible) > 50


UP = [0.0, 0.0, 1.0]


def test_what_can_hold_is_no_conflict() -> None:
    q = np.array([0.3, -0.5, 0.1, -2.0, 0.2, 1.6, 0.4])
    T = forward(CHAIN, q)
    wanted = (
        ConeConstraint(T[:3, :3].T @ UP, UP, 0.1),
        PositionConstraint(SphereRegion(T[:3, 3], 0.01)),
    )
    assert conflict(ConstraintSet(CHAIN, wanted)) is None
    assert conflict(ConstraintSet(CHAIN, ())) is None


def test_two_that_exclude_each_other_are_named_among_others() -> None:
    wanted = (
        PositionConstraint(PlaneRegion([0, 0, 0.2], UP, 0.01)),
        ConeConstraint(UP, [0.0, 0.0, -1.0], 0.5),
        PositionConstraint(PlaneRegion([0, 0, 0.6], UP, 0.01)),
        JointConstraint("panda_joint1", 0.0, 1.0, 1.0),
    )
    found = conflict(ConstraintSet(CHAIN, wanted))
    assert found is not None
    assert found.constraints == (0, 2)
    np.testing.assert_allclose(found.relaxations, 0.38, atol=1e-3)
    assert "constraint 0" in found.message
    assert "constraint 2" in found.message
    assert "0.38 m" in found.hint


def test_an_arm_of_a_thousand_kilometres_is_answered_too() -> None:
    """Rounding makes the matrix of a step indefinite there; found by random requests."""
    rows = (
        DhRow("revolute", 1e6, 124982.13042318285, 1e6, 1e6, 0.5, 1.0),
        DhRow("revolute", 1.0, -1.0, 1e6, 1e6, 0.0, 1e-300),
        DhRow("revolute", -492122.2085170258, 0.0, -1.0, 1e-9, 0.0, 1e-9),
    )
    chain = chain_from_dh("long", DhTable("standard", rows))
    place = PositionConstraint(SphereRegion([0.0, 0.8451461856615526, 0.0], 0.0))
    found = conflict(ConstraintSet(chain, (place, place)))
    assert found is not None
    assert found.constraints == (1,)
    assert "Any one of these helps" in found.hint


def test_one_that_nothing_can_reach_is_told_alone() -> None:
    wanted = (
        ConeConstraint(UP, UP, 1.0),
        PositionConstraint(SphereRegion([2.0, 0.0, 0.333], 0.1)),
    )
    found = conflict(ConstraintSet(CHAIN, wanted))
    assert found is not None
    assert found.constraints == (1,)
    # It reaches 0.855 m and a flange of 0.107 m from its shoulder.
    assert 0.8 < found.relaxations[0] < 1.3


def test_time_ends_the_search_for_a_conflict() -> None:
    """What is not known by then is no conflict, or one that may name more than it needs."""
    planes = [
        PositionConstraint(PlaneRegion([0, 0, 0.1 * k], UP, 0.01), link)
        for k in range(6)
        for link in (None, "panda_link5")
    ]
    wanted = ConstraintSet(CHAIN, tuple(planes))
    assert conflict(wanted, deadline=Deadline.after(0.0)) is None
    began = time.process_time()
    conflict(wanted, deadline=Deadline.after(0.05))
    assert time.process_time() - began < 0.15
    found = conflict(wanted, deadline=Deadline.after(60.0))
    assert found is not None
    assert len(found.constraints) == 2
