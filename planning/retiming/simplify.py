"""Paths of fewer waypoints within a tolerance, certified in a scene."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from kinematics.arrays import Array, Indices, numbers, typed
from kinematics.errors import InvalidOption, InvalidTrajectory
from kinematics.model.branch import BodyTree
from kinematics.model.chain import Chain
from kinematics.trajectory.trajectory import Trajectory
from obstacles.robots.robot_geometry import RobotGeometry, link_arms
from obstacles.scenes.scene import Scene
from planning.proof.certificate import Certificate, certify
from planning.proof.path_nearness import chord_counts, times_of_parts
from planning.timing.path.blend import checked_waypoints
from planning.timing.path.simplification import fewest_waypoints
from planning.timing.spline.spline import smooth_motion
from planning.values.deadline import Deadline
from planning.values.limits import MotionLimits


@dataclass(frozen=True, slots=True)
class TipTolerance:
    """Largest distance of the tool from where a path leads it, at every place.

    Args:
        position: Of the tip's origin [m]; None for any.
        orientation: Angle of the tip [rad]; None for any.
    """

    position: float | None = None
    orientation: float | None = None

    def per_joint(self, chain: Chain) -> Array:
        """Weights of the joints' deviations whose Euclidean norm is at most 1 within it, (n,).

        A joint turns the tip by at most as much as itself, and moves it by that times its longest
        arm. The sums over m joints are at most the root of m times their Euclidean norm.

        Raises:
            InvalidOption: It is no tolerance, or a slide without stops leaves it without a bound.
        """
        tree, given = BodyTree.of(chain), (self.position, self.orientation)
        turns = tree.of_leaders(np.where(tree.slides, 0.0, 1.0))
        arms = link_arms(chain, chain.tip_link)
        if all(one is None for one in given) or not all(one is None or one > 0.0 for one in given):
            raise InvalidOption(
                f"the tool's tolerance is {self.position} m, {self.orientation} rad",
                hint="Give positive numbers, one at least.",
            )
        rows = [
            row * np.sqrt(np.count_nonzero(row)) / within
            for row, within in zip((arms, turns), given, strict=True)
            if within is not None
        ]
        if not np.isfinite(rows).all():
            raise InvalidOption(
                "a slide without stops leaves the tool's deviation without a bound",
                hint="Give a tolerance of joints.",
            )
        return np.asarray(np.max(rows, axis=0))


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
        tool_use: Bound of the tool's deviation as a part of its tolerance, position and orientation
            alike; None without one.
    """

    waypoints: Array
    numbers: Indices
    deviation: float
    certificate: Certificate | None = None
    notes: tuple[str, ...] = ()
    tool_use: float | None = None


