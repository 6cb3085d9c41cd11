"""Arms with scenes and straight motions between free configurations of theirs."""

from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

from kinematics.arrays import Array
from kinematics.pose import transform
from kinematics.robots import builtin_urdf
from kinematics.trajectory.trajectory import Trajectory
from kinematics.tree.serial_chain import serial_chain
from kinematics.urdf.urdf import parse_urdf
from obstacles.robots.robot_geometry import RobotGeometry, robot_geometry
from obstacles.scenes.scene import Obstacle, Scene
from obstacles.shapes.shape import Box, Sphere
from planning.proof.certificate import Certificate, certify
from planning.stops.certificate import Surroundings
from planning.values.limits import MotionLimits
from tests.mimic_joints import mimic_positions, mimic_robot, urdf
from tests.planning.proof.test_certificate import FILES, arm_text, own_bytes
from tests.planning.scenes import builtin
from tests.planning.stops.judge import CoalArm

ARMS = ("panda", "ur5e", "kr6_sixx", "stanford", "mimic joints", "meshes")


class Moved(NamedTuple):
    """A proved motion of an arm.

    Args:
        trajectory: The motion.
        certificate: Its proof.
        around: Robot, scene and limits.
    """

    trajectory: Trajectory
    certificate: Certificate
    around: Surroundings


@cache
def arm(name: str) -> RobotGeometry:
    """An arm by its name."""
    if name == "mimic joints":
        return mimic_robot()
    if name == "meshes":
        description = parse_urdf(arm_text())
        return robot_geometry(serial_chain(description, tip_link="hand"), description, own_bytes)
    return builtin(name)


def judge(name: str, scene: Scene, folder: Path) -> CoalArm:
    """The judge of an arm; meshes are written to a folder."""
    if name == "mimic joints":
        return CoalArm(urdf(), arm(name), scene, mimic_positions)
    if name != "meshes":
        return CoalArm(builtin_urdf(name), arm(name), scene)
    text = arm_text()
    for file, mesh in FILES.items():
        (folder / file).write_bytes(bytes(mesh.export(file_type="stl")))
        text = text.replace(f'"{file}"', f'"{folder / file}"')
    return CoalArm(text, arm(name), scene)


def scene(seed: int, reach: float) -> Scene:
    """Boxes and balls on a ring about the arm."""
    random = np.random.default_rng(seed)
    found = []
    for k in range(9):
        angle, away = random.uniform(-3.1, 3.1), random.uniform(0.5, 1.0) * reach
        place = away * np.cos(angle), away * np.sin(angle), random.uniform(0.1, 1.2) * reach
        solid = Box(random.uniform(0.1, 0.3, 3) * reach) if k % 3 else Sphere(0.12 * reach)
        found.append(Obstacle(f"solid {k}", solid, transform(None, place)))
    return Scene(tuple(found))


def motions(
    name: str, count: int, brake: float, *, jerk: bool = True, weak: float = 1.0, first: int = 0
) -> Iterator[Moved]:
    """Proved motions of an arm, each in a scene of its own.

    Args:
        name: The arm.
        count: How many.
        brake: Largest acceleration of every joint [rad/s^2 or m/s^2].
        jerk: Whether jerk is limited, to forty times that a second.
        weak: Share of the acceleration of the motions that stops brake with.
        first: Number of the first scene, less one.
    """
    robot, random = arm(name), np.random.default_rng(7 + first)
    n, (low, high) = robot.chain.n, robot.chain.sampling_bounds()
    bounds = {"velocity": np.full(n, 50.0), "acceleration": np.full(n, brake)}
    bounds["jerk"] = np.full(n, 40.0 * brake if jerk else np.inf)
    limits, found, seed = MotionLimits(bounds), 0, first
    brakes = MotionLimits(bounds | {"acceleration": np.full(n, weak * brake)})
    while found < count:
        seed += 1
        around = Surroundings(robot, scene(seed, 0.9), 0.0, brakes)
        for a, b in random.uniform(low, high, (12, 2, n)):
            trajectory = rest_to_rest(robot.chain.joint_names, a, a + 0.6 * (b - a), brake)
            proof = certify(trajectory, robot, around.scene, limits=limits)
            if proof.verified:
                found += 1
                yield Moved(trajectory, proof, around)
                break


def rest_to_rest(names: tuple[str, ...], a: Array, b: Array, brake: float) -> Trajectory:
    """A straight motion by the polynomial of degree five, its peak acceleration nearly a limit."""
    # The largest of s'' is 10 / sqrt(3), that of s''' is 60.
    peak = np.abs(b - a).max()
    duration = max((10.0 / np.sqrt(3.0) * peak / (0.98 * brake)) ** 0.5,
                   (60.0 * peak / (39.0 * brake)) ** (1.0 / 3.0))  # fmt: skip
    shape = np.array([0.0, 0.0, 0.0, 10.0, -15.0, 6.0]) / duration ** np.arange(6)
    c = np.outer(b - a, shape)
    c[:, 0] = a
    return Trajectory(names, np.array([0.0, duration]), c[None])
