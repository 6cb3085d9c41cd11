"""Descents of constrained inverse kinematics: feasible first, then as good as scipy finds."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy.optimize import OptimizeResult, minimize

from kinematics.arrays import Array
from kinematics.forward import forward
from obstacles.collision.checker import Checker, collision_model
from planning.constraints.constraint_set import ConstraintSet
from planning.constraints.kinds.joint import JointConstraint
from planning.constraints.kinds.orientation import ConeConstraint
from planning.constraints.kinds.position import PositionConstraint
from planning.constraints.kinds.region import PlaneRegion, SphereRegion
from planning.constraints.solvers.active_set import (
    FEASIBLE,
    damped_step,
    descend,
    improve,
    make_feasible,
)
from planning.constraints.solvers.active_set_program import (
    Goal,
    linearise,
    make_goal,
    make_work,
    objective_kernel,
    search_arrays,
)
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


def test_a_start_that_is_best_stays() -> None:
    asked = make_goal(held(), HOME, np.ones(7))
    q, worst, value = down(asked, HOME)
    np.testing.assert_allclose(q, HOME, atol=1e-12)
    assert worst == 0.0
    assert value < 1e-20


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
    model = collision_model(ROBOT, pillar(0.0, 0.4))
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


def test_a_step_of_least_squares_solves_its_normal_equations() -> None:
    asked = make_goal(held(SHELF, UPRIGHT), HOME, np.ones(7))
    work, dq = make_work(None, asked), np.empty(7)
    q = draw(3)
    count, _, total = linearise(None, asked, q, work)
    damped_step(work, count, total, dq)
    violated = work.b[:count] < 0.0
    A, b = work.A[:count][violated], work.b[:count][violated]
    assert violated.any()
    wanted = np.linalg.solve(A.T @ A + (0.1 * total + 1e-9) * np.eye(7), A.T @ b)
    np.testing.assert_allclose(dq, wanted, atol=1e-9)


def test_no_step_is_longer_than_allowed_and_none_leaves_the_limits() -> None:
    far = JointConstraint("panda_joint1", 2.8, 0.05, 0.05)
    asked = make_goal(held(far), HOME, np.ones(7))
    work, trial, dq = make_work(None, asked), np.empty(7), np.empty(7)
    q, places = HOME.copy(), [0.0]
    for _ in range(8):
        left = make_feasible(None, asked, q, 1, work, trial, dq)
        places.append(float(q[0]))
    assert np.diff(places).max() <= 0.6 + 1e-12
    assert left <= FEASIBLE
    assert q[0] == pytest.approx(2.75, abs=1e-9)
    past = JointConstraint("panda_joint4", 1.0, 0.01, 0.01)
    q, worst, _ = down(make_goal(held(past), HOME, np.ones(7)), HOME)
    assert q[3] == pytest.approx(CHAIN.limits.upper[3])
    assert worst == pytest.approx(0.99 - CHAIN.limits.upper[3])


@pytest.mark.parametrize("steps", [0, 1, 3])
def test_more_steps_never_make_it_worse(steps: int) -> None:
    constraints = held(SHELF)
    asked = make_goal(constraints, HOME, np.ones(7))
    work, trial, dq = make_work(None, asked), np.empty(7), np.empty(7)
    q = draw(4)
    make_feasible(None, asked, q, 40, work, trial, dq)
    before = objective_kernel(asked, q, work)
    fewer, more = q.copy(), q.copy()
    for x, count in ((fewer, steps), (more, steps + 2)):
        assert improve(None, asked, x, count, work, trial, dq) <= FEASIBLE
        assert constraints.residuals(x).max() <= FEASIBLE
    values = [objective_kernel(asked, x, work) for x in (more, fewer)]
    assert values[0] <= values[1] <= before


def test_no_step_into_the_set_makes_the_violations_larger_together() -> None:
    """From far away, where a step to first order overshoots, and where nothing holds all."""
    low = PositionConstraint(PlaneRegion([0, 0, -0.2], [0, 0, 1], 0.0))
    asked = make_goal(held(low, UPRIGHT, SHELF), HOME, np.ones(7))
    work, trial, dq = make_work(None, asked), np.empty(7), np.empty(7)
    for seed in range(12):
        q = np.random.default_rng(seed).uniform(*CHAIN.sampling_bounds())
        totals = []
        for _ in range(10):
            totals.append(linearise(None, asked, q, work)[2])
            make_feasible(None, asked, q, 1, work, trial, dq)
        assert (np.diff(totals) <= 1e-12).all()
        assert totals[-1] < totals[0]
