"""Configurations under constraints: held by pinocchio's frames, clear by the checker, and best."""

import itertools
import time
from types import SimpleNamespace

import casadi
import numpy as np
import pinocchio as pin
import pytest
from scipy.optimize import fmin_slsqp

from kinematics.arrays import Array
from kinematics.errors import InvalidGoal, InvalidOption, InvalidRobotState
from kinematics.forward import forward
from kinematics.robots import builtin_urdf
from kinematics.symbolic import symbolic_jacobian
from obstacles.collision.checker import Checker
from obstacles.scenes.scene import Scene
from planning.constrained.ik import IkOptions, constrained_ik
from planning.constraints.constraint_set import ConstraintSet
from planning.constraints.kinds.joint import JointConstraint
from planning.constraints.kinds.limit import ClearanceConstraint, ToolSpeedConstraint
from planning.constraints.kinds.look_at import LookAtConstraint
from planning.constraints.kinds.orientation import ConeConstraint
from planning.constraints.kinds.position import PositionConstraint
from planning.constraints.kinds.region import BoxRegion, SphereRegion
from planning.constraints.kinds.relative_pose import RelativePoseConstraint
from planning.constraints.solvers.program import Program, _determinant, is_built, program
from planning.values import deadline as deadlines
from planning.values.deadline import Deadline
from tests.planning.scenes import HOME, builtin, shelf

ROBOT = builtin("panda")
CHAIN = ROBOT.chain
MODEL = pin.buildModelFromXML(builtin_urdf("panda"))


def tip_pose(q: Array) -> Array:
    data = MODEL.createData()
    full = pin.neutral(MODEL)
    for name, value in zip(CHAIN.joint_names, q, strict=True):
        full[MODEL.joints[MODEL.getJointId(name)].idx_q] = value
    pin.framesForwardKinematics(MODEL, data, full)
    return np.asarray(data.oMf[MODEL.getFrameId(CHAIN.tip_link)].homogeneous)


def draws(seed: int, count: int) -> Array:
    """Random configurations whose own links are apart, shape (count, n)."""
    random, checker = np.random.default_rng(seed), Checker.of(ROBOT, Scene(()))
    states = (random.uniform(*CHAIN.sampling_bounds()) for _ in range(100 * count))
    return np.array(list(itertools.islice(filter(checker.valid, states), count)))


def test_upright_at_a_place() -> None:
    for q in draws(0, 20):
        T = tip_pose(q)
        up = T[:3, :3].T @ [0.0, 0.0, 1.0]
        wanted = ConstraintSet(
            CHAIN,
            (
                ConeConstraint(up, [0.0, 0.0, 1.0], 0.1),
                PositionConstraint(SphereRegion(T[:3, 3], 1e-3)),
            ),
        )
        found = constrained_ik(ROBOT, wanted).solutions
        assert found
        got = tip_pose(found[0].joints)
        assert np.linalg.norm(got[:3, 3] - T[:3, 3]) <= 1e-3 + 1e-6
        assert np.arccos(np.clip((got[:3, :3] @ up)[2], -1.0, 1.0)) <= 0.1 + 1e-6
        assert (found[0].residuals <= 1e-6).all()
        limits = CHAIN.limits
        assert ((found[0].joints >= limits.lower) & (found[0].joints <= limits.upper)).all()


def test_looking_at_a_target() -> None:
    for q in draws(1, 20):
        T = tip_pose(q)
        target = T[:3, 3] + 0.5 * T[:3, 2]
        wanted = ConstraintSet(
            CHAIN,
            (
                LookAtConstraint([0.0, 0.0, 1.0], target, 0.02),
                PositionConstraint(BoxRegion(T, np.full(3, 0.05))),
            ),
        )
        found = constrained_ik(ROBOT, wanted).solutions
        assert found
        got = tip_pose(found[0].joints)
        sight = target - got[:3, 3]
        cosine = got[:3, 2] @ sight / np.linalg.norm(sight)
        assert np.arccos(np.clip(cosine, -1.0, 1.0)) <= 0.02 + 1e-6
        assert (np.abs(T[:3, :3].T @ (got[:3, 3] - T[:3, 3])) <= 0.025 + 1e-6).all()


def test_a_whole_pose_is_reached() -> None:
    for q in draws(2, 10):
        T = tip_pose(q)
        found = constrained_ik(ROBOT, ConstraintSet(CHAIN, (RelativePoseConstraint(T),)))
        np.testing.assert_allclose(tip_pose(found.solutions[0].joints), T, atol=3e-6)


def by_slsqp(wanted: ConstraintSet, posture: Array, start: Array) -> tuple[float, Array]:
    def cost(q: Array) -> float:
        return float(0.5 * np.sum((q - posture) ** 2))

    def spare(q: Array) -> Array:
        return -wanted.residuals(q)

    best = fmin_slsqp(cost, start, f_ieqcons=spare, acc=1e-14, iprint=0)
    return cost(best), np.array(best)