def motion_waypoints(motion: Trajectory, tolerance: float) -> Array:
    """Few waypoints of a motion from whose straight lines it is within a tolerance, shape (k, n).

    Args:
        motion: The motion.
        tolerance: Largest distance of any joint at every instant [rad or m].

    Raises:
        InvalidOption: The tolerance is too fine for the motion.
    """
    # Shares of the tolerance; the proof, which cuts the motion anew, has use for the rest.
    parts, most = chord_counts(motion, tolerance / 64.0), 100_000
    if not parts.sum() <= most:
        least = tolerance * (parts.sum() / most) ** 2
        raise InvalidOption(
            f"path.tolerance is {tolerance:g}, too fine for a path that stands for the motion",
            hint=f"Give at least {least:.1g}, or leave path out.",
        )
    states = motion.sample(times_of_parts(motion, parts))
    return states[fewest_waypoints(states, 0.9 * tolerance)[0]]


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
    tolerance: float | None,
    robot: RobotGeometry | None = None,
    scene: Scene | None = None,
    *,
    tool_tolerance: TipTolerance | None = None,
    margin: float = 0.0,
    deadline: Deadline | None = None,
) -> SimplifiedPath:
    """Simplify a path to the fewest waypoints whose straight lines follow it within a tolerance.

    Up to 500 waypoints the number is the least there is among those given, in longer paths about
    that. With a robot the lines are proved; where those are not free, nearer ones are tried, and at
    last those through all waypoints.

    Args:
        waypoints: Shape (k, n), k >= 1 [rad or m].
        tolerance: Largest distance of any joint from the path, at every place [rad or m]; None
            where the tool's alone counts.
        robot: The robot, its joints in their order.
        scene: The obstacles; none where left out.
        tool_tolerance: Largest distance of the tool from the path, at every place, with a robot.
        margin: Distance to keep from obstacles beyond their own margins [m].
        deadline: Instant at which the proof is given up.

    Raises:
        InvalidOption: A tolerance is none, or a scene or the tool has no robot.
        InvalidTrajectory: The waypoints are malformed.
    """
    given = tolerance is None and tool_tolerance is not None
    if not (given or (tolerance is not None and 0.0 <= tolerance < np.inf)):
        raise InvalidOption(
            f"the tolerance is {tolerance}", hint="Give a number that is 0 or positive [rad or m]."
        )
    points = checked_waypoints(waypoints)
    if robot is None:
        if scene is not None or tool_tolerance is not None:
            raise InvalidOption(
                "a scene needs a robot, and so does a tolerance of the tool",
                hint="Name one, or leave them out.",
            )
        return _simplified(points, tolerance, None, 1.0)
    if points.shape[1] != robot.chain.n:
        raise InvalidTrajectory(
            f"waypoints have {points.shape[1]} value(s) for {robot.chain.n} joint(s)",
            hint=f"The joints are: {', '.join(robot.chain.joint_names)}; give one value for each.",
        )
    # A violation mostly goes with the deviation: a few tries, then the path as it is.
    weights = None if tool_tolerance is None else tool_tolerance.per_joint(robot.chain)
    for share in (1.0, 1.0 / 4.0, 1.0 / 16.0, 0.0):
        found = _simplified(points, tolerance, weights, share)
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
    if share < 1.0 and certificate.verified and tolerance != 0.0:
        told = "Within the tolerance of the path no straight lines were proved free: these are "
        notes = (f"{told}within {share:g} of it.",)
    return replace(found, certificate=certificate, notes=notes)


def _simplified(
    points: Array, tolerance: float | None, weights: Array | None, share: float
) -> SimplifiedPath:
    """The fewest waypoints within a share of the tolerances, of which nothing is proved.

    Args:
        points: Shape (k, n).
        tolerance: That of each joint; None for none.
        weights: Those of ``TipTolerance.per_joint``, shape (n,); None for none.
        share: Share of the tolerances.
    """
    if weights is None:
        assert tolerance is not None
        numbers, deviation = fewest_waypoints(points, share * tolerance)
        return SimplifiedPath(points[numbers], numbers, deviation)
    within = share
    if tolerance is not None:
        # A path that is to keep to its waypoints has no room for the tool either.
        within = share if tolerance > 0.0 else 0.0
        weights = np.maximum(weights, 1.0 / tolerance) if tolerance > 0.0 else weights
    moving = np.ptp(points, axis=0) > 0.0
    if (weights[moving] == 0.0).any():
        raise InvalidOption(
            "a joint moves that the tool's tolerance leaves free",
            hint="Give its position and its orientation, or a tolerance of joints as well.",
        )
    numbers, use = fewest_waypoints(points * weights, within, 2.0)
    deviation = use / float(weights[moving].min(initial=np.inf))
    return SimplifiedPath(points[numbers], numbers, deviation, tool_use=use)


def _stopping(names: Sequence[str], points: Array) -> Trajectory:
    """Straight lines through waypoints with a rest at each, one in each unit of time."""
    if len(points) < 2:
        points = np.repeat(points, 2, axis=0)
    steps = np.diff(points, axis=0)
    legs = np.stack([points[:-1], 0.0 * steps, 3.0 * steps, -2.0 * steps], axis=-1)
    return Trajectory(tuple(names), np.arange(float(len(points))), legs)
