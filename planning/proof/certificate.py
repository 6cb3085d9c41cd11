"""The proof that a timed trajectory is free for every instant and inside every limit.

It knows nothing of how the trajectory came about and shares no verdict with the planners. It
sweeps the polynomials themselves, interval of time by interval of time: where some direction parts
a pair in the middle of an interval by more than its margin and more than it can move in the
interval, it is free all over the interval, with at least the difference to spare; others are looked
at again on the halves. Whoever proposed the direction, it is checked here, on the exact geometry
(``sweep``, ``separating_direction``, ``motion_bounds``). What no direction settles, since it
touches or nearly so, FCL decides.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from kinematics.arrays import Array
from kinematics.chain import Limits
from kinematics.trajectory import Trajectory
from obstacles.containment import first_inside
from obstacles.convex_distance import ACCURACY, convex_distance
from obstacles.robot_geometry import RobotGeometry
from obstacles.scene import Scene
from planning.constraints.constraint_set import ConstraintSet
from planning.deadline import Deadline
from planning.limits import MotionLimits
from planning.proof.constraint_limits import constrained_efforts, constrained_margin
from planning.proof.constraints import ConstraintReport, check_motion
from planning.proof.interval_check import RESOLUTION, sharp_enough
from planning.proof.limits import LimitReport, check_continuity, check_limits
from planning.proof.motion_bounds import VALUE
from planning.proof.pair_table import PairTable
from planning.proof.sweep import ASKING, DONE, FULL, run
from planning.proof.sweep_state import (
    CENTER,
    DEPTH,
    FIRST,
    LAST,
    MAX_DEPTH,
    OBSTACLE,
    OPEN,
    OWN,
    REFERRED,
    TOP,
    VISITS,
    enlarge,
    note_clearance,
    push_halves,
    start_sweep,
)
from planning.proof.tool_deviation import PathDeviation, check_tool_motions
from planning.proof.violation import Violation
from planning.tool_motion import TimedToolMotions

#: A violation this near to the start or the goal, in every joint, is told as theirs [rad or m].
_AT_AN_END = 1e-6
# The referee's decision on a pair.
#: It is free all over the interval.
_FREE = 0
#: It may be free on the halves.
_OPEN = 1
#: It violates its margin.
_HIT = 2
#: Intervals between two looks at the clock: a few milliseconds.
_INTERVALS_A_CALL = 1000


@dataclass(frozen=True, slots=True)
class Proved:
    """Parts of a proof that were carried out and hold.

    Args:
        limits: Limits, continuity, constraints and tool motions hold at every instant.
        collisions: Nothing collides at any instant.
        reasons: Why a part is not proved, a sentence each.
    """

    limits: bool
    collisions: bool
    reasons: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Certificate:
    """Everything that was proved about a trajectory.

    Args:
        verified: All that was asked for is proved: limits always, collisions unless there is
            nothing to collide with.
        min_clearance: Holds for every t, margins not taken off [m]; infinite where nothing can
            collide, the distance found where something does.
        clearance_pair: The pair with the least clearance.
        min_obstacle_clearance: The same from obstacles alone [m]. Where a collision was found both
            of these hold up to its time.
        min_self_clearance: The same among the robot's own links and what it holds [m]; no margin
            concerns these.
        method: How it was proved.
        limits: By quantity.
        continuity: Largest jumps of position and velocity.
        cells: Intervals of time that were looked at.
        violation: The first thing that is wrong; None where it is verified.
        path_deviation: How far the tool is off the motions asked for, where some were.
        path_constraints: How well each constraint of the path is held.
        proved: Which parts were proved, and why others were not.
        obstacle_pair: The pair with the least clearance of those with an obstacle.
        self_pair: The same of the robot's own links and what it holds.
    """

    verified: bool
    min_clearance: float
    clearance_pair: tuple[str, str] | None
    min_obstacle_clearance: float
    min_self_clearance: float
    method: str
    limits: Mapping[str, LimitReport]
    continuity: Mapping[str, float]
    cells: int
    violation: Violation | None = None
    path_deviation: PathDeviation | None = None
    path_constraints: tuple[ConstraintReport, ...] = ()
    proved: Proved = Proved(False, False)
    obstacle_pair: tuple[str, str] | None = None
    self_pair: tuple[str, str] | None = None

    @property
    def path_constraint_residual(self) -> float | None:
        """The worst residual of all hard path constraints over all t [m or rad], 0 where they hold.

        None where there are none.
        """
        hard = [report.residual for report in self.path_constraints if report.hard]
        return max(0.0, *hard) if hard else None


METHOD = (
    "continuous: separating directions checked against motion bounds on cells of time, "
    "exact extrema of polynomials"
)
NOTHING_KNOWN = "nothing is known of collisions"
LIMITS_METHOD = f"exact extrema of polynomials; {NOTHING_KNOWN}"


def certify(
    trajectory: Trajectory,
    robot: RobotGeometry,
    scene: Scene,
    *,
    margin: float = 0.0,
    limits: MotionLimits | None = None,
    constraints: ConstraintSet | None = None,
    tool_motions: TimedToolMotions | None = None,
    deadline: Deadline | None = None,
) -> Certificate:
    """Prove that a trajectory is free for every instant and inside every limit, or say why not.

    Args:
        trajectory: Of all joints of the robot, in its order.
        robot: The arm with its geometry.
        scene: The obstacles.
        margin: Distance to keep from obstacles beyond their own margins [m].
        limits: Limits to hold it to in place of the robot's.
        constraints: What the motion has to hold for every instant, limits of tool speed, torque
            and clearance among them included.
        tool_motions: Lines and arcs that the tool has to keep to.
        deadline: When to give up (which proves nothing).
    """
    wanted = limits or MotionLimits()
    effort = constrained_efforts(wanted.effort, constraints, robot.chain)
    wanted = replace(wanted, effort=effort)
    reports, wrong = check_limits(trajectory, robot.chain.limits, wanted)
    continuity, jumps = check_continuity(trajectory)
    wrong += jumps
    kept, violated = (
        check_motion(constraints, trajectory) if constraints is not None else ((), None)
    )
    wrong += [violated] if violated else []
    deviation = None
    if tool_motions is not None:
        deviation, off = check_tool_motions(robot.chain, trajectory, tool_motions)
        wrong += [off] if off else []
    within = not wrong
    margin = constrained_margin(margin, constraints)
    proof = _Proof(trajectory, robot, scene, margin, deadline)
    proof.run()
    solid = has_solids(robot)
    if not solid and scene.obstacles:
        message = f"{_no_solids(robot)} with {len(scene.obstacles)} obstacle(s)"
        wrong.append(Violation("unproved", 0.0, message, {}))
    wrong += [proof.violation] if proof.violation else []
    free = solid and proof.violation is None
    obstacle, own = proof.clearances
    first = min(wrong, key=lambda violation: violation.time) if wrong else None
    return Certificate(
        verified=first is None,
        min_clearance=min(obstacle, own),
        clearance_pair=proof.closest(OBSTACLE if obstacle <= own else OWN),
        min_obstacle_clearance=obstacle,
        min_self_clearance=own,
        method=METHOD,
        limits=reports,
        continuity=continuity,
        cells=proof.interval_count,
        violation=first,
        path_deviation=deviation,
        path_constraints=kept,
        proved=Proved(within, free, _reasons(wrong, None if solid else _no_solids(robot))),
        obstacle_pair=proof.closest(OBSTACLE),
        self_pair=proof.closest(OWN),
    )


def certify_limits(
    trajectory: Trajectory,
    limits: Limits,
    wanted: MotionLimits,
) -> Certificate:
    """Prove that a trajectory keeps its limits; collisions are not part of the proof.

    Args:
        trajectory: The motion.
        limits: Limits of its joints.
        wanted: Limits in place of them.
    """
    reports, wrong = check_limits(trajectory, limits, wanted)
    if not (np.isfinite(limits.lower) | np.isfinite(limits.upper)).any():
        del reports["position"]
    continuity, jumps = check_continuity(trajectory)
    wrong += jumps
    first = min(wrong, key=lambda violation: violation.time, default=None)
    return Certificate(
        verified=first is None,
        min_clearance=np.inf,
        clearance_pair=None,
        min_obstacle_clearance=np.inf,
        min_self_clearance=np.inf,
        method=LIMITS_METHOD,
        limits=reports,
        continuity=continuity,
        cells=0,
        violation=first,
        proved=Proved(first is None, False, _reasons(wrong, NOTHING_KNOWN)),
    )


def has_solids(robot: RobotGeometry) -> bool:
    """Whether links of the robot itself have solids, not only what it holds."""
    links = {link.name for link in robot.chain.links}
    return any(name in links for name in robot.links)


def _no_solids(robot: RobotGeometry) -> str:
    return f"no solids of robot {robot.chain.name!r} are looked at: {NOTHING_KNOWN}"


def _reasons(wrong: Sequence[Violation], unknown: str | None) -> tuple[str, ...]:
    """Why parts of a proof do not hold: violations, and what nothing is known of."""
    reasons = [violation.message for violation in wrong if violation.kind != "unproved"]
    return tuple([*reasons, unknown] if unknown else reasons)


class _Proof:
    """A sweep of separating directions along a trajectory, FCL the referee of what they leave."""

    def __init__(
        self,
        trajectory: Trajectory,
        robot: RobotGeometry,
        scene: Scene,
        margin: float,
        deadline: Deadline | None,
    ) -> None:
        self._robot, self._scene = robot, scene
        self._trajectory, self._deadline = trajectory, deadline
        self._table = PairTable.of(robot, scene, margin)
        self._sweep = start_sweep(trajectory, self._table.arrays)
        self.violation: Violation | None = None

    @property
    def interval_count(self) -> int:
        """Intervals that were looked at."""
        return int(self._sweep.counters[VISITS])

    @property
    def clearances(self) -> tuple[float, float]:
        """Proved from obstacles and among the robot's own links [m]."""
        return float(self._sweep.clearance[OBSTACLE]), float(self._sweep.clearance[OWN])

    def closest(self, against: int) -> tuple[str, str] | None:
        """The pair with the least clearance, of those with obstacles or of the robot's own."""
        i, j = (int(k) for k in self._sweep.closest[against])
        return self._table.names(i, j) if i >= 0 else None

    def run(self) -> None:
        """Settle every pair on every interval, or find the first violation."""
        if not len(self._table.arrays.roots):
            return
        inside = first_inside(self._robot, self._scene, self._trajectory.start)
        if inside is not None:
            message = f"{inside[0]!r} and {inside[1]!r}: one is inside the other at the start"
            details = {"pair": list(inside), "distance": 0.0, "margin": 0.0, "at": "start"}
            self.violation = Violation("collision", 0.0, message, details)
            return
        while True:
            if self._deadline is not None and self._deadline.passed:
                message = "time was up before the proof was complete"
                self.violation = self.violation or Violation("time", 0.0, message, {})
                return
            state = run(
                self._table.arrays,
                self._trajectory.breaks,
                self._trajectory.coefficients,
                self._sweep,
                self.violation is None,
                _INTERVALS_A_CALL,
            )
            if state == DONE:
                return
            if state == ASKING:
                self._decide_referred()
            if state == FULL:
                self._sweep = enlarge(self._sweep)

    def _decide_referred(self) -> None:
        """Let FCL decide about the pairs referred to it, so that the sweep can go on."""
        sweep, counters = self._sweep, self._sweep.counters
        referred = [(int(i), int(j)) for i, j in sweep.referred[: counters[REFERRED]]]
        left: list[tuple[int, int]] = []
        hit = -1
        for at, (i, j) in enumerate(referred):
            verdict = self._decide(at, i, j)
            if verdict == _HIT:
                left, hit = left + referred[at:], at
                break
            if verdict == _OPEN:
                left.append((i, j))
        if hit >= 0:
            # Nothing later than the middle of this interval is the first violation any more.
            counters[TOP] = 0
            if self._is_final(hit):
                return
        still_open = int(counters[OPEN])
        if not (left or still_open):
            return
        end = int(sweep.starts[counters[DEPTH] + 1]) + still_open
        sweep.pairs[end : end + len(left)] = np.array(left, dtype=np.int64).reshape(-1, 2)
        sweep.directions[end : end + len(left)] = 0.0
        counters[OPEN] = still_open + len(left)
        push_halves(sweep, self._trajectory.breaks, hit < 0)

    def _decide(self, at: int, i: int, j: int) -> int:
        """FCL's decision on a referred pair: free all over the interval, open, or a violation."""
        sweep, arrays = self._sweep, self._table.arrays
        against = OWN if i < arrays.moving else OBSTACLE
        apart = 0.0 if against == OWN else float(arrays.margins[i]) + arrays.margin
        distance = convex_distance(
            self._table.solid(i), self._pose(i), self._table.solid(j), self._pose(j)
        )
        lower = distance - float(sweep.referred_moves[at]) - ACCURACY
        final = self._is_final(at)
        if lower > apart and (final or lower >= sharp_enough(sweep.nearest[against], True)):
            note_clearance(sweep, against, i, j, lower)
            return _FREE
        if distance > apart and not final:
            return _OPEN
        self._note_violation(at, (i, j), distance, apart)
        return _HIT

    def _pose(self, k: int) -> Array:
        """Pose of element k in the middle of the interval, by the joints' frames alone."""
        joint, T = int(self._table.arrays.joints[k]), self._table.arrays.poses[k]
        return np.asarray(self._sweep.frames[joint] @ T) if joint >= 0 else T

    def _is_final(self, at: int) -> bool:
        """Whether halving the interval any further is of no use to a referred pair."""
        sweep = self._sweep
        return bool(sweep.referred_moves[at] < RESOLUTION or sweep.counters[DEPTH] == MAX_DEPTH)

    def _note_violation(
        self, at: int, pair: tuple[int, int], distance: float, apart: float
    ) -> None:
        """Note a violation in the middle of the interval; the sweep goes on with earlier ones."""
        sweep, trajectory = self._sweep, self._trajectory
        i, j = pair
        whole = sweep.counters[FIRST] < sweep.counters[LAST]
        begins = 0.0 if whole else float(trajectory.breaks[sweep.counters[FIRST]])
        time = min(begins + float(sweep.interval[CENTER]), trajectory.duration)
        against = OWN if i < self._table.arrays.moving else OBSTACLE
        note_clearance(sweep, against, i, j, distance)
        names = self._table.names(i, j)
        asked = f", {apart:.6g} m are asked for" if apart > 0.0 else ""
        message = f"{names[0]!r} and {names[1]!r} are {distance:.6g} m apart{asked}"
        details = {"pair": list(names), "distance": distance, "margin": apart}
        q = sweep.joints[:, VALUE]
        for where, end in (("start", trajectory.start), ("goal", trajectory.end)):
            if np.abs(q - end).max() <= _AT_AN_END:
                message, details["at"] = f"{message} at the {where}", where
                break
        decided = distance <= apart or sweep.referred_moves[at] < RESOLUTION
        kind = "collision" if decided else "undecided"
        self.violation = Violation(kind, time, message, details)
