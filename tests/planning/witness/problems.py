"""Seeded motions with certificates, and the checker of their witnesses, loaded from its one file.

The checker is not on the path: it has to work alone.
"""

import importlib.util
import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import trimesh

from kinematics.pose import transform
from kinematics.trajectory.trajectory import Trajectory
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.scenes.scene import Obstacle, Scene
from obstacles.shapes.shape import Cone, HalfSpace, Sphere
from planning.options import Options
from planning.pipeline.pipeline import plan
from planning.problem import JointGoal, Problem
from planning.proof.certificate import certify
from planning.result import Plan
from planning.witness.compact import MAGIC, packed
from planning.witness.witness import witness
from tests.obstacles.arms import mesh_shape
from tests.planning.proof.test_certificate import (
    cart,
    hollows,
    motion_from,
)
from tests.planning.scenes import builtin, pillar, shelf
from tests.planning.stops.motions import arm

ROOT = Path(__file__).parents[3]
CHECKER = ROOT / "checkers/python/armwright_checker.py"


class Proved(NamedTuple):
    """A motion that was certified, and its witness."""

    trajectory: Trajectory
    robot: RobotGeometry
    scene: Scene
    document: dict[str, Any]


@cache
def checker() -> Any:
    """The checker's module."""
    spec = importlib.util.spec_from_file_location("armwright_checker", CHECKER)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


@cache
def reports(made: Callable[..., tuple[Proved, ...]], *arguments: Any) -> tuple[Any, ...]:
    """What the checker says of each motion that a function of this module gives."""
    return tuple(checker().check(item.document) for item in made(*arguments))


def rejected(document: dict[str, Any]) -> str | None:
    """Why the checker rejects a witness; None where it accepts it."""
    try:
        checker().check(document)
    except checker().Rejected as error:
        return str(error)
    return None


def compact(document: Any) -> bytes:
    """The compact form of a document."""
    return MAGIC + packed(document)


def crowd() -> Scene:
    """A floor, a cone and a ball with a margin beside a pillar."""
    T = np.eye(4)
    T[:3, 3] = -0.5, 0.4, 0.2
    ball = np.eye(4)
    ball[:3, 3] = 0.2, -0.7, 0.9
    return Scene(
        (
            *pillar(0.4, 0.65).obstacles,
            Obstacle("cone", Cone(0.1, 0.4), T),
            Obstacle("ball", Sphere(0.08), ball, 0.01),
            Obstacle("floor", HalfSpace(np.array([0.0, 0.0, 1.0]), -0.06)),
        )
    )


SCENES = {"shelf": shelf, "crowd": crowd}


@cache
def planned(name: str, scene: str, count: int, margin: float = 0.0) -> tuple[Proved, ...]:
    """Plans between random configurations of a built-in robot."""
    robot, around = builtin(name), SCENES[scene]()
    chain, random, found = robot.chain, np.random.default_rng(41), list[Proved]()
    low, high = np.maximum(chain.limits.lower, -2.5), np.minimum(chain.limits.upper, 2.5)
    while len(found) < count:
        start, goal = random.uniform(low, high, (2, chain.n))
        answer = plan(Problem(robot, around, start, (JointGoal(goal),), margin), Options())
        if isinstance(answer, Plan):
            document = witness(answer.trajectory, robot, around, margin=margin).document
            found.append(Proved(answer.trajectory, robot, around, document))
    return tuple(found)


@cache
def meshes(count: int) -> tuple[Proved, ...]:
    """Certified motions of an arm whose links are no hulls, among rings and tubes."""
    robot, random, found = arm("meshes"), np.random.default_rng(5), list[Proved]()
    while len(found) < count:
        scene = Scene(tuple(hollows(random, 0.9)))
        motion = motion_from(robot, random.uniform(-2.1, 2.1, robot.chain.n), random)
        if certify(motion, robot, scene).verified:
            found.append(Proved(motion, robot, scene, witness(motion, robot, scene).document))
    return tuple(found)


@cache
def peg_in_tube() -> Proved:
    """A bent bar that slides in a tube of one thin sheet."""
    _, robot = cart()
    sheet = trimesh.creation.annulus(0.43, 0.4301, 1.5, sections=48)
    scene = Scene((Obstacle("tube", mesh_shape(sheet), transform(None, [0.0, 0.0, 0.2])),))
    line = np.array([[[-0.1, 0.2]]])
    motion = Trajectory(("slide",), np.array([0.0, 1.0]), line)
    return Proved(motion, robot, scene, witness(motion, robot, scene).document)
