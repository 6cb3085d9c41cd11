"""Configurations under constraints: held, clear, best, and found within a deadline."""

import itertools
import time
from types import SimpleNamespace

import numpy as np
import pytest
import trimesh
from scipy.optimize import fmin_slsqp

from kinematics.arrays import Array
from kinematics.errors import InvalidGoal, InvalidOption, InvalidRobotState
from kinematics.forward import forward
from obstacles.collision.checker import Checker
from obstacles.scenes.scene import Obstacle, Scene
from obstacles.shapes.shape import Sphere
from planning.constrained import ik
from planning.constrained.ik import Descents, IkOptions, constrained_ik
from planning.constraints.constraint_set import ConstraintSet
from planning.constraints.kinds.constraint import (
    BoxRegion,
    ClearanceConstraint,
    ConeConstraint,
    JointConstraint,
    PositionConstraint,
    RelativePoseConstraint,
    SphereRegion,
    ToolSpeedConstraint,
)
from planning.constraints.solvers.active_set import FEASIBLE, descend
from planning.constraints.solvers.active_set_program import (
    LEAST_GAIN,
    make_goal,
    search_arrays,
)
from planning.values import deadline as deadlines
from planning.values.deadline import Deadline
from tests.obstacles.arms import mesh_shape
from tests.obstacles.collision.test_fcl_distance import slide
from tests.obstacles.distance.triangles.test_distance import apart
from tests.obstacles.meshes.test_decomposition import ring
from tests.planning.pinocchio_arm import PinocchioArm
from tests.planning.scenes import HOME, builtin, pillar, shelf

ROBOT = builtin("panda")
CHAIN = ROBOT.chain
ORACLE = PinocchioArm()


def draws(seed: int, count: int) -> Array:
    """Random configurations whose own links are apart, shape (count, n)."""
    random, checker = np.random.default_rng(seed), Checker.of(ROBOT, Scene(()))
    states = (random.uniform(*CHAIN.sampling_bounds()) for _ in range(100 * count))
    return np.array(list(itertools.islice(filter(checker.valid, states), count)))


def test_upright_at_a_place() -> None:
    for q in draws(0, 20):
        T = ORACLE.pose(q)
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
        got = ORACLE.pose(found[0].joints)
        assert np.linalg.norm(got[:3, 3] - T[:3, 3]) <= 1e-3 + 1e-6
        assert np.arccos(np.clip((got[:3, :3] @ up)[2], -1.0, 1.0)) <= 0.1 + 1e-6
        assert (found[0].residuals <= 1e-6).all()
        limits = CHAIN.limits
        assert ((found[0].joints >= limits.lower) & (found[0].joints <= limits.upper)).all()


def by_slsqp(wanted: ConstraintSet, posture: Array, start: Array) -> tuple[float, Array]:
    def cost(q: Array) -> float:
        return float(0.5 * np.sum((q - posture) ** 2))

    def spare(q: Array) -> Array:
        return -wanted.residuals(q)

    best = fmin_slsqp(cost, start, f_ieqcons=spare, acc=1e-14, iprint=0)
    return cost(best), np.array(best)


def test_it_holds_everything_and_agrees_with_another_solver() -> None:
    # From near by, it and SLSQP must come to the same local best.
    for q in draws(3, 4):
        inner = np.clip(q, CHAIN.limits.lower + 0.3, CHAIN.limits.upper - 0.3)
        T = forward(CHAIN, inner)
        wanted = ConstraintSet(CHAIN, (PositionConstraint(BoxRegion(T, np.full(3, 0.02))),))
        posture = inner + 0.05
        options = IkOptions(posture=posture, seed_joints=inner, starts=1)
        found = constrained_ik(ROBOT, wanted, None, options).solutions[0]
        cost, best = by_slsqp(wanted, posture, inner)
        assert found.cost <= cost + 1e-6
        np.testing.assert_allclose(found.joints, best, atol=1e-4)


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
        J = ORACLE.jacobian(q)
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
    for wrong in ({"objective": "speed"}, {"most": 0}):
        with pytest.raises(InvalidOption):
            IkOptions(**wrong)


def test_a_slow_machine_finds_the_same_configurations(monkeypatch: pytest.MonkeyPatch) -> None:
    wanted = ConstraintSet(
        CHAIN, (PositionConstraint(BoxRegion(ORACLE.pose(draws(3, 1)[0]), np.full(3, 0.01))),)
    )
    fast = constrained_ik(ROBOT, wanted, None, IkOptions(most=4, starts=12))
    clock = SimpleNamespace(monotonic=lambda: 100.0 * time.monotonic())
    monkeypatch.setattr(deadlines, "time", clock)
    patient = IkOptions(most=4, starts=12, deadline=Deadline.after(6000.0))
    slow = constrained_ik(ROBOT, wanted, None, patient)
    assert slow.deterministic
    for one, other in zip(slow.solutions, fast.solutions, strict=True):
        np.testing.assert_array_equal(one.joints, other.joints)