@pytest.mark.parametrize("solver", ["descent", "ipopt"])
def test_both_solvers_hold_everything_and_agree_with_a_third(solver: str) -> None:
    # From near by, both and SLSQP must come to the same local best.
    for q in draws(3, 4):
        inner = np.clip(q, CHAIN.limits.lower + 0.3, CHAIN.limits.upper - 0.3)
        T = forward(CHAIN, inner)
        wanted = ConstraintSet(CHAIN, (PositionConstraint(BoxRegion(T, np.full(3, 0.02))),))
        posture = inner + 0.05
        options = IkOptions(posture=posture, seed_joints=inner, starts=1, solver=solver)  # type: ignore[arg-type]
        found = constrained_ik(ROBOT, wanted, None, options).solutions[0]
        assert found.solver == solver
        cost, best = by_slsqp(wanted, posture, inner)
        assert found.cost <= cost + 1e-6
        np.testing.assert_allclose(found.joints, best, atol=1e-4)


def test_programs_are_built_once_a_shape() -> None:
    first, second = (
        ConstraintSet(CHAIN, (ConeConstraint([0, 0, 1], [0, 0, 1], angle),)) for angle in (0.1, 0.2)
    )
    assert program(first) is program(second)
    other = ConstraintSet(CHAIN, (PositionConstraint(SphereRegion([0.4, 0, 0.4], 0.1)),))
    assert program(other) is not program(first)


def test_determinants_by_elimination_are_those_by_minors() -> None:
    """Where nothing is nearly singular; elsewhere they stay finite, and so do their logarithms."""
    q = casadi.SX.sym("q", CHAIN.n)
    J = symbolic_jacobian(CHAIN, q)
    gram = casadi.mtimes(J, J.T)
    both = casadi.vertcat(casadi.det(gram), _determinant(gram))
    slopes = casadi.Function("slopes", [q], [both, casadi.jacobian(both, q)])
    for joints in draws(7, 20):
        values, gradients = (np.array(part) for part in slopes(joints))
        np.testing.assert_allclose(values[1], values[0], rtol=1e-6, atol=1e-12)
        np.testing.assert_allclose(gradients[1], gradients[0], rtol=1e-5, atol=1e-9)
    values, gradients = (np.array(part) for part in slopes(np.zeros(CHAIN.n)))
    assert values[1] >= 0.0
    assert np.isfinite(gradients).all()


