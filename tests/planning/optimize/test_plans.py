"""Optimised plans and the rows they are made of: closed forms, differences, pinocchio."""

import time
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from benchmarks.judges import ratios
from dynamics.model.payload import with_payload
from kinematics.arrays import Array
from kinematics.errors import InvalidOption
from kinematics.forward import forward
from kinematics.pose import transform
from kinematics.trajectory.trajectory import Trajectory
from obstacles.collision.checker import Checker
from obstacles.collision.fcl_distance import FclWorld
from obstacles.scenes.scene import Obstacle, Scene
from obstacles.shapes.shape import Sphere
from planning.constrained.checker import ConstrainedChecker
from planning.constrained.ik import IkOptions, constrained_ik
from planning.constraints.constraint_set import ConstraintSet
from planning.constraints.kinds.constraint import (
    ConeConstraint,
    JointConstraint,
    LineRegion,
    PositionConstraint,
    SphereRegion,
)
from planning.optimize import objective
from planning.optimize.iterate import Iterate, fit_spline
from planning.optimize.linearization import local_matrix, tool_speed, torques
from planning.optimize.scp import Descent
from planning.optimize.spline import SplineSpace
from planning.optimize.task import End, Task
from planning.options import Options
from planning.pipeline.pipeline import plan
from planning.problem import JointGoal, Problem
from planning.proof.certificate import certify
from planning.result import Failure, Plan
from planning.timing.options import Payload, TimingOptions
from planning.values.deadline import Deadline
from planning.values.limits import MotionLimits
from planning.values.optimize_options import Objective, RefineOptions
from tests.planning.dense import least_clearance, worst_ratio
from tests.planning.optimize.motions import PANDA, SPACE, iterate, packed, task, unpacked
from tests.planning.pinocchio_arm import PinocchioArm
from tests.planning.scenes import HOME, box, builtin, planned_motion, planning_failure

OPTIMIZE = Options(planner="optimize", timeout=300.0)
ASIDE = HOME + np.array([1.1, 0.3, -0.2, 0.4, 0.2, 0.1, 0.3])
BEHIND = HOME + np.array([1.1, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])


def options(timing: TimingOptions | None = None, **refine: Any) -> Options:
    return Options("optimize", refine, timing=timing or TimingOptions(), timeout=300.0)


def problem(name: str, start: Array, goal: JointGoal | Array, **more: Any) -> Problem:
    goals = (goal if isinstance(goal, JointGoal) else JointGoal(goal),)
    return Problem(builtin(name), more.pop("scene", Scene()), start, goals, **more)


def solved(asked: Problem, how: Options = OPTIMIZE) -> Plan:
    answer = planned_motion(asked, how)
    assert answer.certificate.verified
    assert worst_ratio(answer.trajectory, asked.robot) <= 1.0 + 1e-9
    np.testing.assert_allclose(answer.trajectory.start, asked.start, atol=1e-9)
    if asked.scene.obstacles:
        assert least_clearance(answer.trajectory, asked.robot, asked.scene, asked.margin) > 0.0
    return answer


def behind_a_post() -> Problem:
    """A post that the arm has to go around."""
    post = Scene((box("post", (0.08, 0.08, 1.2), (0.307, 0.188, 0.6)),))
    return problem("panda", HOME, BEHIND, scene=post)


@cache
def known_behind_a_post() -> Plan:
    """The plan that the others are measured by."""
    return planned_motion(behind_a_post(), Options(timeout=300.0))


@cache
def optimised_behind_a_post() -> Plan:
    """The plan of all usual options; all that it needs is compiled and loaded then."""
    return solved(behind_a_post())


def test_one_joint_tends_to_the_bang_bang_time() -> None:
    v, a, way = 3.0, 12.0, np.array([1.2, 0.0])
    least = 1.2 / v + v / a
    bounds = {"velocity": np.full(2, v), "acceleration": np.full(2, a)}
    start, end = (End.at_rest(q, smooth=False) for q in (0.0 * way, way))
    task = Task(Checker.of(builtin("planar_rr"), Scene()), start, end, bounds)
    known = Trajectory(
        task.chain.joint_names,
        np.array([0.0, 9.0]),
        np.stack([0.0 * way, way / 9.0], axis=-1)[None],
    )
    times = []
    for count in (10, 24, 48):
        near = fit_spline(task, SplineSpace.uniform(3, count), known)
        descent = Descent(task, RefineOptions(), near, np.inf, Deadline.after(60.0))
        descent.run(Deadline.after(30.0))
        assert descent.best is not None
        times.append(descent.best.trajectory.duration)
    assert times[0] > times[1] > times[2] > least
    assert times[2] < 1.002 * least


