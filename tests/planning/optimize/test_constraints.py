"""Optimised motions that hold constraints on the whole way."""

import numpy as np
import pinocchio

from kinematics.robots import builtin_urdf
from kinematics.trajectory import Trajectory
from obstacles.checker import Checker
from obstacles.scene import Scene
from planning.certificate import certify
from planning.constrained_checker import ConstrainedChecker
from planning.constrained_ik import IkOptions, constrained_ik
from planning.constraints.constraint_set import ConstraintSet
from planning.constraints.orientation import ConeConstraint
from planning.constraints.position import PositionConstraint
from planning.constraints.region import SphereRegion
from planning.deadline import Deadline
from planning.optimize.descent import Descent
from planning.optimize.options import RefineOptions
from planning.optimize.spline import SplineSpace
from planning.optimize.task import End, Task
from planning.optimize.warm import fitted
from tests.planning.scenes import HOME, builtin

ROBOT = builtin("panda")
CHAIN = ROBOT.chain
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
    near = fitted(task, SplineSpace.uniform(3, 16), known)
    descent = Descent(task, RefineOptions(rounds=40), near, np.inf, Deadline.after(60.0))
    descent.run(Deadline.after(300.0))
    assert descent.best is not None, descent.hindrance
    motion = descent.best.trajectory
    proof = certify(motion, ROBOT, Scene(), limits=bounds, constraints=held)
    assert proof.verified, proof.violation
    model = pinocchio.buildModelFromXML(builtin_urdf("panda"))
    data, frame = model.createData(), model.getFrameId(CHAIN.tip_link)
    for q in motion.sample(np.linspace(0.0, motion.duration, 1000)):
        pinocchio.framesForwardKinematics(model, data, np.concatenate([q, np.zeros(model.nq - 7)]))
        down = -data.oMf[frame].rotation[2, 2]
        assert np.arccos(np.clip(down, -1.0, 1.0)) <= 0.03 + 1e-6
