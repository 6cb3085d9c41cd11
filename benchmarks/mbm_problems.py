"""MotionBenchMaker problems for the Panda as values: the robot, and where it is to go in what."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import yaml

from armwright.robot import load_robot
from kinematics.arrays import Array
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.scenes.moveit import scene_from_moveit
from obstacles.scenes.scene import Obstacle, Scene
from planning.problem import JointGoal, Problem

#: The URDF gives no accelerations: those of the manufacturer's data sheet [rad/s^2].
ACCELERATION = (15.0, 7.5, 10.0, 12.5, 15.0, 20.0, 20.0)
#: Likewise [rad/s^3].
JERK = (7500.0, 3750.0, 5000.0, 6250.0, 7500.0, 10000.0, 10000.0)


@dataclass(frozen=True)
class Case:
    """One problem as its files tell it.

    Args:
        name: Kind of scene and number, "box_panda/scene0001".
        text: Of the scene.
        start: In the order of the robot's joints, shape (7,).
        goal: Likewise.
    """

    name: str
    text: str
    start: Array
    goal: Array

    @property
    def kind(self) -> str:
        """The kind of scene."""
        return self.name.split("/")[0]

    def problem(self, robot: RobotGeometry, margin: float) -> Problem:
        """The same for the planner; the scene is parsed anew each time."""
        scene = scene_at_root(self.text)
        return Problem(robot, scene, self.start, (JointGoal(self.goal),), margin=margin)


def scene_at_root(text: str) -> Scene:
    """The scene of a problem with its obstacles in the root frame of whichever arm it is put to.

    The files name the Panda's first link, which is its root; other arms stand in the same place.
    """
    read = scene_from_moveit(text)
    obstacles = (Obstacle(o.id, o.shape, o.T_world_obstacle, o.margin) for o in read.obstacles)
    return Scene(obstacles, read.allowed_collisions)


def panda(folder: Path) -> RobotGeometry:
    """The robot as it lies in the folder, with the data sheet's accelerations."""
    limits = {f"panda_joint{i}": {"acceleration": a} for i, a in enumerate(ACCELERATION, 1)}
    return load_robot(folder / "panda.urdf", srdf=folder / "panda.srdf", joint_limits=limits)


def cases(folder: Path, names: tuple[str, ...], every: int) -> Iterator[Case]:
    """Every n-th problem of every kind, its joints in the order of ``names``."""
    for kind in sorted(path for path in folder.iterdir() if path.is_dir()):
        for scene in sorted(kind.glob("scene*.yaml"))[::every]:
            yield case_of(scene, names)


def case_of(scene: Path, names: tuple[str, ...]) -> Case:
    """The problem of a scene's file and of the request's beside it."""
    request = yaml.safe_load(scene.with_name(scene.name.replace("scene", "request")).read_text())
    state = request["start_state"]["joint_state"]
    start = dict(zip(state["name"], state["position"], strict=True))
    goals = request["goal_constraints"][0]["joint_constraints"]
    goal = {entry["joint_name"]: entry["position"] for entry in goals}
    ends = (np.array([at[j] for j in names]) for at in (start, goal))
    return Case(f"{scene.parent.name}/{scene.stem}", scene.read_text(), *ends)