def test_the_least_jerk_is_the_quintic() -> None:
    answer = solved(problem("panda", HOME, HOME + 0.3), options(objective="jerk", duration=2.0))
    trajectory = answer.trajectory
    assert trajectory.duration == pytest.approx(2.0, rel=1e-5)
    s = np.linspace(0.0, 1.0, 201)
    quintic = HOME + 0.3 * (10.0 * s**3 - 15.0 * s**4 + 6.0 * s**5)[:, None]
    sampled = trajectory.sample(s * trajectory.duration)
    np.testing.assert_allclose(sampled, quintic, atol=1e-6)


def test_the_shortest_path_is_straight() -> None:
    # Without the post, or as near to it as can be.
    asked = behind_a_post()
    bent = known_behind_a_post()
    free = problem("panda", HOME, BEHIND)
    straight = solved(free, options(objective="path_length"))
    assert straight.path.length == pytest.approx(1.1, rel=1e-4)
    around = solved(asked, options(objective="path_length", rounds=30))
    assert straight.path.length < around.path.length < bent.path.length * (1.0 + 1e-3)


@pytest.mark.parametrize("objective", ["time", "jerk", "energy", "path_length"])
def test_every_objective_gets_smaller(objective: str) -> None:
    asked = behind_a_post()
    known, better = known_behind_a_post(), solved(asked, options(objective=objective))
    assert better.planner == "optimize"
    values = [_measure(answer.trajectory, objective, asked) for answer in (known, better)]
    assert values[1] < values[0]


def _measure(trajectory: Trajectory, objective: str, asked: Problem) -> float:
    times = np.linspace(0.0, trajectory.duration, 4001)
    if objective == "time":
        return trajectory.duration
    if objective == "path_length":
        return float(np.linalg.norm(np.diff(trajectory.sample(times), axis=0), axis=1).sum())
    if objective == "jerk":
        if trajectory.continuity().acceleration > 1e-6:
            return np.inf
        return float(np.trapezoid(np.square(trajectory.sample(times, 3)).sum(axis=1), times))
    torque = PinocchioArm().torques(trajectory, times)
    return float(np.trapezoid(np.square(torque).sum(axis=1), times))


@pytest.mark.parametrize("objective", ["time", "energy"])
def test_ipopt_reaches_what_the_convex_rounds_reach(objective: str) -> None:
    asked = behind_a_post()
    times = []
    for solver in ("piqp", "ipopt"):
        answer = solved(asked, options(objective=objective, solver=solver))
        assert answer.planner == "optimize"
        times.append(_measure(answer.trajectory, objective, asked))
    # Two solvers of the same rounds: what is left differs by the last round's gain.
    np.testing.assert_allclose(times[0], times[1], rtol=0.02)


def test_refinement_of_any_planner_is_no_worse() -> None:
    asked = behind_a_post()
    for planner in ("auto", "rrt_connect"):
        for method in ("toppra", "jerk_limited"):
            timing = TimingOptions(method)
            plain = Options(planner, timing=timing, timeout=300.0)
            refined = Options(planner, timing=timing, timeout=300.0, refine=RefineOptions())
            known, better = plan(asked, plain), solved(asked, refined)
            assert isinstance(known, Plan)
            assert better.trajectory.duration < known.trajectory.duration
            outcomes = [stage.outcome for stage in better.stages if stage.name == "optimize"]
            assert outcomes[-1] == "succeeded"
        jerk = asked.robot.chain.limits.jerk
        assert ratios.worst_ratio(better.trajectory, jerk, 3) <= 1.0 + 1e-9


def test_the_same_twice() -> None:
    first, second = optimised_behind_a_post(), solved(behind_a_post())
    assert first.trajectory == second.trajectory


