"""The proof that a timed trajectory is free for every instant and inside every limit.

It knows nothing of how the trajectory came about and shares no verdict with the planners. It walks
the polynomials themselves, cell of time by cell of time: where some direction parts a pair in the
middle of a cell by more than its margin and more than it can move in the cell, it is free all over
the cell, with at least the difference to spare; others are looked at again on the halves. Whoever
proposed the direction, it is checked here, on the exact geometry (``planning.walk``,
``planning.witness``, ``planning.cells``). What no direction settles, since it touches or nearly so,
FCL decides. What the limits ask is decided by the exact extrema of the polynomials.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from kinematics.chain import Array, Limits
from kinematics.trajectory import Trajectory
from obstacles.robot_geometry import RobotGeometry
from obstacles.scene import Scene
from obstacles.world import ACCURACY, World
from planning.cells import VALUE
from planning.constraint_check import ConstraintReport, check_motion
from planning.constraints.constraint_set import ConstraintSet
from planning.deadline import Deadline
from planning.limit_check import (
    RATIO_TOLERANCE,
    LimitReport,
    Violation,
    check_continuity,
    check_limits,
)
from planning.pair_table import PairTable
from planning.timing.loads import Loads
from planning.tool_deviation import PathDeviation
from planning.walk import (
    ASKED,
    ASKING,
    DEPTH,
    DONE,
    FIRST,
    KEPT,
    LAST,
    MAX_DEPTH,
    OBSTACLE,
    OWN,
    RESOLUTION,
    TOP,
    VISITS,
    go_on,
    halve,
    settle,
    sharp_enough,
    walk_along,
)

__all__ = [
    "RATIO_TOLERANCE",
    "Certificate",
    "LimitReport",
    "Violation",
    "certify",
    "certify_limits",
]

#: A violation this near to the start or the goal, in every joint, is told as theirs [rad or m].
_AT_AN_END = 1e-6
#: What the referee says of a pair.
_FREE, _OPEN, _HIT = 0, 1, 2
#: Cells between two looks at the clock: a few milliseconds.
_CELLS_A_CALL = 1000


@dataclass(frozen=True, slots=True)
class Certificate:
    """What was proved about a trajectory.

    Args:
        verified: Free for every instant and inside every limit.
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
LIMITS_METHOD = "exact extrema of polynomials; nothing is known of collisions"


def certify(
    trajectory: Trajectory,
    robot: RobotGeometry,
    scene: Scene,
    *,
    margin: float = 0.0,
    limits: Mapping[str, Array] | None = None,
    loads: Loads | None = None,
    constraints: ConstraintSet | None = None,
    deadline: Deadline | None = None,
) -> Certificate:
    """Prove that a trajectory is free for every instant and inside every limit, or say why not.

    Args:
        trajectory: Of all joints of the robot, in its order.
        robot: The arm with its geometry.
        scene: The obstacles.
        margin: Distance to keep from obstacles beyond their own margins [m].
        limits: Limits (n,) to hold it to, by quantity ("velocity", ...); what is not named is
            taken from the robot, NaN and infinity bind nothing.
        loads: Limits of torque and tool speed.
        constraints: What the motion has to hold for every instant.
        deadline: When to give up (which proves nothing).
    """
    reports, wrong = check_limits(trajectory, robot.chain.limits, dict(limits or {}), loads)
    continuity, jumps = check_continuity(trajectory)
    wrong += jumps
    kept, violated = (
        check_motion(constraints, trajectory) if constraints is not None else ((), None)
    )
    wrong += [violated] if violated else []
    proof = _Proof(trajectory, robot, scene, margin, deadline)
    proof.run()
    wrong += [proof.violation] if proof.violation else []
    obstacle, own = proof.clearances
    first = min(wrong, key=lambda violation: violation.time) if wrong else None
    return Certificate(
        verified=first is None,
        min_clearance=min(obstacle, own),
        clearance_pair=proof.closest,
        min_obstacle_clearance=obstacle,
        min_self_clearance=own,
        method=METHOD,
        limits=reports,
        continuity=continuity,
        cells=proof.visited,
        violation=first,
        path_constraints=kept,
    )


def certify_limits(
    trajectory: Trajectory,
    limits: Limits,
    bounds: Mapping[str, Array],
    loads: Loads | None = None,
) -> Certificate:
    """Prove that a trajectory keeps its limits, of collisions nothing is said.

    Args:
        trajectory: The motion.
        limits: Of its joints.
        bounds: In place of them, by quantity, as in ``certify``.
        loads: Limits of torque and tool speed.
    """
    reports, wrong = check_limits(trajectory, limits, bounds, loads)
    if not (np.isfinite(limits.lower) | np.isfinite(limits.upper)).any():
        del reports["position"]
    continuity, jumps = check_continuity(trajectory)
    first = min(wrong + jumps, key=lambda violation: violation.time, default=None)
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
    )