def test_no_program_is_begun_that_may_not_be_built_in_time(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    T = forward(CHAIN, draws(8, 1)[0])
    asked = list[bool]()

    def built(constraints: ConstraintSet, manipulability: bool = False) -> Program:
        asked.append(is_built(constraints, manipulability))
        return program(constraints, manipulability)

    monkeypatch.setattr("planning.constrained.ik.program", built)
    monkeypatch.setattr("planning.constrained.ik.BUILDING_TIME", 100.0)
    far = PositionConstraint(BoxRegion(T, np.full(3, 0.02)))
    away = ConeConstraint([0.0, 0.3, 1.0], [0.0, 0.0, 1.0], 0.01)
    nowhere = PositionConstraint(SphereRegion([9.0, 0.0, 0.0], 0.01))
    wanted = ConstraintSet(CHAIN, (far, away, nowhere))
    counts = []
    for seconds in (50.0, 200.0, 50.0):
        options = IkOptions(starts=2, deadline=Deadline.after(seconds))
        answer = constrained_ik(ROBOT, wanted, None, options)
        assert not answer.solutions
        counts.append(len(asked))
        assert answer.deterministic is bool(asked)
    assert counts[0] == 0 < counts[1] < counts[2]
    assert [is_known for is_known in asked if not is_known] == asked[:1]


def test_margin_in_a_shelf() -> None:
    scene = shelf()
    checker = Checker.of(ROBOT, scene, 0.02)
    rng = np.random.default_rng(4)
    done = 0
    while done < 4:
        q = np.clip(HOME + 0.5 * rng.normal(size=7), *CHAIN.sampling_bounds())
        T = forward(CHAIN, q)
        if T[0, 3] < 0.45 or not checker.valid(q):
            continue
        done += 1
        place = PositionConstraint(BoxRegion(T, np.full(3, 0.02)))
        wanted = ConstraintSet(CHAIN, (place, ClearanceConstraint(0.02)))
        found = constrained_ik(ROBOT, wanted, scene).solutions
        assert found
        assert checker.valid(np.array(found[0].joints))
        assert found[0].clearance > 0.0
        assert found[0].pair is not None


def test_objectives_pull_where_they_say() -> None:
    T = forward(CHAIN, HOME)
    wanted = ConstraintSet(CHAIN, (PositionConstraint(SphereRegion(T[:3, 3], 1e-3)),))

    def best(objective: str) -> Array:
        options = IkOptions(objective=objective, seed_joints=HOME)  # type: ignore[arg-type]
        return np.array(constrained_ik(ROBOT, wanted, None, options).solutions[0].joints)

    def manipulability(q: Array) -> float:
        data = MODEL.createData()
        full = np.concatenate([q, np.zeros(MODEL.nq - 7)])
        frame = MODEL.getFrameId(CHAIN.tip_link)
        J = pin.computeFrameJacobian(MODEL, data, full, frame, pin.LOCAL_WORLD_ALIGNED)[:, :7]
        return float(np.sqrt(np.linalg.det(J @ J.T)))

    middle = 0.5 * (CHAIN.limits.lower + CHAIN.limits.upper)
    half = 0.5 * (CHAIN.limits.upper - CHAIN.limits.lower)
    assert manipulability(best("manipulability")) > manipulability(best("nearest")) + 1e-3
    used = {name: np.abs((best(name) - middle) / half).max() for name in ("limits", "nearest")}
    assert used["limits"] < used["nearest"]
    assert np.linalg.norm(best("nearest") - HOME) < 1e-2


def test_soft_constraints_give_way() -> None:
    T = forward(CHAIN, HOME)
    place = PositionConstraint(SphereRegion(T[:3, 3], 1e-3))
    options = IkOptions(seed_joints=HOME)
    for weight, near in ((1e-3, HOME[0]), (1e3, 0.5)):
        wish = JointConstraint(CHAIN.joint_names[0], 0.5, weight=weight)
        found = constrained_ik(ROBOT, ConstraintSet(CHAIN, (place, wish)), None, options)
        assert abs(found.solutions[0].joints[0] - near) < 0.02
        assert found.solutions[0].residuals[0] <= 1e-6


def test_what_is_out_of_reach_is_told_with_what_is_left() -> None:
    wanted = ConstraintSet(CHAIN, (PositionConstraint(SphereRegion([3.0, 0.0, 0.3], 0.1)),))
    found = constrained_ik(ROBOT, wanted, None, IkOptions(starts=5))
    assert found.solutions == ()
    assert 1.0 < found.nearest.residuals[0] < 2.5


def test_several_solutions_are_distinct_and_sorted() -> None:
    T = forward(CHAIN, HOME)
    wanted = ConstraintSet(CHAIN, (RelativePoseConstraint(T),))
    options = IkOptions(most=5, seed_joints=HOME)
    found = constrained_ik(ROBOT, wanted, None, options).solutions
    # The arm's redundancy leaves a few local bests of one pose, not any number.
    assert 2 <= len(found) <= 5
    costs = [solution.cost for solution in found]
    assert costs == sorted(costs)
    for i, a in enumerate(found):
        assert all(np.abs(a.joints - b.joints).max() > 1e-3 for b in found[:i])
    again = constrained_ik(ROBOT, wanted, None, options).solutions
    np.testing.assert_array_equal(again[0].joints, found[0].joints)


def test_requests_that_make_no_sense() -> None:
    nothing = ConstraintSet(CHAIN, ())
    with pytest.raises(InvalidGoal, match="tool_speed"):
        constrained_ik(ROBOT, ConstraintSet(CHAIN, (ToolSpeedConstraint(1.0),)))
    with pytest.raises(InvalidRobotState, match="posture"):
        constrained_ik(ROBOT, nothing, None, IkOptions(posture=np.zeros(3)))
    for wrong in ({"objective": "speed"}, {"solver": "magic"}, {"most": 0}):
        with pytest.raises(InvalidOption):
            IkOptions(**wrong)


def test_a_search_that_time_ended_says_so() -> None:
    nothing = ConstraintSet(CHAIN, ())
    late = constrained_ik(ROBOT, nothing, None, IkOptions(deadline=Deadline.after(0.0), starts=50))
    assert late.starts == 1
    assert not late.deterministic
    for patient in (None, Deadline.after(600.0)):
        found = constrained_ik(ROBOT, nothing, None, IkOptions(deadline=patient, starts=3))
        assert found.deterministic


def test_a_slow_machine_finds_the_same_configurations(monkeypatch: pytest.MonkeyPatch) -> None:
    wanted = ConstraintSet(
        CHAIN, (PositionConstraint(BoxRegion(tip_pose(draws(3, 1)[0]), np.full(3, 0.01))),)
    )
    fast = constrained_ik(ROBOT, wanted, None, IkOptions(most=4, starts=12))
    clock = SimpleNamespace(monotonic=lambda: 100.0 * time.monotonic())
    monkeypatch.setattr(deadlines, "time", clock)
    patient = IkOptions(most=4, starts=12, deadline=Deadline.after(6000.0))
    slow = constrained_ik(ROBOT, wanted, None, patient)
    assert slow.deterministic
    for one, other in zip(slow.solutions, fast.solutions, strict=True):
        np.testing.assert_array_equal(one.joints, other.joints)
