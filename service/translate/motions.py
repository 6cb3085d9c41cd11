"""Problems, trajectories and certificates from wire to domain and back."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from kinematics.arrays import Array
from kinematics.chain import Chain, Limits
from kinematics.errors import InvalidOption, InvalidTrajectory
from kinematics.interpolation import interpolate
from kinematics.trajectory import MAX_DEGREE, Trajectory
from obstacles.robot_geometry import RobotGeometry
from obstacles.scene import Scene
from planning.optimize.options import RefineOptions
from planning.options import CartesianOptions, Options, ToolMotionOptions
from planning.problem import Goal, JointGoal, PoseGoal, Problem
from planning.proof.certificate import Certificate
from planning.result import StageReport, ToolMotionReport
from planning.search.planner import PLANNERS
from service.schemas import plan as schema
from service.schemas.cartesian import cartesian_options
from service.translate import poses, timings
from service.translate.constraints import constraint_set

#: Samples of one answer: at a kilobyte each, a hundred megabytes.
_MAX_SAMPLES = 100_000
#: What sums of times round off, as part of the duration.
_TIME_ROUNDING = 1e-9


# -------------------------------------------------------------------------------- problems


def planner_name(name: str) -> str:
    """The name of a planner as the pipeline has it; an unknown one as it is.

    OMPL's may be written in any case, with or without underscores.
    """
    return next((known for known in PLANNERS if _bare(known) == _bare(name)), name)


def _bare(name: str) -> str:
    return name.lower().replace("_", "")


def problem(body: schema.PlanRequest, robot: RobotGeometry, scene: Scene) -> Problem:
    """The domain's problem, for a robot with what it holds.

    Raises:
        InvalidRobotState: A joint vector has the wrong length.
        InvalidGoal: A goal is malformed.
    """
    goal = body.goal
    goals = (
        (_goal(goal, robot.chain, "goal.joints"),)
        if goal.any_of is None
        else tuple(
            _goal(item, robot.chain, f"goal.any_of[{i}].joints")
            for i, item in enumerate(goal.any_of)
        )
    )
    start = np.array(body.start.joints)
    return Problem(
        robot, scene, start, goals, body.margin, body.start_state_tolerance,
        constraints=constraint_set(body.constraints, robot.chain),
        start_velocity=_rates(body.start.velocities),
        start_acceleration=_rates(body.start.accelerations),
    )  # fmt: skip


def _rates(given: Sequence[float] | None) -> Array | None:
    return None if given is None else np.array(given, dtype=np.float64)


def _goal(body: schema.SingleGoal, chain: Chain, where: str) -> Goal:
    if body.joints is not None:
        q = chain.configuration(body.joints, where)
        return JointGoal(q, _rates(body.velocities), _rates(body.accelerations))
    assert body.pose is not None
    given = {
        name: getattr(body, name)
        for name in ("position_tolerance", "orientation_tolerance")
        if getattr(body, name) is not None
    }
    return PoseGoal(poses.transform(body.pose), **given)


def options(body: schema.PlanRequest, chain: Chain, timeout: float) -> Options:
    """How to plan, within so many seconds.

    Raises:
        InvalidOption: A value is out of its range.
    """
    name = planner_name(body.planner)
    cartesian = name == "cartesian"
    return Options(
        planner=name,
        planner_options={} if cartesian else dict(body.planner_options or {}),
        cartesian=_cartesian(body) if cartesian else CartesianOptions(),
        timing=timings.timing_options(body.timing),
        limits=timings.given_limits(body.limits, chain.joint_names),
        timeout=timeout,
        seed=body.seed,
        refine=_refine(body.refine),
    )


def _cartesian(body: schema.PlanRequest) -> CartesianOptions:
    given = cartesian_options(body.planner_options)
    motions = tuple(
        ToolMotionOptions(item.type, poses.transform(item.pose), item.via, item.center, item.normal)
        for item in given.motions or ()
    )
    return CartesianOptions(
        motions,
        given.max_deviation,
        given.max_orientation_deviation,
        given.orientation,
        given.allow_partial,
    )


def _refine(body: schema.Refine | bool | None) -> RefineOptions | None:
    if body is None or body is False:
        return None
    if body is True:
        return RefineOptions()
    return RefineOptions.of(body.model_dump(exclude_none=True))


# ---------------------------------------------------------------------------- trajectories


def trajectory(body: schema.TrajectoryBody, chain: Chain) -> tuple[Trajectory, float]:
    """The domain's trajectory with the robot's joints in their order, and when it begins [s].

    Raises:
        InvalidTrajectory: Joints or lengths do not fit the robot, or times do not ascend.
        InvalidOption: The interpolation is unknown, or what it needs is not given.
    """
    order = _order(body.joint_names, chain)
    if body.segments is not None:
        return _from_segments(body.segments, chain, order), body.segments[0].t0
    samples = body.samples
    assert samples is not None
    rows = [
        None if given is None else _columns(given, name, chain, order)
        for name, given in (
            ("position", samples.position),
            ("velocity", samples.velocity),
            ("acceleration", samples.acceleration),
        )
    ]
    assert rows[0] is not None
    times, names = np.array(samples.time), chain.joint_names
    made = interpolate(names, times, rows[0], body.interpolation or "", rows[1], rows[2])
    return made, samples.time[0]


def named_trajectory(body: schema.TrajectoryBody) -> Trajectory:
    """The domain's trajectory of a motion that names its joints, for which no robot is needed.

    Raises:
        InvalidTrajectory: Joints or lengths do not fit each other, or times do not ascend.
        InvalidOption: The interpolation is unknown, or what it needs is not given.
    """
    assert body.joint_names is not None
    names = tuple(body.joint_names)
    if len(set(names)) != len(names):
        raise InvalidTrajectory("trajectory.joint_names stand twice", hint="Name each joint once.")
    return trajectory(body, _nameless(names))[0]


def _nameless(names: tuple[str, ...]) -> Chain:
    """A chain of joints that are only known by their names."""
    n = len(names)
    offsets = np.broadcast_to(np.eye(4), (n, 4, 4))
    types = np.zeros(n, dtype=np.int64)
    limits = Limits.unlimited(n)
    return Chain("", names, types, offsets, (), "", "", limits, np.zeros(n, dtype=np.bool_))


def _order(joint_names: Sequence[str] | None, chain: Chain) -> list[int]:
    """Where in the trajectory each joint of the chain is."""
    names = list(chain.joint_names if joint_names is None else joint_names)
    if sorted(names) != sorted(chain.joint_names):
        raise InvalidTrajectory(
            f"the trajectory is of the joints {', '.join(names)}",
            hint=f"Robot {chain.name!r} has: {', '.join(chain.joint_names)}; name each once.",
            joint_names=list(chain.joint_names),
        )
    return [names.index(name) for name in chain.joint_names]


def _columns(rows: list[list[float]], name: str, chain: Chain, order: list[int]) -> Array:
    wrong = next((i for i, row in enumerate(rows) if len(row) != chain.n), None)
    if wrong is not None:
        raise InvalidTrajectory(
            f"samples.{name}[{wrong}] has {len(rows[wrong])} value(s), robot {chain.name!r} has "
            f"{chain.n} joints",
            hint="One value for each joint, in the order of joint_names.",
        )
    return np.asarray(np.array(rows, dtype=np.float64)[:, order])


def _from_segments(
    segments: Sequence[schema.Segment], chain: Chain, order: list[int]
) -> Trajectory:
    size = max(len(row) for segment in segments for row in segment.coefficients)
    if size > MAX_DEGREE + 1:
        raise InvalidTrajectory(f"segments have up to {size} coefficients", hint="Take fewer.")
    coefficients = np.zeros((len(segments), chain.n, size))
    slack = _TIME_ROUNDING * (segments[-1].t1 - segments[0].t0)
    for i, segment in enumerate(segments):
        if len(segment.coefficients) != chain.n:
            raise InvalidTrajectory(
                f"segments[{i}] is of {len(segment.coefficients)} joint(s), robot {chain.name!r} "
                f"has {chain.n}",
                hint="Give coefficients[joint][power], the joints in the order of joint_names.",
            )
        if i > 0 and abs(segment.t0 - segments[i - 1].t1) > slack:
            raise InvalidTrajectory(
                f"segments[{i}] begins at {segment.t0:g} s, the one before ends at "
                f"{segments[i - 1].t1:g} s",
                hint="Each segment begins where the one before ends.",
            )
        for j, place in enumerate(order):
            row = segment.coefficients[place]
            coefficients[i, j, : len(row)] = row
    breaks = np.array([segments[0].t0, *(segment.t1 for segment in segments)])
    return Trajectory(chain.joint_names, breaks - breaks[0], coefficients)


def limits(body: schema.LimitsBody | None, chain: Chain) -> dict[str, Array]:
    """Limits to hold a trajectory to: those of the request, else those of the robot.

    The robot's jerk limits bind where the acceleration does not jump; those of a request always do.

    Raises:
        MissingLimit: A velocity or acceleration limit is known from neither.
        InvalidOption: A limit is not positive, or their number is wrong.
    """
    bounds: dict[str, Array] = {}
    for quantity in ("velocity", "acceleration", "jerk"):
        given = None if body is None else getattr(body, quantity)
        if given is not None:
            bounds[quantity] = timings.given_limit(given, quantity, chain.joint_names)
        elif quantity != "jerk":
            bounds[quantity] = chain.limits.require(quantity, chain.joint_names)
    return bounds


# ------------------------------------------------------------------------------------ back


def trajectory_answer(timed: Trajectory, period: float | None) -> dict[str, Any]:
    """A trajectory as answers give it, with samples where a period [s] is given.

    Raises:
        InvalidOption: The period would give too many samples.
    """
    breaks, pieces = timed.breaks.tolist(), timed.coefficients.tolist()
    answer: dict[str, Any] = {
        "joint_names": list(timed.joint_names),
        "duration": timed.duration,
        "segments": [
            {"t0": t0, "t1": t1, "coefficients": rows}
            for t0, t1, rows in zip(breaks, breaks[1:], pieces, strict=False)
        ],
        "samples": None,
    }
    if period is not None:
        answer["samples"] = _samples(timed, period)
    return answer


def _samples(timed: Trajectory, period: float) -> dict[str, Any]:
    if timed.duration / period > _MAX_SAMPLES:
        raise InvalidOption(
            f"timing.sample_period: {period:g} s over {timed.duration:g} s gives more than "
            f"{_MAX_SAMPLES} samples",
            hint=f"Give at least {timed.duration / _MAX_SAMPLES:.3g} s.",
        )
    times = timed.uniform_samples(period)
    return {
        "time": times.tolist(),
        "position": timed.sample(times).tolist(),
        "velocity": timed.sample(times, 1).tolist(),
        "acceleration": timed.sample(times, 2).tolist(),
    }


def certificate_answer(certificate: Certificate, begins: float = 0.0) -> dict[str, Any]:
    """A certificate as answers give it, of a trajectory that begins at a time [s]."""
    answer: dict[str, Any] = {
        "verified": certificate.verified,
        "min_clearance": _finite(certificate.min_clearance),
        "clearance_pair": certificate.clearance_pair,
        "min_obstacle_clearance": _finite(certificate.min_obstacle_clearance),
        "min_self_clearance": _finite(certificate.min_self_clearance),
        "method": certificate.method,
        "limits": {
            name: {
                "worst_ratio": _finite(report.worst_ratio),
                "joint": report.joint,
                "time": report.time + begins,
            }
            for name, report in certificate.limits.items()
        },
        "continuity": dict(certificate.continuity),
        "cells": certificate.cells,
        "violation": None,
    }
    answer["path_constraint_residual"] = certificate.path_constraint_residual
    answer["path_constraints"] = [
        {
            "constraint": report.constraint,
            "name": report.name,
            "residual": report.residual,
            "unit": report.unit,
            "hard": report.hard,
            "time": report.time + begins,
        }
        for report in certificate.path_constraints
    ]
    deviation = certificate.path_deviation
    if deviation is not None:
        answer["path_deviation"] = {
            "position": deviation.position,
            "orientation": deviation.orientation,
            "time": deviation.time + begins,
            "max_position": deviation.max_position,
            "max_orientation": deviation.max_orientation,
        }
    violation = certificate.violation
    if violation is not None:
        answer["violation"] = {
            "kind": violation.kind,
            "time": violation.time + begins,
            "message": violation.message,
            **plain(violation.details),
        }
    return answer


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def tool_motions_answer(reports: Sequence[ToolMotionReport]) -> list[dict[str, Any]]:
    """What became of the tool's motions, as answers give it."""
    return [
        {
            "type": report.kind,
            "length": report.length,
            "angle": report.angle,
            "fraction": report.fraction,
            "begins": report.begins,
            "ends": report.ends,
        }
        for report in reports
    ]


def stages_answer(stages: Sequence[StageReport]) -> list[dict[str, Any]]:
    """What the stages of a plan did, as answers give it."""
    return [
        {
            "name": stage.name,
            "outcome": stage.outcome,
            "milliseconds": stage.milliseconds,
            "detail": stage.detail or None,
        }
        for stage in stages
    ]


def plain(values: Mapping[str, Any]) -> dict[str, Any]:
    """Details as JSON can carry them: numpy's numbers as Python's."""
    return {
        name: value.item() if isinstance(value, np.generic) else value
        for name, value in values.items()
    }
