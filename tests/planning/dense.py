"""A dense, sampled look at trajectories, apart from the certificate."""

import numpy as np

from kinematics.trajectory import Trajectory
from obstacles.checker import Checker
from obstacles.robot_geometry import RobotGeometry
from obstacles.scene import Scene


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
    """Largest share of any limit, from the roots of numpy's polynomials."""
    limits = robot.chain.limits
    worst = 0.0
    for piece in range(trajectory.pieces):
        length = trajectory.breaks[piece + 1] - trajectory.breaks[piece]
        for joint in range(trajectory.n):
            polynomial = np.polynomial.Polynomial(trajectory.coefficients[piece, joint])
            bounds = (float(limits.velocity[joint]), float(limits.acceleration[joint]))
            for order, bound in enumerate(bounds, start=1):
                derivative = polynomial.deriv(order)
                roots = derivative.deriv().roots() if derivative.degree() > 1 else np.zeros(0)
                times = [float(np.real(r)) for r in roots if abs(float(np.imag(r))) < 1e-9]
                inside = [t for t in times if 0.0 < t < length]
                values = [abs(float(derivative(t))) for t in (0.0, float(length), *inside)]
                worst = max(worst, max(values) / bound)
    return worst