def test_going_nowhere_is_left_as_it_is() -> None:
    answer = solved(problem("panda", HOME, HOME))
    assert answer.planner == "straight_line"
    assert answer.trajectory.duration < 0.01


@pytest.mark.parametrize(
    "name", ["scara", "stanford", "cart_pendulum", "planar_rr", "kr6_sixx", "ur5e"]
)
def test_other_arms(name: str) -> None:
    limits = builtin(name).chain.limits
    low, high = np.maximum(limits.lower, -1.0), np.minimum(limits.upper, 1.0)
    rng = np.random.default_rng(4)
    ends = (rng.uniform(0.6 * low + 0.4 * high, 0.4 * low + 0.6 * high) for _ in range(2))
    answer = plan(problem(name, *ends), options(objective={"time": 1.0, "jerk": 1e-9}))
    if isinstance(answer, Failure):
        assert answer.code.endswith("IN_COLLISION")
    else:
        assert answer.certificate.verified


@pytest.mark.parametrize("method", ["toppra", "jerk_limited"])
def test_torques_with_a_payload_are_kept(method: Any) -> None:
    timing = TimingOptions(method, torque_limits=True, payload=Payload(3.0))
    chain = builtin("panda").chain
    effort = chain.limits.effort * np.array([0.45, 0.9, 0.45, 0.7, 0.7, 0.9, 0.7])
    asked = problem("panda", HOME, ASIDE)
    known = plan(asked, Options(timing=timing, limits={"effort": effort}, timeout=300.0))
    how = Options("optimize", timing=timing, limits={"effort": effort}, timeout=300.0)
    better = solved(asked, how)
    assert isinstance(known, Plan)
    assert better.trajectory.duration <= known.trajectory.duration
    trajectory = better.trajectory
    times = np.linspace(0.0, trajectory.duration, 3001)
    share = np.abs(PinocchioArm(load=3.0).torques(trajectory, times) / effort).max()
    bound = better.certificate.limits["torque"].worst_ratio
    assert share <= bound <= 1.0
    assert bound <= share * 1.01


def test_tool_speed_is_kept() -> None:
    asked, timing = problem("panda", HOME, ASIDE), TimingOptions("toppra", tool_speed=0.4)
    better = solved(asked, options(timing))
    assert better.planner == "optimize"
    assert better.certificate.limits["tool_speed"].worst_ratio <= 1.0
    times = np.linspace(0.0, better.trajectory.duration, 4001)
    fastest = PinocchioArm().tip_speeds(better.trajectory, times).max()
    assert 0.98 * 0.4 < fastest <= 0.4 * (1.0 + 1e-9)


@pytest.mark.parametrize("method", ["toppra", "jerk_limited"])
def test_ends_may_move(method: Any) -> None:
    v, a = np.linspace(-0.4, 0.5, 7), np.linspace(0.8, -0.6, 7)
    goal = JointGoal(ASIDE, -v, a)
    asked = problem("panda", HOME, goal, start_velocity=v, start_acceleration=a)
    trajectory = solved(asked, options(TimingOptions(method))).trajectory
    np.testing.assert_allclose(trajectory.end, ASIDE, atol=1e-9)
    for order, values in ((1, (v, -v)), (2, (a, a))):
        ends = trajectory.sample([0.0, trajectory.duration], order)
        np.testing.assert_allclose(ends, np.array(values), atol=1e-8)


def test_ends_too_fast_are_told() -> None:
    asked = problem("panda", HOME, ASIDE, start_velocity=np.full(7, 9.0))
    answer = planning_failure(asked, OPTIMIZE)
    assert answer.code == "START_STATE_INVALID"
    assert answer.details["joint"] in asked.robot.chain.joint_names


def test_a_wall_ahead_can_not_be_braked_from() -> None:
    chain = builtin("panda").chain
    near = HOME.copy()
    near[0] = chain.limits.upper[0] - 0.01
    v = np.zeros(7)
    v[0] = chain.limits.velocity[0]
    answer = planning_failure(problem("panda", near, ASIDE, start_velocity=v), OPTIMIZE)
    assert (answer.code, answer.stage) == ("START_STATE_INVALID", "start")
    assert "can't stop in time" in answer.message
    assert answer.details["joint"] == chain.joint_names[0]
    assert answer.details["room"] == pytest.approx(0.01)
    v[0] = -v[0]
    assert isinstance(plan(problem("panda", near, ASIDE, start_velocity=v), OPTIMIZE), Plan)


