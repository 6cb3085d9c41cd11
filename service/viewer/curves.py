"""Curves of a motion over time that a page can't compute itself: torque, tool speed, clearance."""

import math
import time
from collections.abc import Sequence
from typing import Any

import numpy as np

from dynamics.inverse import inverse_dynamics
from kinematics.arrays import Array
from kinematics.errors import MissingInertia
from kinematics.model.chain import Chain
from kinematics.trajectory.trajectory import Trajectory
from kinematics.velocity import link_twist
from obstacles.collision.fcl_distance import FclWorld
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.scenes.scene import Scene

#: Instants at which torque and tool speed are drawn.
_SAMPLES = 301
#: Most and fewest instants at which clearance is measured, and the time that this may take [s].
_CLEARANCES, _FEWEST = 151, 21
_CLEARANCE_TIME = 3.0
#: Digits of drawn values: a ten-thousandth of a width of any curve.
_DIGITS = 6


def torque_curve(
    chain: Chain, motion: Trajectory, *, samples: int = _SAMPLES
) -> dict[str, Any] | None:
    """Joint torques over time; None for a robot without inertias.

    Args:
        chain: The robot with the masses that it holds.
        motion: The motion.
        samples: Number of instants.
    """
    times = np.linspace(0.0, motion.duration, samples)
    states = (motion.sample(times, derivative) for derivative in range(3))
    try:
        torques = inverse_dynamics(chain, *states)
    except MissingInertia:
        return None
    return {"times": times.tolist(), "values": _rounded(torques)}


def tool_speed_curve(
    chain: Chain, motion: Trajectory, *, samples: int = _SAMPLES
) -> dict[str, Any]:
    """Speed of the tip over time [m/s].

    Args:
        chain: The robot.
        motion: The motion.
        samples: Number of instants.
    """
    times = np.linspace(0.0, motion.duration, samples)
    twists = link_twist(chain, motion.sample(times), motion.sample(times, 1))
    return {"times": times.tolist(), "values": _rounded(np.linalg.norm(twists[:, :3], axis=1))}


def clearance_curve(
    robot: RobotGeometry,
    scene: Scene,
    motion: Trajectory,
    *,
    budget: float = _CLEARANCE_TIME,
    counts: tuple[int, int] = (_FEWEST, _CLEARANCES),
) -> dict[str, Any]:
    """Distance of the closest pair over time, with the nearest points where they are known.

    Measured by FCL at instants, margins taken off: as many as its time allows. The certificate
    holds between them too.

    Args:
        robot: The robot with what it holds.
        scene: The obstacles.
        motion: The motion.
        budget: Time that this may take, but for the fewest instants [s].
        counts: Fewest and most instants.
    """
    world = FclWorld(robot, scene)
    began = time.perf_counter()
    for q in motion.sample(np.linspace(0.0, motion.duration, 3)):
        world.nearest_points(q)
    each = (time.perf_counter() - began) / 3.0
    count = int(np.clip(budget / max(each, 1e-6), *counts))
    return _clearances(world, motion, np.linspace(0.0, motion.duration, count))


def clearance_at(
    robot: RobotGeometry, scene: Scene, motion: Trajectory, times: Array
) -> dict[str, Any]:
    """Distance of the closest pair at some instants of a motion.

    Args:
        robot: The robot with what it holds.
        scene: The obstacles.
        motion: The motion.
        times: The instants, shape (k,) [s].
    """
    return _clearances(FclWorld(robot, scene), motion, times)


def nearest(
    robot: RobotGeometry, scene: Scene, configurations: Sequence[Sequence[float]]
) -> list[dict[str, Any] | None]:
    """Distance, pair and, where they are known, points of the closest bodies in configurations.

    Those that collide have a negative distance, by how deep. None where a configuration is of
    another number of joints.

    Args:
        robot: The robot with what it holds.
        scene: The obstacles.
        configurations: Rows of n values [rad or m].
    """
    world, n = FclWorld(robot, scene), robot.chain.n
    found: list[dict[str, Any] | None] = []
    for q in configurations:
        if len(q) != n:
            found.append(None)
            continue
        row = world.nearest_points(q)
        points = None if row.points is None else _rounded(row.points)
        found.append({"distance": _finite(row.distance), "pair": row.pair, "points": points})
    return found


def _clearances(world: FclWorld, motion: Trajectory, times: Array) -> dict[str, Any]:
    rows = [world.nearest_points(q) for q in motion.sample(times)]
    return {
        "times": times.tolist(),
        "values": [_finite(row.distance) for row in rows],
        "pairs": [row.pair for row in rows],
        "points": [None if row.points is None else _rounded(row.points) for row in rows],
    }


def _rounded(values: Array) -> Any:
    return np.round(values, _DIGITS).tolist()


def _finite(value: float) -> float | None:
    return round(value, _DIGITS) if math.isfinite(value) else None
