"""The planner of straight and circular motions of the tool.

Each motion is followed in one branch of inverse kinematics and proved free. The arm rests between
them, so that corners are met exactly, or runs through corners that are rounded. Where the
tool can't be led to the end, the attempt says how far it comes and what is in the way.

The lines and arcs that a request asks for.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar, NamedTuple

import numpy as np

from kinematics.arrays import Array
from kinematics.errors import InvalidGoal, InvalidOption
from kinematics.forward import forward
from kinematics.model.chain import Chain
from kinematics.pose import rotation_error, to_quaternion, transform
from kinematics.rounding import TOLD, rounding
from kinematics.trajectory.trajectory import Trajectory
from planning.constrained.path_constraints import end_violation
from planning.options import CartesianOptions, Options, ToolMotionOptions
from planning.planner import Query
from planning.problem import Goal, JointGoal, PoseGoal, Problem
from planning.result import Attempt, Failure, ToolMotionReport
from planning.timing.options import TimingOptions
from planning.tool_motions.tool_motion import ToolMotion, arc_about, arc_via, line, naming
from planning.tool_motions.tool_path import Stop, Tolerances, ToolPath
from planning.tool_paths.blending import runs
from planning.tool_paths.seams.planner import plan_seam
from planning.tool_paths.tool_deviation import places_at
from planning.tool_paths.tool_following import HINTS, NAME, lead_tool, stop_failure

#: Instants that are drawn over all motions together.
INSTANTS = 64


@dataclass(frozen=True, slots=True)
class WrittenArc:
    """An arc about a centre, as a request gives it.

    Args:
        T_start: Beginning of the motion, shape (4, 4).
        T_end: End of the motion, shape (4, 4).
        center: Shape (3,) [m].
        normal: Axis to turn about by the right hand, shape (3,); None for the shorter arc.
        start_rounding: Rounding of each coordinate of the start [m]; 0 where the arm stands there.
    """

    T_start: Array
    T_end: Array
    center: Array
    normal: Sequence[float] | None
    start_rounding: float

    def motion(self, max_deviation: float) -> ToolMotion:
        """The arc.

        Args:
            max_deviation: Distance that the arc may be off the circle that is asked for, or more by
                rounding [m].

        Raises:
            InvalidGoal: Start, end and centre name no circle within these.
        """
        p, r, c = self.T_start[:3, 3], self.T_end[:3, 3], self.center
        of_ends, T_end = self.start_rounding + rounding(r), self.T_end
        if self.normal is None:
            across, along = _across_and_along(p, r, c)
            if across <= 2.0 * max(of_ends + rounding(c), along):
                c = 0.5 * (p + r)  # on their line to rounding: no plane is meant
        elif np.abs(r - p).max() <= of_ends:
            T_end = transform(T_end[:3, :3], p)  # a whole turn
        try:
            return arc_about(self.T_start, T_end, c, self.normal)
        except InvalidGoal:
            motion = self._nearest(T_end, c)
            if motion is None or self._miss(motion) > max(max_deviation, self._rounding()):
                raise
            return motion

    def _nearest(self, T_end: Array, c: Array) -> ToolMotion | None:
        """The nearest arc through start and end; None where there is none near."""
        p, r = self.T_start[:3, 3], T_end[:3, 3]
        chord, normal = r - p, None
        length = float(np.linalg.norm(chord))
        d = chord / length if length > 0.0 else chord
        c = c + float((0.5 * (p + r) - c) @ d) * d
        if self.normal is not None:
            n = np.array(self.normal) / math.hypot(*self.normal)
            n -= float(n @ d) * d
            n /= np.linalg.norm(n)
            spoke = 0.5 * (p + r) - c
            rise, size = float(n @ spoke), float(np.linalg.norm(spoke))
            if abs(rise) <= self._tilt() * size:
                n -= rise / size**2 * spoke
            else:
                c = c + rise * n
            normal = n
        moved = float(np.linalg.norm(c - self.center))
        # Arcs are moved by this part of their radius at most, however few decimals they are written
        # with.
        if not moved <= 0.1 * float(np.linalg.norm(p - c)):
            return None
        return arc_about(self.T_start, T_end, c, normal)

    def _miss(self, motion: ToolMotion) -> float:
        """How far an arc is off the circle that is asked for, at most [m]."""
        # Points of an arc that are compared with the circle that was asked for.
        away = motion.poses(np.linspace(0.0, 1.0, 33))[:, :3, 3] - self.center
        miss = float(np.abs(np.linalg.norm(away, axis=1) - np.linalg.norm(away[0])).max())
        if self.normal is None:
            return miss
        rises = away @ np.array(self.normal) / math.hypot(*self.normal)
        return max(miss, float(np.abs(rises).max()))

    def _tilt(self) -> float:
        """Angle by which rounding turns the normal, at most [rad]."""
        assert self.normal is not None
        return math.sqrt(3.0) * rounding(self.normal) / math.hypot(*self.normal)

    def _rounding(self) -> float:
        """How far rounding moves the ends off the circle, at most [m], to first order."""
        p, r, c = self.T_start[:3, 3], self.T_end[:3, 3], self.center
        of_start, of_end, of_center = self.start_rounding, rounding(r), rounding(c)
        radius = float(np.linalg.norm(p - c))
        errors = of_start * np.abs(p - c) + of_end * np.abs(r - c) + of_center * np.abs(r - p)
        radial = float(errors.sum()) / radius
        if self.normal is None:
            return radial
        off_plane = math.sqrt(3.0) * (max(of_start, of_end) + of_center) + self._tilt() * radius
        return max(radial, off_plane)


def _across_and_along(p: Array, r: Array, c: Array) -> tuple[float, float]:
    """How far a centre is off the line through start and end, and from the middle along it [m]."""
    length = float(np.linalg.norm(r - p))
    spoke = c - 0.5 * (p + r)
    along = float(spoke @ (r - p)) / length if length > 0.0 else 0.0
    return math.sqrt(max(float(spoke @ spoke) - along * along, 0.0)), abs(along)


def tool_motions(
    T_start: Array, options: CartesianOptions, target: Array | None = None
) -> tuple[ToolMotion, ...]:
    """Return the motions that options ask for, each from where it begins, or the one before ends.

    Args:
        T_start: Pose of the tool at the start, shape (4, 4).
        options: The motions asked for.
        target: The goal's pose, shape (4, 4): what one line leads to if no motions are asked for.

    Raises:
        InvalidGoal: An arc whose points name no circle; the message says which motion.
        InvalidOption: There are neither motions nor a goal.
    """
    if not options.motions:
        if target is None:
            raise InvalidOption("there is no motion to be carried out")
        return (line(T_start, target),)
    motions: list[ToolMotion] = []
    T = T_start
    for i, item in enumerate(options.motions):
        motions.append(tool_motion(T, item, i, options.max_deviation))
        T = motions[-1].T_end
    return tuple(motions)


def tool_motion(
    T_start: Array, item: ToolMotionOptions, index: int, max_deviation: float
) -> ToolMotion:
    """Return one motion that is asked for.

    Args:
        T_start: Beginning of the motion, unless it says so itself, shape (4, 4).
        item: The motion.
        index: Index in the request, for messages.
        max_deviation: Distance that an arc may be off the circle that is asked for, or more by
            rounding [m].

    Raises:
        InvalidGoal: An arc whose points name no circle.
    """
    T, end = T_start, np.array(item.T_base_tip)
    if item.T_base_start is not None:
        T = np.array(item.T_base_start)
    # The first begins where the arm stands, which nobody wrote.
    written = index > 0 or item.T_base_start is not None
    start_rounding = rounding(T[:3, 3]) if written else 0.0
    with naming(f"motions[{index}]", motion=index):
        if item.kind == "lin":
            motion = line(T, end)
        elif item.via is not None:
            motion = arc_via(T, end, item.via)
        else:
            assert item.center is not None
            arc = WrittenArc(T, end, np.array(item.center), item.normal, start_rounding)
            motion = arc.motion(max_deviation)
        # Angle below which a rotation has no axis [rad].
        if item.longer and motion.angle < 1e-6:
            raise InvalidGoal(
                "the tool does not turn, so that no rotation is the longer one",
                hint="Give the axis by a motion of half a turn, and another one.",
            )
    return replace(motion, longer=item.longer)


def repairs(options: CartesianOptions, motions: tuple[ToolMotion, ...]) -> tuple[str, ...]:
    """Notes on the arcs that are not quite the ones that were asked for.

    Args:
        options: The motions asked for.
        motions: The motions.
    """
    notes = []
    for i, (item, motion) in enumerate(zip(options.motions, motions, strict=False)):
        end = float(np.linalg.norm(motion.T_end[:3, 3] - item.T_base_tip[:3, 3]))
        center = 0.0 if item.center is None else float(np.linalg.norm(motion.center - item.center))
        if max(end, center) > TOLD:
            moved = f"its center was moved by {center:.2g} m"
            moved = moved if end <= TOLD else f"{moved}, its end to its start by {end:.2g} m"
            notes.append(f"motions[{i}] is a circle within rounding only: {moved}.")
    return tuple(notes)


class ReferencePose(NamedTuple):
    """The pose that the tool is held to at an instant.

    Args:
        time: The instant [s].
        motion: Index among the tool motions.
        T: T_base_tool, shape (4, 4).
    """

    time: float
    motion: int
    T: Array


def tool_reference(
    chain: Chain, trajectory: Trajectory, reports: Sequence[ToolMotionReport], seed: int
) -> tuple[ReferencePose, ...]:
    """The reference at instants drawn uniformly over the times of tool motions, in their order.

    Args:
        chain: The robot; its tip is the tool.
        trajectory: Trajectory of all its joints, in its order.
        reports: The motions with their times; none gives no instants.
        seed: Seed of the draw.
    """
    spans = np.array([max(report.ends - report.begins, 0.0) for report in reports])
    if not spans.sum() > 0.0:
        return ()
    drawn = np.sort(np.random.default_rng(seed).uniform(0.0, float(spans.sum()), INSTANTS))
    sums = np.cumsum(spans)
    owners = np.minimum(np.searchsorted(sums, drawn, side="right"), len(reports) - 1)
    begins = np.array([report.begins for report in reports])
    times = np.minimum(begins[owners] + drawn - (sums - spans)[owners], trajectory.duration)
    poses = forward(chain, trajectory.sample(times))
    return tuple(
        ReferencePose(time, k, reports[k].motion.pose(places_at(reports[k].motion, T[None])[0]))
        for time, k, T in zip(times.tolist(), owners.tolist(), poses, strict=True)
    )


@dataclass(frozen=True, slots=True)
class Cartesian:
    """The planner "cartesian".

    Args:
        options: The motions, and how far the tool may be off them.
        share: Part of these deviations that the search uses; the rest is a reserve for the proof.
    """

    options: CartesianOptions
    share: float = 0.9
    name: ClassVar[str] = NAME
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
            found = plan_seam(query, self.options, self.tolerances)
            if isinstance(found, Failure):
                return Attempt(None, f"{found.message}.", failure=found)
            return _attempt(*found)
        problem, start = query.problem, query.ready.start
        chain = problem.robot.chain
        motions = tool_motions(forward(chain, start), self.options, _target(problem))
        led = runs(motions, self._blends(len(motions)))
        path = lead_tool(query.checker, start, led, self.tolerances, query.deadline)
        failure = self._failure(problem, path) or _constraint_failure(problem, path)
        if failure is not None:
            return Attempt(None, f"{failure.message}.", failure=failure)
        notes, stop = repairs(self.options, motions), path.stop
        if stop is None:
            return _attempt(path, notes)
        attempt = _attempt(path, (*notes, f"The motion ends early: {stop.message}."))
        return replace(attempt, stopped=_end_details(chain, path))

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
        return stop_failure(
            tool_path.stop,
            f"the tool can be led along {100.0 * tool_path.fraction:.4g} % of its motion only",
            f"{HINTS[tool_path.stop.reason]} allow_partial answers what can be done.",
            **_end_details(problem.robot.chain, tool_path),
        )


def _attempt(path: ToolPath, notes: tuple[str, ...]) -> Attempt:
    """A tool path that was found."""
    asked = 1 + max(k for run in path.runs for k in run.asked)
    detail = f"{asked} motion(s), {len(path.waypoints)} configurations"
    if path.stop is not None:
        detail = f"{100.0 * path.fraction:.4g} % of the way: {path.stop.message}"
    return Attempt(path.waypoints, f"{detail}.", notes, tool_path=path)


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
    text = f"{chain.joint_names[j]!r} ends at {q[j]:.6g}, not {goal.joints[j]:.6g}"
    return stop_failure(
        Stop("branch", text, {}),
        "the tool can be led to the goal's pose, but not to its joints",
        "Give the goal as a pose, or a goal in the branch of the start.",
        **_end_details(chain, tool_path),
    )


def _constraint_failure(problem: Problem, tool_path: ToolPath) -> Failure | None:
    """Failure of a path constraint at the start, or at the end where it is reached."""
    first, last = tool_path.segments[0], tool_path.segments[-1]
    failure = end_violation(problem.constraints, "start", first.start)
    if failure is not None or tool_path.stop is not None:
        return failure
    return end_violation(problem.constraints, "goal", last.end)


def _end_details(chain: Chain, tool_path: ToolPath) -> dict[str, Any]:
    """Progress of the tool and the reason for its stop, as values."""
    segment, stop = tool_path.segments[-1], tool_path.stop
    last = tool_path.runs[-1].parts_until(segment.reached)[-1]
    T = forward(chain, segment.end)
    pose = {
        "position": T[:3, 3].tolist(),
        "quaternion_xyzw": to_quaternion(T[:3, :3]).tolist(),
    }
    progress = {
        "fraction": tool_path.fraction,
        "motion": last.asked,
        "motion_fraction": min((segment.reached - last.begin) / (last.end - last.begin), 1.0),
        "nearest": {"joints": segment.end.tolist(), "pose": pose},
    }
    if stop is None:
        return progress
    return {**progress, "reason": stop.reason, "message": stop.message, **stop.details}
