"""Optimised motions that hold constraints on the whole way."""

from dataclasses import replace

import numpy as np

from kinematics.trajectory.trajectory import Trajectory
from obstacles.collision.checker import Checker
from obstacles.scenes.scene import Scene
from planning.constrained.checker import ConstrainedChecker
from planning.constrained.ik import IkOptions, constrained_ik
from planning.constraints.constraint_set import ConstraintSet
from planning.constraints.kinds.constraint import (
    ConeConstraint,
    LineRegion,
    PositionConstraint,
    SphereRegion,
)
from planning.optimize import objective
from planning.optimize.iterate import Iterate, fit_spline
from planning.optimize.scp import Descent
from planning.optimize.spline import SplineSpace
from planning.optimize.task import End, Task
from planning.options import Options
from planning.problem import JointGoal, Problem
from planning.proof.certificate import certify
from planning.values.deadline import Deadline
from planning.values.limits import MotionLimits
from planning.values.optimize_options import Objective, RefineOptions
from tests.planning.pinocchio_arm import PinocchioArm
from tests.planning.scenes import HOME, builtin, planned_motion

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