def test_an_obstacle_ahead_can_not_be_braked_from() -> None:
    """The first link turns towards a post: it needs v^2 / 2a to stop, and has 0.6 of that."""
    robot, how = builtin("planar_rr"), options(TimingOptions("toppra"))
    limits = robot.chain.limits
    start, v, a = np.zeros(2), np.array([limits.velocity[0], 0.0]), limits.acceleration[0]
    reach = float(np.linalg.norm(forward(robot.chain, start)[:3, 3]))
    angle = 0.6 * v[0] ** 2 / (2.0 * a)
    at = 0.4 * reach * np.array([np.cos(angle), 0.0, np.sin(angle)])
    scene = Scene((Obstacle("post", Sphere(0.01), transform(None, at)),))
    world = FclWorld(robot, scene)

    def ask(share: float) -> Plan | Failure:
        goal = np.array([-0.5, 0.0])
        moving = problem("planar_rr", start, goal, scene=scene, start_velocity=share * v)
        return plan(moving, how)

    answer = ask(1.0)
    assert isinstance(answer, Failure)
    assert "can't stop before 'post'" in answer.message
    found = answer.details["braking"]
    assert found["pair"][1] == "post"
    share, time_of_touch = found["velocity_share"], found["time"]
    assert f"at most {share:.2g} of this velocity" in answer.hint
    # FCL: apart at the start by as much as is told, touching then, and not with the share told.
    assert found["distance"] == pytest.approx(world.clearance(start).distance, abs=1e-6)
    turned = v[0] * time_of_touch - 0.5 * a * time_of_touch**2
    assert world.clearance(np.array([turned, 0.0])).distance == pytest.approx(0.0, abs=1e-6)
    turns = [((part * v[0]) ** 2 / (2.0 * a), part == share) for part in (share, share + 0.02)]
    for turn, free in turns:
        assert (world.clearance(np.array([turn, 0.0])).distance > 0.0) is free
    assert isinstance(ask(0.9 * share), Plan)


def test_too_short_a_duration_says_what_is_needed() -> None:
    answer = planning_failure(problem("panda", HOME, ASIDE), options(duration=0.05))
    assert answer.code == "INVALID_MOTION_PLAN"
    assert "takes" in answer.message
    assert "duration" in answer.hint


@pytest.mark.parametrize("points", [16, 64])
@pytest.mark.parametrize("timeout", [0.02, 0.1, 0.3])
def test_deadlines_are_kept(timeout: float, points: int) -> None:
    asked = behind_a_post()
    optimised_behind_a_post()
    how = Options("optimize", {"rounds": 100, "control_points": points}, timeout=timeout)
    began = time.process_time()
    answer = plan(asked, how)
    # Processor time, for others compute here too: it is at most the time on the wall.
    assert time.process_time() - began < timeout + 0.15
    assert isinstance(answer, Plan) or answer.code == "TIMED_OUT"


def test_given_times_are_not_optimised() -> None:
    timing = TimingOptions("spline", times=(0.0, 3.0))
    with pytest.raises(InvalidOption, match="times"):
        plan(problem("panda", HOME, ASIDE), Options("optimize", timing=timing))


ROBOT = builtin("panda")
CHAIN, ORACLE = ROBOT.chain, PinocchioArm()
UP, DOWN = np.array([0.0, 0.0, 1.0]), np.array([0.0, 0.0, -1.0])
CONE = ConeConstraint(UP, DOWN, 0.03)


def at(place: list[float]) -> np.ndarray:
    narrow = ConeConstraint(UP, DOWN, 0.01)
    asked = ConstraintSet(CHAIN, (PositionConstraint(SphereRegion(place, 1e-3)), narrow))
    found = constrained_ik(ROBOT, asked, None, IkOptions(seed_joints=HOME))
    return np.array(found.solutions[0].joints)