HOME_POSE = forward(CHAIN, HOME)
#: Upright in a ball beside a post, nearest to a posture that is elsewhere.
WANTED = ConstraintSet(
    CHAIN,
    (
        ConeConstraint(HOME_POSE[:3, :3].T @ [0.0, 0.0, 1.0], [0.0, 0.0, 1.0], 0.1),
        PositionConstraint(SphereRegion(HOME_POSE[:3, 3], 0.05)),
    ),
)
MODEL = search_arrays(Checker.of(ROBOT, pillar(0.45, 0.25)).model, 1e-6)
GOAL = make_goal(WANTED, HOME + 0.4, np.ones(7))


def starts(count: int) -> list[Array]:
    random = np.random.default_rng(0)
    return list(random.uniform(*CHAIN.sampling_bounds(), (count, 7)))


def test_few_steps_at_a_time_lead_where_one_descent_does() -> None:
    arrived = 0
    for start in starts(16):
        whole, found = start.copy(), np.empty(2)
        descend(MODEL, GOAL, whole, found)
        sliced = Descents(GOAL, Deadline.after(600.0)).descend(MODEL, start, LEAST_GAIN)
        arrived += found[0] <= FEASIBLE
        np.testing.assert_allclose(sliced, whole, atol=1e-4 if found[0] <= FEASIBLE else 0.5)
    assert arrived >= 3


def test_deadlines_are_kept_where_one_descent_takes_longer(monkeypatch: pytest.MonkeyPatch) -> None:
    """Among rings of many triangles."""
    clock = SimpleNamespace(monotonic=time.process_time, thread_time=time.process_time)
    monkeypatch.setattr(deadlines, "time", clock)
    monkeypatch.setattr(ik, "time", clock)
    places = [forward(CHAIN, q) for q in starts(4)]
    rings = tuple(Obstacle(f"ring{k}", mesh_shape(ring()), T) for k, T in enumerate(places))
    scene = Scene(rings)
    Checker.of(ROBOT, scene, 0.0)
    # Kernels are loaded and meshes packed before the clock counts.
    constrained_ik(ROBOT, WANTED, scene, IkOptions(most=2, deadline=Deadline.after(0.01)))
    for allowed in (0.002, 0.1):
        began = time.process_time()
        how = IkOptions(most=30, starts=100_000, deadline=Deadline.after(allowed))
        found = constrained_ik(ROBOT, WANTED, scene, how)
        taken = time.process_time() - began
        assert taken < allowed + 0.1
        assert found.starts >= 1
        for solution in found.solutions:
            assert WANTED.residuals(solution.joints).max() <= 1e-6
            assert Checker.of(ROBOT, scene, 0.0).valid(solution.joints)


UR5E_ROBOT = builtin("ur5e")
#: A ring on a rail along x whose hole is 0.398 m wide, and a ball that has 28 mm to spare in it.
RING = slide(*mesh_shape(ring()).pieces())
BALL = Scene((Obstacle("ball", Sphere(0.37)),))


def at_x(x: float, width: float) -> ConstraintSet:
    return ConstraintSet(RING.chain, (JointConstraint("x", x, width, width),))


def test_own_links_are_apart_without_a_scene() -> None:
    """A ball beside the base that the tip reaches by folding the forearm into it, or without."""
    place = PositionConstraint(SphereRegion(np.array([0.0, -0.2, 0.1]), 0.005))
    wanted, free = ConstraintSet(UR5E_ROBOT.chain, (place,)), Checker.of(UR5E_ROBOT, Scene(()))
    for seed in range(8):
        answer = constrained_ik(UR5E_ROBOT, wanted, None, IkOptions(seed=seed, starts=30))
        for solution in answer.solutions:
            assert free.valid(solution.joints)
        assert answer.solutions


def test_a_seed_in_a_hollow_is_not_led_out_of_it() -> None:
    """What covers the ring is struck by the ball; its triangles are not."""
    seed = IkOptions(seed_joints=np.array([0.01]))
    (solution,) = constrained_ik(RING, at_x(0.0, 0.5), BALL, seed).solutions
    assert abs(solution.joints[0] - 0.01) < 1e-6
    sphere = trimesh.creation.icosphere(4, 0.37)
    turn = np.eye(4)
    turn[0, 3] = solution.joints[0]
    assert apart(ring(), turn, sphere, np.eye(4)) > 0.0


def test_a_hollow_is_found_from_outside() -> None:
    """Only starts that keep triangles apart arrive where covers overlap the ball."""
    how = IkOptions(seed_joints=np.array([2.0]), starts=40)
    answer = constrained_ik(RING, at_x(0.0, 0.02), BALL, how)
    assert answer.solutions
    assert 1 < answer.starts < 40


def test_more_solutions_than_there_are_do_not_cost_all_starts() -> None:
    answer = constrained_ik(RING, at_x(0.0, 1e-5), BALL, IkOptions(most=2, starts=1000))
    assert len(answer.solutions) == 1
    assert answer.starts < 60


def test_clearance_is_kept_from_obstacles_by_meshes() -> None:
    wanted = ConstraintSet(
        RING.chain, (JointConstraint("x", 0.0, 0.5, 0.5), ClearanceConstraint(0.02))
    )
    how = IkOptions(seed_joints=np.array([0.02]))
    (solution,) = constrained_ik(RING, wanted, BALL, how).solutions
    assert Checker.of(RING, BALL, 0.02).valid(solution.joints)
