"""Motions: checked, planned, proved and timed."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import cast

import numpy as np
from numpy.typing import ArrayLike

from armwright.model import chain_of
from kinematics.arrays import frozen, numbers, typed
from kinematics.errors import InvalidGoal, InvalidOption
from kinematics.model.chain import Chain
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.scenes.placement import place
from obstacles.scenes.scene import Scene
from planning.configuration_check import ConfigurationReport, configuration_checker
from planning.constraints.constraint_set import ConstraintSet
from planning.constraints.kinds.constraint import Constraint
from planning.options import Options
from planning.pipeline import pipeline
from planning.problem import Goal, JointGoal, PoseGoal, Problem
from planning.result import Failure, Plan
from planning.retiming import retime as timing
from planning.retiming.limits_at import Stretch
from planning.retiming.retimed import PathToTime, Retimed
from planning.retiming.state_motion import time_states
from planning.stops.certificate import Stop, StopCertificate, Surroundings, stop_motion
from planning.stops.certificate import certify_stops as prove_stops
from planning.timing.jerk.state_to_state import JointState, Synchronization
from planning.timing.options import TimingOptions
from planning.tool_motions.tool_tolerance import SeamOptions
from planning.values.preferences import StopKind, StopKinds


@typed
def plan(
    robot: RobotGeometry,
    scene: Scene,
    start: ArrayLike,
    goal: ArrayLike | Goal | Sequence[Goal],
    options: Options | None = None,
    *,
    margin: float = 0.0,
    constraints: Sequence[Constraint] = (),
) -> Plan | Failure:
    """Plan a motion and prove it: a plan whose certificate holds, or a failure that says why.

    Args:
        robot: The robot with its geometry.
        scene: The obstacles.
        start: Configuration to begin at, shape (n,) [rad or m].
        goal: Configuration to end at, shape (n,); pose of the tip, shape (4, 4); a ``JointGoal``
            or ``PoseGoal``; or several of these, any one of which is to be reached.
        options: Planner, timing, timeout and seed.
        margin: Distance to keep from obstacles beyond their own margins [m].
        constraints: Constraints that hold at every instant.

    Raises:
        InvalidGoal: The goal is neither a configuration nor a pose.
        InvalidRobotState: A joint vector has the wrong length or is not finite.
        InvalidOption: There is no such planner or option.
        MissingLimit: A velocity or acceleration limit is not known.
    """
    problem = Problem(
        robot,
        scene,
        np.asarray(start, dtype=np.float64),
        _goals(goal),
        margin,
        constraints=ConstraintSet(robot.chain, tuple(constraints)) if constraints else None,
    )
    return pipeline.plan(problem, Options() if options is None else options)


@typed
def plan_seam(
    robot: RobotGeometry,
    scene: Scene,
    start: ArrayLike,
    seam: SeamOptions,
    options: Options | None = None,
    *,
    margin: float = 0.0,
) -> Plan | Failure:
    """Lead the tool along a seam within its tolerances, and prove it.

    Args:
        robot: The robot with its geometry; its tip is the tool.
        scene: The obstacles.
        start: Configuration to begin at, shape (n,) [rad or m]; a free motion leads to the seam.
        seam: Waypoints, tolerance, speed, approach and retreat.
        options: Timing, timeout and seed; deviations and blend in ``cartesian``.
        margin: Distance to keep from obstacles beyond their own margins [m].

    Returns:
        The plan, with ``tool_box`` and ``tool_speed`` in its certificate; or the failure, with the
        waypoint, the reason and what would help in its details.

    Raises:
        InvalidGoal: Two waypoints are at one place, or an arc names no circle.
        InvalidRobotState: ``start`` has the wrong length or is not finite.
        InvalidOption: An option does not go with a seam.
        MissingLimit: A velocity or acceleration limit is not known.
    """
    given = Options() if options is None else options
    how = replace(given, planner="cartesian", cartesian=replace(given.cartesian, seam=seam))
    end = PoseGoal(seam.waypoints[-1].T_base_tip)
    return plan(robot, scene, start, end, how, margin=margin)


@typed
def certify_stops(plan: Plan, kind: StopKinds = "both") -> StopCertificate:
    """Prove that a plan can be stopped at every instant, or say where it can't.

    Args:
        plan: The plan, as ``plan`` or ``plan_seam`` answers it.
        kind: "path", "joints" or "both".

    Raises:
        InvalidOption: There are no such stops, or nothing is known of the robot's collisions.
        MissingLimit: The acceleration of a joint has no limit.
    """
    return prove_stops(plan.trajectory, plan.certificate, _surroundings(plan), kind)


@typed
def stop(plan: Plan, at: float, kind: StopKind = "path") -> Stop:
    """The stop of a plan from an instant on, with its certificate, which may find a collision.

    Args:
        plan: The plan, as ``plan`` or ``plan_seam`` answers it.
        at: Instant of its motion at which braking begins [s].
        kind: "path" to rest along its own path, "joints" for every joint braking by itself.

    Raises:
        InvalidOption: The instant is outside the motion, there is no such kind, or the motion has
            no stop along its path since it ends without rest.
        MissingLimit: The acceleration of a joint has no limit.
    """
    return stop_motion(plan.trajectory, _surroundings(plan), at, kind)


def _surroundings(plan: Plan) -> Surroundings:
    if plan.surroundings is None:
        raise InvalidOption(
            "this plan does not know its robot and scene", hint="Give a plan that aw.plan answers."
        )
    return plan.surroundings


def _goals(goal: ArrayLike | Goal | Sequence[Goal]) -> tuple[Goal, ...]:
    if isinstance(goal, JointGoal | PoseGoal):
        return (goal,)
    if isinstance(goal, Sequence) and any(isinstance(one, JointGoal | PoseGoal) for one in goal):
        return tuple(found for one in goal for found in _goals(one))
    values = numbers(cast(ArrayLike, goal), "goal")
    if values.shape == (4, 4):
        return (PoseGoal(values),)
    if values.ndim == 1:
        return (JointGoal(values),)
    raise InvalidGoal(
        f"a goal of shape {values.shape} is neither a configuration (n,) nor a pose (4, 4)",
        hint="Several goals are given as a list of JointGoal and PoseGoal.",
    )


@typed
def retime(
    waypoints: ArrayLike,
    robot: RobotGeometry | Chain | None = None,
    *,
    timing_options: TimingOptions | None = None,
    limits: Mapping[str, ArrayLike] | None = None,
    stops: StopKinds = "none",
    tolerance: float | None = None,
    limits_at: Sequence[Stretch] = (),
) -> Retimed:
    """Time a path of joint waypoints within limits; nothing is proved of collisions.

    Args:
        waypoints: Shape (k, n) [rad or m].
        robot: The robot, whose limits hold; without one ``limits`` are needed.
        timing_options: Method and scaling.
        limits: Limits by quantity ("velocity", "acceleration", "jerk"), each shape (n,), in place
            of the robot's.
        stops: "path" to bound the longest stop along the path too.
        tolerance: How far any joint may be from the straight lines through the waypoints, at every
            place [rad or m]: few of them, or a smooth curve, stand for all.
        limits_at: Limits along stretches of the path, beside the others.

    Raises:
        MissingLimit: A limit that is needed is not known.
        InvalidTrajectory: The waypoints are malformed.
        TimingFailed: No motion along the path was found.
    """
    points = np.asarray(waypoints, dtype=np.float64)
    if points.ndim != 2:
        raise InvalidOption(f"waypoints have the shape {points.shape}, not (k, n)")
    chain = None if robot is None else chain_of(robot)
    names = _names(points.shape[1]) if chain is None else chain.joint_names
    given = {name: frozen(value) for name, value in (limits or {}).items()}
    path = PathToTime(names, points, None, tolerance, tuple(limits_at))
    timed = timing.retime(path, timing_options or TimingOptions(), given, chain)
    return timing.with_path_stops(timed, stops, chain, given)


@typed
def retime_states(
    start: JointState,
    end: JointState,
    robot: RobotGeometry | Chain | None = None,
    *,
    limits: Mapping[str, ArrayLike] | None = None,
    synchronization: Synchronization = "phase",
) -> Retimed:
    """Time the motion between two states with bounded jerk, in the least time.

    Args:
        start: State at the beginning, n joints.
        end: State at the end.
        robot: The robot, whose limits hold; without one ``limits`` are needed.
        limits: Limits by quantity ("velocity", "acceleration", "jerk"), each shape (n,), in place
            of the robot's.
        synchronization: "phase" for a straight line where the states allow one, or "time".

    Raises:
        MissingLimit: A limit that is needed is not known.
        InvalidTrajectory: A state is malformed, or outside the limits of position.
        InvalidOption: A state exceeds a limit.
        TimingFailed: No motion was found.
    """
    chain = None if robot is None else chain_of(robot)
    names = _names(len(start.position)) if chain is None else chain.joint_names
    given = {name: frozen(value) for name, value in (limits or {}).items()}
    options = TimingOptions("jerk_limited")
    return time_states(names, (start, end), options, given, chain, synchronization)


def _names(n: int) -> tuple[str, ...]:
    return tuple(f"joint_{i + 1}" for i in range(n))


@typed
def check(
    robot: RobotGeometry, scene: Scene, joints: ArrayLike, *, margin: float = 0.0
) -> ConfigurationReport:
    """Check one configuration for collisions and position limits.

    Args:
        robot: The robot with its geometry.
        scene: The obstacles.
        joints: Shape (n,) [rad or m].
        margin: Distance to keep from obstacles beyond their own margins [m].

    Raises:
        InvalidRobotState: ``joints`` has the wrong length or is not finite.
    """
    q = robot.chain.state(joints)
    if not 0.0 <= margin < math.inf:
        raise InvalidOption(f"margin is {margin}", hint="Give 0 or more [m].")
    return configuration_checker(robot, place(scene, robot.chain, q), margin).check(q)
