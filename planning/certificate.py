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

import numpy as np

from kinematics.chain import Array, Limits
from kinematics.trajectory import Trajectory
from obstacles.robot_geometry import RobotGeometry
from obstacles.scene import Scene
from obstacles.world import ACCURACY, World
from planning.cells import Cells, PairTable, Placed, first_cells, halves, settle_by_bounds
from planning.deadline import Deadline
from planning.limit_check import (
    RATIO_TOLERANCE,
    LimitReport,
    Violation,
    check_continuity,
    check_limits,
)
from planning.timing.loads import Loads

__all__ = [
    "RATIO_TOLERANCE",
    "Certificate",
    "LimitReport",
    "Violation",
    "certify",
    "certify_limits",
]

#: The clearance told is at least this share of the true one, where that is less than _ENOUGH [m].
_SHARP = 0.8
_ENOUGH = 0.05
#: Distances looked at to learn how small the least clearance is about.
_PROBES = 24
#: A cell in which everything moves less than this [m] is decided by its distance alone.
_RESOLUTION = 1e-7


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
LIMITS_METHOD = "exact extrema of polynomials; nothing is known of collisions"


def certify(
    trajectory: Trajectory,
    robot: RobotGeometry,
    scene: Scene,
    *,
    margin: float = 0.0,
    limits: Mapping[str, Array] | None = None,
    loads: Loads | None = None,
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
        deadline: When to give up (which proves nothing).
    """
    reports, wrong = check_limits(trajectory, robot.chain.limits, dict(limits or {}), loads)
    continuity, jumps = check_continuity(trajectory)
    wrong += jumps
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
        method=LIMITS_METHOD,
        limits=reports,
        continuity=continuity,
        cells=0,
        violation=first,
    )


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
