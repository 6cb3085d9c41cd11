"""Planning problems and planner options from wire to domain; reports of stages back."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from armwright_wire.goals import goal as goal_schema
from armwright_wire.goals import tool_motion
from armwright_wire.goals.goal import GoalCosts as GoalCostsBody
from armwright_wire.goals.tool_motion import cartesian_options
from armwright_wire.plans import plan as schema
from kinematics.arrays import Array
from kinematics.model.chain import Chain
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.scenes.scene import Scene
from planning.clearance_report import ClearanceReport
from planning.options import CartesianOptions, Options, ToolMotionOptions
from planning.pipeline.path_search import PLANNERS
from planning.problem import Goal, JointGoal, PoseGoal, Problem
from planning.result import StageReport
from planning.values.optimize_options import RefineOptions
from planning.values.preferences import GoalCosts, PreferredClearance
from service.fields import picked
from service.translate import poses, timings
from service.translate.constraints import constraint_set
from service.translate.seams import seam_options

#: What holds where a request says nothing else.
_NO_TOOL_MOTIONS, _USUAL_COSTS, _USUAL_CLEARANCE = (
    CartesianOptions(),
    GoalCosts(),
    PreferredClearance(),
)


def planner_name(name: str) -> str:
    """The name of a planner as the pipeline has it; an unknown one as it is.

    OMPL's may be written in any case, with or without underscores.
    """
    if name in PLANNERS:
        return name
    return next((known for known in PLANNERS if _bare(known) == _bare(name)), name)


def _bare(name: str) -> str:
    return name.lower().replace("_", "")


def problem(body: schema.PlanRequest, robot: RobotGeometry, scene: Scene, chain: Chain) -> Problem:
    """The domain's problem, for a robot with what it holds.

    Args:
        body: The request.
        robot: The robot.
        scene: The surroundings.
        chain: The robot's chain with the frames of what it holds as links, for constraints.

    Raises:
        InvalidRobotState: A joint vector has the wrong length.
        InvalidGoal: A goal is malformed.
    """
    goal = body.goal
    goals = (
        (single_goal(goal, robot.chain, "goal.joints"),)
        if goal.any_of is None
        else tuple(
            single_goal(item, robot.chain, f"goal.any_of[{i}].joints")
            for i, item in enumerate(goal.any_of)
        )
    )
    start = np.array(body.start.joints)
    return Problem(
        robot,
        scene,
        start,
        goals,
        _least_clearance(body),
        body.start_state_tolerance,
        constraints=constraint_set(body.constraints, chain),
        start_velocity=array_or_none(body.start.velocities),
        start_acceleration=array_or_none(body.start.accelerations),
    )


def _least_clearance(body: schema.PlanRequest) -> float:
    """The margin that a request asks for by either name [m]."""
    least = None if body.clearance is None else body.clearance.least
    return body.margin if least is None else least


def clearance_answer(report: ClearanceReport) -> dict[str, Any]:
    """Preferred distances, and where a motion does not keep them, on the wire."""
    told = picked(report, "preferred", "own_links", "least", "time_below", "period")
    return told | {"spans": [asdict(span) for span in report.spans]}


def array_or_none(given: Sequence[Any] | None) -> Array | None:
    """An array of numbers that may be left out."""
    return None if given is None else np.array(given, dtype=np.float64)


def single_goal(body: goal_schema.SingleGoal, chain: Chain, where: str) -> Goal:
    """The domain's goal: a configuration or a pose.

    Args:
        body: The goal, its state looked up and its pose in the root frame.
        chain: The robot.
        where: Place of its joints in the request, for messages.

    Raises:
        InvalidRobotState: The joint vector has the wrong length.
        InvalidGoal: The goal is malformed.
    """
    if body.joints is not None:
        q = chain.configuration(body.joints, where)
        return JointGoal(q, array_or_none(body.velocities), array_or_none(body.accelerations))
    assert body.pose is not None
    given = {
        name: getattr(body, name)
        for name in ("position_tolerance", "orientation_tolerance")
        if getattr(body, name) is not None
    }
    return PoseGoal(poses.transform(body.pose), **given)


def options(
    body: schema.PlanRequest,
    chain: Chain,
    timeout: float,
    observer: Callable[[str], None] | None = None,
) -> Options:
    """Options of planning, with a timeout.

    Args:
        body: The request.
        chain: The robot.
        timeout: Timeout for all stages together [s].
        observer: Called with the name of each stage as it begins.

    Raises:
        InvalidOption: A value is out of its range.
    """
    name = planner_name(body.planner)
    tool_motion = name == "cartesian"
    given = {} if tool_motion else dict(body.planner_options or {})
    fallback = given.get("fallback")
    if isinstance(fallback, str):
        given["fallback"] = planner_name(fallback)
    return Options(
        planner=name,
        planner_options=given,
        cartesian=cartesian(cartesian_options(body.planner_options), chain)
        if tool_motion
        else _NO_TOOL_MOTIONS,
        timing=timings.timing_options(body.timing),
        limits=timings.given_limits(body.limits, chain.joint_names),
        timeout=timeout,
        seed=body.seed,
        observer=observer,
        refine=_refine(body.refine),
        stops=body.stops,
        path_tolerance=None if body.path is None else body.path.tolerance,
        goal_costs=goal_costs(body.goal_costs),
        clearance=_USUAL_CLEARANCE
        if body.clearance is None
        else PreferredClearance(body.clearance.preferred),
    )


def goal_costs(body: GoalCostsBody | None) -> GoalCosts:
    """Weights of what goal configurations cost; the usual ones where none are given."""
    return _USUAL_COSTS if body is None else GoalCosts(**body.model_dump())


def cartesian(given: tool_motion.CartesianOptions, chain: Chain) -> CartesianOptions:
    """Options of tool motions, those of a request in the root frame.

    Args:
        given: The options as the request has them.
        chain: The robot, for frames of tolerances.

    Raises:
        ArmwrightError: A waypoint or a tolerance is malformed.
    """
    return CartesianOptions(
        _motions(given.motions or ()),
        given.max_deviation,
        given.max_orientation_deviation,
        given.orientation,
        given.allow_partial,
        given.blend,
        None if given.waypoints is None else seam_options(given, chain),
    )


def _motions(items: Sequence[tool_motion.ToolMotion]) -> tuple[ToolMotionOptions, ...]:
    return tuple(
        ToolMotionOptions(
            item.type,
            poses.transform(item.pose),
            item.via,
            item.center,
            item.normal,
            item.blend,
            longer=item.rotation == "longer",
        )
        for item in items
    )


def _refine(body: schema.Refine | bool | None) -> RefineOptions | None:
    if body is None or body is False:
        return None
    if body is True:
        return RefineOptions()
    return RefineOptions.of(body.model_dump(exclude_none=True))


def stages_answer(stages: Sequence[StageReport]) -> list[dict[str, Any]]:
    """Reports of the stages on the wire."""
    return [
        {"name": name, "outcome": outcome, "milliseconds": spent, "detail": detail or None}
        for name, outcome, spent, detail, _ in stages
    ]


def plain(values: Mapping[str, Any]) -> dict[str, Any]:
    """Details as JSON can carry them: numpy's numbers as Python's."""
    return {
        name: value.item() if isinstance(value, np.generic) else value
        for name, value in values.items()
    }