def test_a_motion_is_brought_into_its_cone_and_kept_there() -> None:
    start, goal = at([0.35, -0.4, 0.3]), at([0.45, 0.35, 0.5])
    held = ConstraintSet(CHAIN, (CONE,))
    bump = np.array([0.0, 0.3, 0.0, 0.0, 0.5, 0.6, 0.0])
    bent = np.stack([start, goal - start + bump, -bump], axis=-1)[None]
    known = Trajectory(CHAIN.joint_names, np.array([0.0, 1.0]), bent)
    places = np.linspace(0.0, 1.0, 200)
    assert held.residuals(known.sample(places)).max() > 0.01
    plain = Checker.of(ROBOT, Scene())
    checker = ConstrainedChecker(plain.model, plain.slack, constraints=held, spare=np.full(1, 0.02))
    bounds = {"velocity": CHAIN.limits.velocity, "acceleration": CHAIN.limits.acceleration}
    ends = (End.at_rest(q, smooth=False) for q in (start, goal))
    task = Task(checker, next(ends), next(ends), bounds, constraints=held)
    near = fit_spline(task, SplineSpace.uniform(3, 16), known)
    descent = Descent(task, RefineOptions(rounds=40), near, np.inf, Deadline.after(60.0))
    descent.run(Deadline.after(300.0))
    assert descent.best is not None, descent.obstruction
    motion = descent.best.trajectory
    proof = certify(motion, ROBOT, Scene(), limits=MotionLimits(bounds), constraints=held)
    assert proof.verified, proof.violation
    for q in motion.sample(np.linspace(0.0, motion.duration, 1000)):
        down = -ORACLE.pose(q)[2, 2]
        assert np.arccos(np.clip(down, -1.0, 1.0)) <= 0.03 + 1e-6


def test_a_wish_is_paid_for_with_time() -> None:
    places = np.array([[0.35, -0.4, 0.3], [0.45, 0.35, 0.5]])
    start, goal = (at(place.tolist()) for place in places)
    along = (places[1] - places[0]) / np.linalg.norm(places[1] - places[0])
    line = PositionConstraint(LineRegion(places[0], along, 0.01))

    def strayed(weight: float | None) -> tuple[float, float]:
        wish = None if weight is None else ConstraintSet(CHAIN, (replace(line, weight=weight),))
        asked = Problem(ROBOT, Scene(), start, (JointGoal(goal),), constraints=wish)
        answer = planned_motion(asked, Options("optimize", timeout=60.0))
        motion = answer.trajectory
        times = np.linspace(0.0, motion.duration, 2001)
        over = []
        for q in motion.sample(times):
            off = ORACLE.pose(q)[:3, 3] - places[0]
            over.append(max(float(np.linalg.norm(off - (off @ along) * along)) - 0.01, 0.0))
        return motion.duration, float(np.trapezoid(np.square(over), times))

    without, little, much = (strayed(weight) for weight in (None, 100.0, 1e4))
    # The more it weighs the less it is violated, and the longer the motion may take for that.
    assert without[1] > 2.0 * little[1] > 10.0 * much[1]
    assert without[0] <= little[0] + 1e-3
    assert little[0] <= much[0] + 1e-3
    # Time and half the weighed square of what is violated: each optimum is no worse at its own.
    for one, weight in ((little, 100.0), (much, 1e4)):
        costs = [T + 0.5 * weight * integral for T, integral in (without, little, much)]
        assert one[0] + 0.5 * weight * one[1] <= min(costs) * 1.02


def test_the_model_of_soft_constraints_has_their_gradient() -> None:
    start, goal = at([0.35, -0.4, 0.3]), at([0.45, 0.35, 0.5])
    soft = ConstraintSet(
        CHAIN,
        (
            replace(CONE, weight=30.0),
            PositionConstraint(SphereRegion([0.4, 0.0, 0.4], 0.05), weight=7.0),
        ),
    )
    bounds = {"velocity": CHAIN.limits.velocity, "acceleration": CHAIN.limits.acceleration}
    ends = (End.at_rest(q, smooth=False) for q in (start, goal))
    plain = Task(Checker.of(ROBOT, Scene()), next(ends), next(ends), bounds)
    rng, space = np.random.default_rng(5), SplineSpace.uniform(3, 12)
    points = np.linspace(start, goal, 12) + rng.normal(scale=0.1, size=(12, 7))
    here = Iterate(space, points, 1.3)
    z = np.append(points.ravel(), [1.3, 0.0])
    weights: dict[Objective, float] = {"time": 1.0}
    models = [objective.model(task, weights, here) for task in (plain, replace(plain, soft=soft))]
    gradient = (models[1].H - models[0].H) @ z + models[1].g - models[0].g

    def worth(at: np.ndarray) -> float:
        motion = Iterate(space, at[:-2].reshape(12, 7), float(at[-2]))
        moving = motion.trajectory(CHAIN.joint_names)
        return objective.value(moving, {}, CHAIN, soft)

    for _ in range(5):
        direction = np.append(rng.normal(size=len(z) - 1), 0.0)
        slope = (worth(z + 1e-6 * direction) - worth(z - 1e-6 * direction)) / 2e-6
        assert abs(gradient @ direction - slope) <= 1e-5 * np.linalg.norm(gradient) * 10.0


