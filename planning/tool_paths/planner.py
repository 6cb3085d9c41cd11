"""The planner of straight and circular motions of the tool.

Each motion is followed in one branch of inverse kinematics and proved free. The arm rests between
them, so that corners are met exactly, or runs through corners that are rounded. Where the
tool can't be led to the end, the attempt says how far it comes and what is in the way.
"""

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from kinematics.arrays import Array
from kinematics.errors import InvalidGoal, InvalidOption
from kinematics.forward import forward
from kinematics.model.chain import Chain
from kinematics.pose import rotation_error, to_quaternion
from planning.constrained.path_constraints import end_violation
from planning.options import CartesianOptions, Options
from planning.planner import Query
from planning.problem import Goal, JointGoal, PoseGoal, Problem
from planning.result import Attempt, Failure
from planning.timing.options import TimingOptions
from planning.tool_motions.tool_path import Stop, Tolerances, ToolPath
from planning.tool_paths.blending import runs
from planning.tool_paths.motions import repairs, tool_motions
from planning.tool_paths.reasons import HINTS
from planning.tool_paths.seams.planner import plan_seam
from planning.tool_paths.tool_following import lead_tool


@dataclass(frozen=True, slots=True)
class Cartesian:
    """The planner "cartesian".

    Args:
        options: The motions, and how far the tool may be off them.
        share: Part of these deviations that the search uses; the rest is a reserve for the proof.
    """

    options: CartesianOptions
    share: float = 0.9
    name: ClassVar[str] = "cartesian"
    needs_goals: ClassVar[bool] = False

    @classmethod
    def of(cls, problem: Problem, options: Options) -> "Cartesian":
        """Return the planner with the request's options, checked.

        Raises:
            InvalidGoal: There are several goals, or the motions do not end at the goal.
            InvalidOption: Timing options that do not go with it.
        """
        _check_timing(options.timing)
        if options.cartesian.seam is not None:
            _check_seam(problem, options.timing)
            return cls(options.cartesian)
        if len(problem.goals) != 1:
            raise InvalidGoal(
                "the planner cartesian goes to one goal, not to any of several",
                hint="Give the pose that the tool is to be led to.",
            )
        motions = options.cartesian.motions
        if motions:
            _check_end(problem.robot.chain, problem.goals[0], np.array(motions[-1].T_base_tip))
        return cls(options.cartesian)

    @property
    def tolerances(self) -> Tolerances:
        """Tolerances of the tool's deviation from its motions."""
        free = self.options.orientation == "free"
        orientation = None if free else self.options.max_orientation_deviation
        return Tolerances(self.options.max_deviation, orientation, self.share)

    def plan(self, query: Query) -> Attempt:
        """Lead the tool along the motions that are asked for, or straight to the goal.

        Raises:
            InvalidGoal: Motions that name no circle.
        """
        if self.options.seam is not None:
            return plan_seam(query, self.options, self.tolerances)
        problem, start = query.problem, query.ready.start
        chain = problem.robot.chain
        motions = tool_motions(forward(chain, start), self.options, _target(problem))
        led = runs(motions, self._blends(len(motions)))
        tool_path = lead_tool(chain, query.checker, start, led, self.tolerances, query.deadline)
        failure = self._failure(problem, tool_path) or _constraint_failure(problem, tool_path)
        if failure is not None:
            detail = f"{failure.message}." if tool_path.stop is None else _describe(tool_path)
            return Attempt(None, detail, failure=failure)
        notes, stop = repairs(self.options, motions), tool_path.stop
        if stop is None:
            return Attempt(tool_path.waypoints, _describe(tool_path), notes, tool_path=tool_path)
        return Attempt(
            tool_path.waypoints,
            _describe(tool_path),
            notes=(*notes, f"The motion ends early: {stop.message}."),
            tool_path=tool_path,
            stopped=_stop_details(chain, tool_path, stop),
        )

    def _blends(self, count: int) -> list[float]:
        """Distance from the end of each motion at which the tool may leave it [m]."""
        if not self.options.motions:
            return [self.options.blend] * count
        asked = [motion.blend for motion in self.options.motions]
        return [self.options.blend if blend is None else blend for blend in asked]

    def _failure(self, problem: Problem, tool_path: ToolPath) -> Failure | None:
        """Why a tool path is no answer, if it is none."""
        if tool_path.stop is None:
            return _joints_failure(problem, tool_path)
        if self.options.allow_partial and tool_path.fraction > 0.0:
            return None
        stop, percentage = tool_path.stop, 100.0 * tool_path.fraction
        code = "PLANNING_FAILED"
        message = f"the tool can be led along {percentage:.4g} % of its motion only: {stop.message}"
        if stop.reason == "time":
            code = "TIMED_OUT"
            message = f"time was up after {percentage:.4g} % of the motion"
        hint = f"{HINTS[stop.reason]} allow_partial answers what can be done."
        details = _stop_details(problem.robot.chain, tool_path, stop)
        return Failure(code, message, hint, self.name, details=details)


