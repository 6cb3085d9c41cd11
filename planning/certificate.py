"""The proof that a timed trajectory is free for every instant and inside every limit.

It knows nothing of how the trajectory came about and shares no verdict with the planners: it
walks the polynomials themselves and asks FCL for the distances of the exact geometry.

On a cell of time [t - h, t + h], joint j strays from its value at t by at most
delta_j = sum_i |c_ij| h^i with c_ij the polynomial's coefficients about t; a point at distance
rho_j from axis j then moves by at most the B of B <- B + (rho_j + B) delta_j. Where a pair's
distance at t exceeds its margin and B, it is free all over the cell, with at least the difference
to spare; other pairs are looked at again on the halves. What the limits ask is decided by the exact
extrema of the polynomials.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from kinematics.chain import Array, Chain
from kinematics.trajectory import Trajectory
from obstacles.robot_geometry import RobotGeometry
from obstacles.scene import Scene
from obstacles.world import ACCURACY, World
from planning.cells import Cells, PairTable, Placed, first_cells, halves, settle_by_bounds
from planning.deadline import Deadline

#: Ratios may exceed 1 by what the last digits of an extremum are worth.
RATIO_TOLERANCE = 1e-9
#: Largest jump of position and velocity between pieces [rad or m, rad/s or m/s].
JUMP_TOLERANCE = 1e-9
#: Jump of acceleration beyond which jerk is not bounded and none is reported [rad/s^2].
_JERK_JUMP = 1e-6
#: The clearance told is at least this share of the true one, where that is less than _ENOUGH [m].
_SHARP = 0.8
_ENOUGH = 0.05
#: Distances looked at to learn how small the least clearance is about.
_PROBES = 24
#: A cell in which everything moves less than this [m] is decided by its distance alone.
_RESOLUTION = 1e-7


@dataclass(frozen=True, slots=True)
class LimitReport:
    """How much of one kind of limit is used.

    Args:
        worst_ratio: Largest |value| / limit of all joints; for positions, of the distance from
            the middle of the range to half the range.
        joint: Where.
        time: When [s].
    """

    worst_ratio: float
    joint: str
    time: float


@dataclass(frozen=True, slots=True)
class Violation:
    """The first thing that is wrong with a trajectory.

    Args:
        kind: "collision", "undecided", "position", "velocity", "acceleration", "jerk",
            "continuity", "start", "goal" or "time".
        time: When it happens [s].
        message: One sentence.
        details: Values a program can use.
    """

    kind: str
    time: float
    message: str
    details: Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class Certificate:
    """What was proved about a trajectory.

    Args:
        verified: Free for every instant and inside every limit.
        min_clearance: Holds for every t, margins not taken off [m]; infinite where nothing can
            collide, the distance found where something does.
        clearance_pair: The pair with the least clearance.
        method: How it was proved.
        limits: By quantity.
        continuity: Largest jumps of position and velocity.
        cells: Intervals of time that were looked at.
        violation: The first thing that is wrong; None where it is verified.
    """

    verified: bool
    min_clearance: float
    clearance_pair: tuple[str, str] | None
    method: str
    limits: Mapping[str, LimitReport]
    continuity: Mapping[str, float]
    cells: int
    violation: Violation | None = None


METHOD = (
    "continuous: FCL distances and motion bounds on cells of time, exact extrema of polynomials"
)


def certify(
    trajectory: Trajectory,
    robot: RobotGeometry,
    scene: Scene,
    *,
    margin: float = 0.0,
    limits: Mapping[str, Array] | None = None,
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
        deadline: When to give up (which proves nothing).
    """
    chain = robot.chain
    bounds = {name: np.asarray(values) for name, values in (limits or {}).items()}
    reports, wrong = _check_limits(trajectory, chain, bounds)
    jumps = trajectory.continuity()
    continuity = {"position": jumps.position, "velocity": jumps.velocity}
    for name, jump in continuity.items():
        if jump > JUMP_TOLERANCE:
            jumps_at = np.abs(trajectory.jumps(0 if name == "position" else 1)).max(axis=1)
            at = int(np.argmax(jumps_at > JUMP_TOLERANCE))
            message = f"the {name} jumps by {jump:.3g} between two pieces"
            time = float(trajectory.breaks[at + 1])
            wrong.append(Violation("continuity", time, message, {"quantity": name, "jump": jump}))
    proof = _Sweep(trajectory, robot, scene, margin, deadline)
    proof.run()
    wrong += [proof.violation] if proof.violation else []
    first = min(wrong, key=lambda violation: violation.time) if wrong else None
    return Certificate(
        verified=first is None,
        min_clearance=proof.clearance,
        clearance_pair=proof.pair,
        method=METHOD,
        limits=reports,
        continuity=continuity,
        cells=proof.visited,
        violation=first,
    )