U = np.linspace(0.03, 0.97, 9)


@pytest.mark.parametrize("response", [torques, tool_speed])
def test_responses_change_as_their_derivatives_say(response: object) -> None:
    assert callable(response)
    at = iterate(1)
    found = response(PANDA, at, U)
    m = found.values.shape[1]
    rows = [g.reshape(-1, 7) for g in found.gradients]
    A = local_matrix(at, np.repeat(U, m), rows, found.in_time.ravel()).toarray()
    direction = np.append(np.random.default_rng(2).normal(size=A.shape[1] - 1), 0.0)
    step, z = 1e-6, packed(at)
    ahead = response(PANDA, unpacked(z + step * direction), U).values.ravel()
    behind = response(PANDA, unpacked(z - step * direction), U).values.ravel()
    slope = (ahead - behind) / (2.0 * step)
    np.testing.assert_allclose(A @ direction, slope, atol=1e-6 * np.abs(slope).max())


@pytest.mark.parametrize("name", ["time", "jerk", "energy"])
def test_models_have_the_gradient_of_the_objective(name: Objective) -> None:
    at, weights = iterate(3), {name: 1.0}
    model = objective.model(task(), weights, at)
    z, rng = packed(at), np.random.default_rng(4)
    gradient = model.H @ z + model.g
    for _ in range(5):
        direction = np.append(rng.normal(size=len(z) - 1), 0.0)
        step = 1e-6
        values = [
            objective.value(
                unpacked(z + sign * step * direction).trajectory(PANDA.joint_names), weights, PANDA
            )
            for sign in (1.0, -1.0)
        ]
        slope = (values[0] - values[1]) / (2.0 * step)
        # The smoothing of the time objective is part of its model.
        assert gradient @ direction == pytest.approx(slope, rel=1e-4, abs=0.1)
    assert (np.linalg.eigvalsh(model.H.toarray()) > -1e-6 * abs(model.H).max()).all()


PINOCCHIO = PinocchioArm()
PLACES = np.linspace(0.0, 1.0, 7)


@pytest.mark.parametrize("duration", [0.4, 1.3, 6.0])
def test_values_are_pinocchios_in_time(duration: float) -> None:
    at = Iterate(SPACE, iterate(2).points, duration)
    tau, speed = torques(PANDA, at, PLACES), tool_speed(PANDA, at, PLACES)
    assert tau.values.shape == (len(PLACES), 7)
    assert speed.values.shape == (len(PLACES), 1)
    for k, u in enumerate(PLACES):
        q, qd, qdd = (at.sample(np.array([u]), r)[0] / duration**r for r in range(3))
        wanted = PINOCCHIO.torque(q, qd, qdd) + PANDA.viscous_friction * qd
        np.testing.assert_allclose(tau.values[k], wanted, atol=1e-9 * np.abs(wanted).max())
        fastest = float(np.linalg.norm(PINOCCHIO.tip_velocity(q, qd)))
        assert speed.values[k, 0] == pytest.approx(fastest, abs=1e-4)


NAMES = PANDA.joint_names
WAY = np.array([0.3, -0.2, 0.1, 0.4, 0.0, -0.5, 0.2])


