"""A dense, sampled look at trajectories, apart from the certificate."""

import numpy as np

from benchmarks.judges import ratios
from kinematics.trajectory.trajectory import Trajectory
from obstacles.collision.checker import Checker
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.scenes.scene import Scene


def least_clearance(
    trajectory: Trajectory,
    robot: RobotGeometry,
    scene: Scene,
    margin: float = 0.0,
    samples: int = 1500,
) -> float:
    """Smallest clearance at many instants, margins taken off [m]."""
    checker = Checker.of(robot, scene, margin)
    times = np.linspace(0.0, trajectory.duration, samples)
    return min(checker.clearance(q)[0] for q in trajectory.sample(times))


def worst_ratio(trajectory: Trajectory, robot: RobotGeometry) -> float:
    """Largest share of any limit, at the roots of the polynomials that numpy finds."""
    limits = robot.chain.limits
    return max(
        ratios.worst_ratio(trajectory, bounds, order)
        for order, bounds in enumerate((limits.velocity, limits.acceleration), 1)
    )