def _check_limits(
    trajectory: Trajectory, chain: Chain, bounds: Mapping[str, Array]
) -> tuple[dict[str, LimitReport], list[Violation]]:
    reports, wrong = {}, []
    reports["position"], violation = _check_position(trajectory, chain)
    wrong += [violation] if violation else []
    for order, name in ((1, "velocity"), (2, "acceleration"), (3, "jerk")):
        limit = bounds.get(name, getattr(chain.limits, name))
        bound = np.isfinite(limit)
        if not bound.any() or (order == 3 and trajectory.continuity().acceleration > _JERK_JUMP):
            continue
        peaks = trajectory.peaks(order)
        ratios = np.where(bound, peaks.value / np.where(bound, limit, 1.0), 0.0)
        j = int(np.argmax(ratios))
        report = LimitReport(float(ratios[j]), chain.joint_names[j], float(peaks.time[j]))
        reports[name] = report
        if report.worst_ratio > 1.0 + RATIO_TOLERANCE:
            message = (
                f"joint {report.joint!r} has {name} {peaks.value[j]:.6g}, its limit is "
                f"{limit[j]:.6g}"
            )
            details = {"joint": report.joint, "value": float(peaks.value[j]), "limit": limit[j]}
            wrong.append(Violation(name, report.time, message, details))
    return reports, wrong


def _check_position(trajectory: Trajectory, chain: Chain) -> tuple[LimitReport, Violation | None]:
    lower, upper = chain.limits.lower, chain.limits.upper
    low, low_time, high, high_time = trajectory.extrema(0)
    half = 0.5 * (upper - lower)
    bound = np.isfinite(half) & (half > 0.0)
    middle = np.where(bound, 0.5 * (upper + lower), 0.0)
    half = np.where(bound, half, np.inf)
    ratios = np.maximum(high - middle, middle - low) / half
    j = int(np.argmax(ratios))
    is_high = high[j] - middle[j] >= middle[j] - low[j]
    report = LimitReport(
        float(ratios[j]), chain.joint_names[j], float(high_time[j] if is_high else low_time[j])
    )
    outside = np.maximum(lower - low, high - upper)
    k = int(np.argmax(outside))
    if outside[k] <= RATIO_TOLERANCE:
        return report, None
    over = high[k] - upper[k] >= lower[k] - low[k]
    value, limit = (high[k], upper[k]) if over else (low[k], lower[k])
    time = float(high_time[k] if over else low_time[k])
    name = chain.joint_names[k]
    message = f"joint {name!r} is at {value:.6g}, its limit is {limit:.6g}"
    details = {"joint": name, "value": float(value), "limit": float(limit)}
    return report, Violation("position", time, message, details)