def test_jerk_without_bound_is_infinite() -> None:
    halves = np.zeros((2, 7, 3))
    halves[0, :, 2], halves[1, :, 0] = WAY, WAY
    halves[1, :, 1], halves[1, :, 2] = 2.0 * WAY, -WAY
    bang_bang = Trajectory(NAMES, np.array([0.0, 1.0, 2.0]), halves)
    assert bang_bang.continuity().velocity < 1e-12
    assert objective.value(bang_bang, {"jerk": 1.0}, PANDA) == np.inf
    assert np.isfinite(objective.value(bang_bang, {"time": 1.0, "energy": 1.0}, PANDA))


def test_energy_is_the_integral_of_pinocchios_squared_torques() -> None:
    motion, oracle = iterate(1).trajectory(NAMES), PinocchioArm()
    times = np.linspace(0.0, motion.duration, 2001)
    states = zip(*(motion.sample(times, order) for order in range(3)), strict=True)
    tau = np.array([oracle.torque(*s) + PANDA.viscous_friction * s[1] for s in states])
    wanted = np.trapezoid(np.square(tau).sum(axis=1), times)
    assert objective.value(motion, {"energy": 1.0}, PANDA) == pytest.approx(wanted, rel=1e-4)


def test_wishes_cost_half_the_weighed_square_of_what_they_are_violated_by() -> None:
    """A joint that is to stay at most 0.1 above HOME, on a line that leads 0.3 past it."""
    line = np.zeros((1, 7, 2))
    line[0, :, 0], line[0, 0, 1] = HOME, 0.4
    motion = Trajectory(NAMES, np.array([0.0, 1.0]), line)
    wish = JointConstraint(NAMES[0], float(HOME[0]), 0.1, 0.5, weight=6.0)
    held = JointConstraint(NAMES[1], float(HOME[1]), 0.1, 0.1, weight=6.0)
    fine = np.linspace(0.0, 1.0, 100_001)
    wanted = 3.0 * np.trapezoid(np.maximum(0.4 * fine - 0.1, 0.0) ** 2, fine)
    paid = objective.value(motion, {}, PANDA, ConstraintSet(PANDA, (wish,)))
    # A sum over four nodes, of a function with a corner.
    assert paid == pytest.approx(wanted, rel=0.02)
    assert objective.value(motion, {}, PANDA, ConstraintSet(PANDA, (held,))) == 0.0
    both = ConstraintSet(PANDA, (wish, held))
    plain = objective.value(motion, {"time": 1.0}, PANDA)
    assert objective.value(motion, {"time": 1.0}, PANDA, both) == pytest.approx(plain + paid)


def test_the_model_of_the_length_touches_it_and_is_nowhere_below_it() -> None:
    """|x| <= (|x|^2 / |x'| + |x'|) / 2: a step down the model is a step down the length."""
    at, rng = iterate(4), np.random.default_rng(4)
    model = objective.model(task(), {"path_length": 1.0}, at)

    def length(z: np.ndarray) -> float:
        motion = unpacked(z).trajectory(NAMES)
        return objective.value(motion, {"path_length": 1.0}, PANDA)

    z = packed(at)
    offset = length(z) - 0.5 * z @ (model.H @ z) - model.g @ z
    for size in (1e-3, 0.1, 1.0):
        for _ in range(10):
            step = np.append(size * rng.normal(size=len(z) - 2), [0.0, 0.0])
            other = z + step
            promised = 0.5 * other @ (model.H @ other) + model.g @ other + offset
            # The length by eight nodes a piece, its model by four.
            assert length(other) <= promised * (1.0 + 2e-3)


def test_the_carrier_decides_the_energy_of_the_model() -> None:
    """Value and model are those of the robot with what it carries."""
    at, heavy = iterate(7), with_payload(PANDA, 10.0)
    motion = at.trajectory(NAMES)
    values = [objective.value(motion, {"energy": 1.0}, chain) for chain in (PANDA, heavy)]
    assert values[1] > 1.5 * values[0]
    for chain, value in zip((PANDA, heavy), values, strict=True):
        model = objective.model(replace(task(), loaded_chain=chain), {"energy": 1.0}, at)
        slope = (model.H @ packed(at) + model.g)[-2]
        ahead, behind = (
            objective.value(
                replace(at, duration=at.duration + step).trajectory(NAMES), {"energy": 1.0}, chain
            )
            for step in (1e-5, -1e-5)
        )
        assert slope == pytest.approx((ahead - behind) / 2e-5, abs=1e-4 * value)