def _describe(tool_path: ToolPath) -> str:
    """Sentence about the part of the tool's motions that was followed."""
    if tool_path.stop is None:
        count = len(tool_path.waypoints)
        asked = tool_path.runs[-1].asked[-1] + 1
        return f"{asked} motion(s), {count} configurations."
    return f"{100.0 * tool_path.fraction:.4g} % of the way: {tool_path.stop.message}."


def _check_timing(timing: TimingOptions) -> None:
    if timing.times is not None:
        raise InvalidOption(
            "timing.times do not apply to the planner cartesian: it finds the waypoints itself",
            hint="Leave times out, or time the path it answers by POST /v1/retime.",
        )
    if timing.interpolation not in {None, "clamped_spline"} or timing.blend_tolerance:
        raise InvalidOption(
            "timing.interpolation and blend_tolerance do not apply to the planner cartesian: "
            "the tool's motion is kept, and stops at its corners",
            hint="Leave them out.",
        )


def _check_seam(problem: Problem, timing: TimingOptions) -> None:
    if timing.method == "spline":
        raise InvalidOption(
            "a seam can't be timed by the method spline, which leaves its path",
            hint="Ask for toppra or jerk_limited.",
        )
    if problem.constraints:
        raise InvalidOption(
            "path constraints do not go with waypoints of the planner cartesian",
            hint="Say in the tolerance what the tool may do.",
        )


def _check_end(chain: Chain, goal: Goal, T_end: Array) -> None:
    if isinstance(goal, PoseGoal):
        target, allowed = goal.T_base_tip, (goal.position_tolerance, goal.orientation_tolerance)
    else:
        # How near the last motion must end to a goal given by joints [m].
        # How near its orientation must be to the goal's [rad].
        target, allowed = forward(chain, goal.joints), (1e-6, 1e-6)
    away = float(np.linalg.norm(target[:3, 3] - T_end[:3, 3]))
    turned = float(np.linalg.norm(rotation_error(T_end[:3, :3], target[:3, :3])))
    if away > allowed[0] or turned > allowed[1]:
        raise InvalidGoal(
            f"the last motion ends {away:.6g} m and {turned:.6g} rad from the goal",
            hint="Give the same pose for both.",
            position_error=away,
            orientation_error=turned,
        )


def _target(problem: Problem) -> Array:
    goal = problem.goals[0]
    if isinstance(goal, PoseGoal):
        return goal.T_base_tip
    return forward(problem.robot.chain, goal.joints)


def _joints_failure(problem: Problem, tool_path: ToolPath) -> Failure | None:
    """Why the end is not at the joints of the goal, where the goal has any and it is not."""
    goal, q = problem.goals[0], tool_path.segments[-1].end
    # How near a motion must come to the joints of its goal [rad or m].
    if not isinstance(goal, JointGoal) or np.abs(q - goal.joints).max() <= 1e-5:
        return None
    chain = problem.robot.chain
    j = int(np.argmax(np.abs(q - goal.joints)))
    return Failure(
        "PLANNING_FAILED",
        "the tool can be led to the goal's pose, but not to its joints: "
        f"{chain.joint_names[j]!r} ends at {q[j]:.6g}, not {goal.joints[j]:.6g}",
        "Give the goal as a pose, or a goal in the branch of the start.",
        Cartesian.name,
        details=_end_details(chain, tool_path) | {"reason": "branch"},
    )


def _constraint_failure(problem: Problem, tool_path: ToolPath) -> Failure | None:
    """Failure of a path constraint at the start, or at the end where it is reached."""
    first, last = tool_path.segments[0], tool_path.segments[-1]
    failure = end_violation(problem.constraints, "start", first.start)
    if failure is not None or tool_path.stop is not None:
        return failure
    return end_violation(problem.constraints, "goal", last.end)


def _end_details(chain: Chain, tool_path: ToolPath) -> dict[str, Any]:
    """Progress of the tool, as values."""
    segment = tool_path.segments[-1]
    reached = 1.0 if segment.stop is None else segment.reached
    last = tool_path.runs[-1].parts_until(reached)[-1]
    T = forward(chain, segment.end)
    pose = {
        "position": T[:3, 3].tolist(),
        "quaternion_xyzw": to_quaternion(T[:3, :3]).tolist(),
    }
    return {
        "fraction": tool_path.fraction,
        "motion": last.asked,
        "motion_fraction": min((reached - last.begin) / (last.end - last.begin), 1.0),
        "nearest": {"joints": segment.end.tolist(), "pose": pose},
    }


def _stop_details(chain: Chain, tool_path: ToolPath, stop: Stop) -> dict[str, Any]:
    """Progress of the tool and the reason for its stop, as values."""
    reason = {"reason": stop.reason, "message": stop.message}
    return {**_end_details(chain, tool_path), **reason, **stop.details}
