"""Paths of fewer waypoints within a tolerance, certified in a scene."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from kinematics.arrays import Array, Indices, numbers, typed
from kinematics.errors import InvalidOption, InvalidTrajectory
from kinematics.trajectory.trajectory import Trajectory
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.scenes.scene import Scene
from planning.proof.certificate import Certificate, certify
from planning.timing.path.blend import checked_waypoints
from planning.timing.path.simplification import fewest_waypoints
from planning.timing.spline.spline import smooth_motion
from planning.values.deadline import Deadline
from planning.values.limits import MotionLimits


@dataclass(frozen=True, slots=True, eq=False)
class SimplifiedPath:
    """Waypoints that stand for a path.

    Args:
        waypoints: Shape (k', n) [rad or m].
        numbers: Numbers of the waypoints given that they are, shape (k',).
        deviation: Largest distance of the straight lines through them from those through all
            waypoints, in any joint, at every place: both are run through in the same order, and
            a place of one is as near to its counterpart on the other [rad or m].
        certificate: Proof of the straight lines against limits of position and collisions, leg i
            run through from rest to rest from the time i - 1 to i; None without a robot.
        notes: Notes on the path.
    """

    waypoints: Array
    numbers: Indices
    deviation: float
    certificate: Certificate | None = None
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class FittedMotion:
    """A motion of cubics that stands for a recorded one.

    Args:
        trajectory: The motion.
        deviation: Bound of the distance of any joint from the record at every instant [rad or m].
        certificate: Proof against the robot's limits and itself; None without a robot.
    """

    trajectory: Trajectory
    deviation: float
    certificate: Certificate | None = None


@typed
def fit_motion(
    times: ArrayLike,
    positions: ArrayLike,
    tolerance: float,
    robot: RobotGeometry | None = None,
    *,
    joint_names: Sequence[str] | None = None,
    rest: bool = False,
    deadline: Deadline | None = None,
) -> FittedMotion:
    """Fit few cubics with continuous accelerations to a recorded motion.

    Args:
        times: Instants of the samples, shape (k,) [s].
        positions: Samples, shape (k, n), k >= 4 [rad or m].
        tolerance: Largest distance of any joint from the record at every instant [rad or m].
        robot: The robot, its joints in their order.
        joint_names: Names of the joints where there is no robot.
        rest: Whether the motion begins and ends without velocity.
        deadline: Instant at which the proof is given up.

    Raises:
        InvalidOption: The tolerance is not positive, or no motion is within it.
        InvalidTrajectory: Samples are malformed.
    """
    if not 0.0 < tolerance < np.inf:
        raise InvalidOption(f"the tolerance is {tolerance}", hint="Give a positive number.")
    points = numbers(positions, "positions")
    if points.ndim != 2:
        raise InvalidTrajectory(f"positions have the shape {points.shape}, not (k, n)")
    n = points.shape[1]
    names = tuple(joint_names or (f"joint{i + 1}" for i in range(n)))
    if robot is not None:
        if joint_names is not None and names != robot.chain.joint_names:
            raise InvalidTrajectory(
                "the names of the joints are not those of the robot in its order",
                hint=f"They are: {', '.join(robot.chain.joint_names)}.",
            )
        names = robot.chain.joint_names
    if len(names) != n:
        raise InvalidTrajectory(f"samples have {n} value(s) for {len(names)} joint(s)")
    motion, deviation = smooth_motion(names, times, points, tolerance, rest)
    if deviation > tolerance:
        raise InvalidOption(
            f"no motion of cubics was found within {tolerance:.3g} of the samples; the nearest is "
            f"{deviation:.3g} off",
            hint="Give a tolerance above the noise of the record, or more samples.",
        )
    if robot is None:
        return FittedMotion(motion, deviation)
    return FittedMotion(motion, deviation, certify(motion, robot, Scene(), deadline=deadline))


@typed
def simplify(
    waypoints: ArrayLike,
    tolerance: float,
    robot: RobotGeometry | None = None,
    scene: Scene | None = None,
    *,
    margin: float = 0.0,
    deadline: Deadline | None = None,
) -> SimplifiedPath:
    """Simplify a path to the fewest waypoints whose straight lines follow it within a tolerance.

    Up to 500 waypoints the number is the least there is among those given, in longer paths about
    that. With a robot the lines are proved; where those are not free, nearer ones are tried, and at
    last those through all waypoints.

    Args:
        waypoints: Shape (k, n), k >= 1 [rad or m].
        tolerance: Largest distance of any joint from the path, at every place [rad or m].
        robot: The robot, its joints in their order.
        scene: The obstacles; none where left out.
        margin: Distance to keep from obstacles beyond their own margins [m].
        deadline: Instant at which the proof is given up.

    Raises:
        InvalidOption: The tolerance is negative or no number, or a scene has no robot.
        InvalidTrajectory: The waypoints are malformed.
    """
    if not 0.0 <= tolerance < np.inf:
        raise InvalidOption(
            f"the tolerance is {tolerance}", hint="Give a number that is 0 or positive [rad or m]."
        )
    points = checked_waypoints(waypoints)
    if robot is None:
        if scene is not None:
            raise InvalidOption("a scene needs a robot", hint="Name one, or leave the scene out.")
        return _simplified(points, tolerance)
    if points.shape[1] != robot.chain.n:
        raise InvalidTrajectory(
            f"waypoints have {points.shape[1]} value(s) for {robot.chain.n} joint(s)",
            hint=f"The joints are: {', '.join(robot.chain.joint_names)}; give one value for each.",
        )
    # A violation mostly goes with the deviation: a few tries, then the path as it is.
    for within in (tolerance, tolerance / 4.0, tolerance / 16.0, 0.0):
        found = _simplified(points, within)
        motion = _stopping(robot.chain.joint_names, found.waypoints)
        free = {name: np.full(motion.n, np.inf) for name in ("velocity", "acceleration", "jerk")}
        certificate = certify(
            motion,
            robot,
            scene or Scene(),
            margin=margin,
            limits=MotionLimits(free),
            deadline=deadline,
        )
        if certificate.verified or (deadline is not None and deadline.passed):
            break
    notes: tuple[str, ...] = ()
    if within < tolerance and certificate.verified:
        told = f"Within {tolerance:g} of the path no straight lines were proved free: these are "
        notes = (f"{told}within {within:g}.",)
    return replace(found, certificate=certificate, notes=notes)


def _simplified(points: Array, tolerance: float) -> SimplifiedPath:
    """The fewest waypoints, of which nothing is proved."""
    numbers, deviation = fewest_waypoints(points, tolerance)
    return SimplifiedPath(points[numbers], numbers, deviation)


def _stopping(names: Sequence[str], points: Array) -> Trajectory:
    """Straight lines through waypoints with a rest at each, one in each unit of time."""
    if len(points) < 2:
        points = np.repeat(points, 2, axis=0)
    steps = np.diff(points, axis=0)
    legs = np.stack([points[:-1], 0.0 * steps, 3.0 * steps, -2.0 * steps], axis=-1)
    return Trajectory(tuple(names), np.arange(float(len(points))), legs)