class _Sweep:
    """Cells of time, halved until every pair is settled on every one of them."""

    def __init__(
        self,
        trajectory: Trajectory,
        robot: RobotGeometry,
        scene: Scene,
        margin: float,
        deadline: Deadline | None,
    ) -> None:
        self._world = World(robot, scene)
        self._table = PairTable.of(self._world, margin)
        self._trajectory = trajectory
        self._deadline = deadline
        self._nearest = np.inf
        self._stopped = False
        self.clearance = np.inf
        self.pair: tuple[str, str] | None = None
        self.violation: Violation | None = None
        self.visited = 0

    def run(self) -> None:
        """Settle every pair on every cell, or find the first violation."""
        if not len(self._table.pairs):
            return
        cells = first_cells(self._trajectory, len(self._table.pairs))
        while len(cells):
            self.visited += len(cells)
            cells = self._level(cells)
            if self._stopped or (len(cells) and self._late()):
                message = "time was up before the proof was complete"
                self.violation = self.violation or Violation("time", 0.0, message, {})
                return

    def _late(self) -> bool:
        return self._deadline is not None and self._deadline.passed

    def _level(self, cells: Cells) -> Cells:
        """Settle what can be settled on these cells; the halves of what is left."""
        placed = settle_by_bounds(self._trajectory, self._table, cells, self._enough)
        self._lower(placed.clearance, placed.closest)
        if np.isinf(self._nearest):
            self._probe(placed)
        lowers, margins = placed.open_lowers, self._table.margins[placed.open_pairs]
        far = (lowers > margins) & (lowers >= self._enough)
        if far.any():
            least = int(np.argmin(np.where(far, lowers, np.inf)))
            self._lower(float(lowers[least]), int(placed.open_pairs[least]))
        left: list[tuple[int, int]] = []
        last = -1
        for entry in np.flatnonzero(~far):
            cell, pair = int(placed.open_cells[entry]), int(placed.open_pairs[entry])
            if self.violation and cells.low[cell] > self.violation.time:
                break
            if cell != last:
                self._stopped = self._late()
                if self._stopped:
                    break
                self._world.place_frames(placed.frames[cell])
                last = cell
            if not self._settled(float(placed.times[cell]), pair, float(placed.open_bounds[entry])):
                left.append((cell, pair))
        return halves(cells, left)

    @property
    def _enough(self) -> float:
        """Clearance beyond which a sharper bound would tell nothing [m]."""
        return min(_ENOUGH, _SHARP * self._nearest)

    def _probe(self, placed: Placed) -> None:
        """Learn from a few promising distances how small the least clearance is about."""
        for entry in np.argsort(placed.open_lowers, kind="stable")[:_PROBES]:
            self._world.place_frames(placed.frames[placed.open_cells[entry]])
            pair = int(placed.open_pairs[entry])
            distance = self._world.distance(pair) + float(self._world.margins[pair])
            self._nearest = min(self._nearest, distance)

    def _settled(self, time: float, pair: int, bound: float) -> bool:
        apart, own = float(self._table.margins[pair]), float(self._world.margins[pair])
        by_plane = self._world.distance_by_plane(pair) + own - bound
        if by_plane > apart + ACCURACY and by_plane >= self._enough:
            return self._lower(by_plane, pair)
        distance = self._world.distance(pair) + own
        self._nearest = min(self._nearest, distance)
        if distance <= apart or (bound < _RESOLUTION and distance - bound - ACCURACY <= apart):
            self._found(time, pair, distance, apart)
            return True
        lower = distance - bound - ACCURACY
        if lower <= apart or lower < self._enough:
            return lower > apart and bound < _RESOLUTION and self._lower(lower, pair)
        return self._lower(lower, pair)

    def _lower(self, clearance: float, pair: int) -> bool:
        if clearance < self.clearance:
            self.clearance = clearance
            self.pair = self._world.pair_names(pair)
        return True

    def _found(self, time: float, pair: int, distance: float, apart: float) -> None:
        names = self._world.pair_names(pair)
        self._lower(distance, pair)
        if self.violation is None or time < self.violation.time:
            asked = f", {apart:.6g} m are asked for" if apart > 0.0 else ""
            message = f"{names[0]!r} and {names[1]!r} are {distance:.6g} m apart{asked}"
            details = {"pair": list(names), "distance": distance, "margin": apart}
            self.violation = Violation("collision", time, message, details)