class _Proof:
    """A walk of witnesses along a trajectory, with FCL as the referee of what they leave."""

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
        self._walk = walk_along(trajectory, self._table.arrays)
        self.violation: Violation | None = None

    @cached_property
    def _world(self) -> World:
        return World(self._robot, self._scene)

    @property
    def visited(self) -> int:
        """Cells that were looked at."""
        return int(self._walk.counters[VISITS])

    @property
    def clearances(self) -> tuple[float, float]:
        """Proved from obstacles and among the robot's own [m]."""
        return float(self._walk.clearance[OBSTACLE]), float(self._walk.clearance[OWN])

    @property
    def closest(self) -> tuple[str, str] | None:
        """The pair that the smaller of them belongs to."""
        pair = int(self._walk.closest[np.argmin(self._walk.clearance)])
        return self._table.pair_names(pair) if pair >= 0 else None

    def run(self) -> None:
        """Settle every pair on every cell, or find the first violation."""
        if not len(self._table.arrays.pairs):
            return
        while True:
            if self._deadline is not None and self._deadline.passed:
                message = "time was up before the proof was complete"
                self.violation = self.violation or Violation("time", 0.0, message, {})
                return
            state = go_on(
                self._table.arrays, self._trajectory.breaks, self._trajectory.coefficients,
                self._walk, self.violation is None, _CELLS_A_CALL,
            )  # fmt: skip
            if state == DONE:
                return
            if state == ASKING:
                self._referee()

    def _referee(self) -> None:
        """Let FCL decide about the pairs asked about, so that the walk can go on."""
        walk, counters = self._walk, self._walk.counters
        self._world.place_frames(walk.frames)
        asked = [int(pair) for pair in walk.asked[: counters[ASKED]]]
        left: list[int] = []
        hit = -1
        for at, pair in enumerate(asked):
            verdict = self._judged(pair)
            if verdict == _HIT:
                left, hit = left + asked[at:], pair
                break
            if verdict == _OPEN:
                left.append(pair)
        if hit >= 0:
            # Nothing later than the middle of this cell is the first violation any more.
            counters[TOP] = 0
            if self._last_word(hit):
                return
        depth, kept = int(counters[DEPTH]), int(counters[KEPT])
        if not (left or kept):
            return
        walk.active[depth + 1, kept : kept + len(left)] = left
        counters[KEPT] = kept + len(left)
        halve(walk, self._trajectory.breaks, hit < 0)

    def _judged(self, pair: int) -> int:
        """What FCL says of a pair: free all over the cell, open, or a violation."""
        walk, arrays = self._walk, self._table.arrays
        i, j = (int(k) for k in arrays.pairs[pair])
        apart, own = float(arrays.margins[pair]), int(arrays.own[pair])
        distance = self._world.between(i, j)
        lower = distance - float(walk.bounds[pair]) - ACCURACY
        last_word = self._last_word(pair)
        if lower > apart and (last_word or lower >= sharp_enough(walk, own)):
            settle(walk, own, pair, lower)
            return _FREE
        if distance > apart and not last_word:
            return _OPEN
        self._violate(pair, distance, apart)
        return _HIT

    def _last_word(self, pair: int) -> bool:
        """Whether the cell can't be halved any more to the good of a pair."""
        walk = self._walk
        return bool(walk.bounds[pair] < RESOLUTION or walk.counters[DEPTH] == MAX_DEPTH)

    def _violate(self, pair: int, distance: float, apart: float) -> None:
        """Note a violation in the middle of the cell; the walk goes from late to early ones."""
        walk, trajectory = self._walk, self._trajectory
        whole = walk.counters[FIRST] < walk.counters[LAST]
        begins = 0.0 if whole else float(trajectory.breaks[walk.counters[FIRST]])
        time = min(begins + float(walk.cell[1]), trajectory.duration)
        settle(walk, int(self._table.arrays.own[pair]), pair, distance)
        names = self._table.pair_names(pair)
        asked = f", {apart:.6g} m are asked for" if apart > 0.0 else ""
        message = f"{names[0]!r} and {names[1]!r} are {distance:.6g} m apart{asked}"
        details = {"pair": list(names), "distance": distance, "margin": apart}
        q = walk.joints[:, VALUE]
        for where, end in (("start", trajectory.start), ("goal", trajectory.end)):
            if np.abs(q - end).max() <= _AT_AN_END:
                message, details["at"] = f"{message} at the {where}", where
                break
        decided = distance <= apart or walk.bounds[pair] < RESOLUTION
        kind = "collision" if decided else "undecided"
        self.violation = Violation(kind, time, message, details)
