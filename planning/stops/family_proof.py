"""Proof that no member of a family of stops touches anything or leaves the joints' ranges.

Cells of the two times are settled by the proof's own check of an interval
(``proof.collision.interval_check``), on exact geometry: it is given all joints of a cell as a
motion with what members of the family may be off it. Cells that are not settled are halved, along
the time that moves the joints more; a pair that is nearer than its margin in the middle of a cell
is the end of the proof.
"""

from typing import NamedTuple

import numpy as np

from compiled.kernel import directly
from kinematics.arrays import Array, Indices
from obstacles.distance.signed_distance import convex_distance
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.scenes.scene import Scene
from planning.proof.collision.pair_table import PairTable
from planning.proof.collision.sweep_state import (
    DEPTH,
    HALF,
    OBSTACLE,
    OWN,
    REFERRED,
    SHARP,
    Sweep,
    enlarge,
    start_kernel,
)
from planning.proof.motion_bounds import (
    BOW_ROUNDING,
    JOINT_COLUMNS,
    RADIUS,
    RATE,
    ROUNDING,
    SPEED,
    VALUE,
)
from planning.stops.cell_check import (
    ASKING,
    CROWDED,
    DONE,
    FULL,
    LOOKED_AT,
    NEAREST,
    NEXT,
    CellRows,
    check_cells,
)
from planning.stops.stop_family import Cells, Enclosed, StopFamily
from planning.values.deadline import Deadline
from planning.values.limits import RATIO_TOLERANCE

#: Parts of the motion to begin with are no longer than this [s].
_FIRST_PART = 0.05
#: Halvings after which what is open is not proved: a cell is then a millionth of a second.
_MAX_HALVINGS = 30
#: Cells between two looks at the clock.
_CELLS_A_CALL = 512
#: Cells looked at after which the proof is given up.
_MAX_CELLS = 400_000


class Worst(NamedTuple):
    """The stop that comes nearest to something, or the first found that is not free.

    Args:
        time: Instant of the motion at which braking begins [s].
        after: Time since then [s].
        pair: The two bodies; the joint twice where its range is left; None where nothing was met.
        clearance: Distance of the two, a lower bound where it is proved [m]; for a joint how far it
            is within its range, negative outside [rad or m].
    """

    time: float
    after: float
    pair: tuple[str, str] | None
    clearance: float


class FamilyProof(NamedTuple):
    """Result of the proof.

    Args:
        proved: Whether all members of the family are free and within the joints' ranges.
        worst: The nearest stop, or the one at fault.
        message: Sentence on the fault, "" where there is none.
        cells: Cells looked at.
        late: Whether time was up.
    """

    proved: bool
    worst: Worst
    message: str = ""
    cells: int = 0
    late: bool = False


def prove_family(
    family: StopFamily,
    robot: RobotGeometry,
    scene: Scene,
    margin: float,
    deadline: Deadline | None = None,
    *,
    sharp: bool = True,
) -> FamilyProof:
    """Prove all stops of a motion, which is itself proved, so that nothing is inside anything.

    Args:
        family: The stops.
        robot: The arm with its geometry.
        scene: The obstacles.
        margin: Distance to keep from obstacles beyond their own margins [m].
        deadline: Instant at which the proof is given up.
        sharp: Whether cells are halved until the clearance told is sharp, not only until all is
            free.
    """
    outside = _outside(family, robot)
    if outside is not None:
        return outside
    opened: frozenset[int] | None = frozenset()
    while True:
        sweep = _FamilySweep(family, PairTable.of(robot, scene, margin, opened), deadline, sharp)
        more = sweep.run()
        if sweep.found is not None:
            return sweep.found
        # Covers of meshes that come so near that their triangles have to be looked at.
        opened = None if opened is None or len(opened) > _MOST_COVERS else opened | more


#: Covers opened one by one, before all are.
_MOST_COVERS = 8


class _FamilySweep:
    """Sweep over the cells of a family with some covers of meshes opened.

    Args:
        family: The stops.
        table: The pairs.
        deadline: Instant at which the proof is given up.
        sharp: Sharpness as in ``prove_family``.
    """

    def __init__(
        self, family: StopFamily, table: PairTable, deadline: Deadline | None, sharp: bool
    ) -> None:
        self._family, self._table, self._deadline = family, table, deadline
        self.found: FamilyProof | None = None
        self._looked_at = 0
        self._nearest = Worst(0.0, 0.0, None, np.inf)
        arrays = table.arrays
        motion = family.trajectory
        sizes = arrays.bodies.shape[1], arrays.joints.shape[0], arrays.moving
        self._sweep: Sweep = start_kernel(motion.breaks, motion.coefficients, arrays.roots, sizes)
        self._sweep.counters[DEPTH], self._sweep.counters[SHARP] = 0, int(sharp)
        self._sweep.interval[HALF] = 1.0

    def run(self) -> frozenset[int]:
        """Settle all cells, or find one that is not free; else the covers to be opened first."""
        roots = self._table.arrays.roots
        cells = self._family.cells(_FIRST_PART)
        if not len(roots):
            self.found = FamilyProof(True, self._nearest)
            return frozenset()
        b = len(cells.piece)
        pairs, directions = np.tile(roots, (b, 1)), np.zeros((b * len(roots), 3))
        starts = np.arange(b + 1) * len(roots)
        for _ in range(_MAX_HALVINGS):
            enclosed = self._family.enclose(cells)
            rows = CellRows.of(self._columns(enclosed), pairs, directions, starts)
            more, rows = self._level(cells, rows)
            if more or self.found is not None:
                return more
            counts = np.diff(rows.kept_starts)
            left, size = np.flatnonzero(counts), int(rows.kept_starts[-1])
            if not len(left):
                self.found = FamilyProof(True, self._nearest, "", self._looked_at)
                return frozenset()
            by_begin = enclosed.moves[left, 0] >= enclosed.moves[left, 1]
            cells = cells.chosen(left).halves(by_begin)
            pairs = np.concatenate([rows.kept[:size], rows.kept[:size]])
            directions = np.concatenate([rows.kept_directions[:size], rows.kept_directions[:size]])
            starts = np.concatenate([[0], np.cumsum(np.tile(counts[left], 2))])
        self._give_up(cells, pairs)
        return frozenset()

    def _columns(self, enclosed: Enclosed) -> Array:
        """Joints of cells as the proof encloses them: a motion by the rate, and what is off it."""
        columns = np.zeros((*enclosed.middle.shape, JOINT_COLUMNS))
        columns[..., VALUE], columns[..., RADIUS] = enclosed.middle, enclosed.radius
        columns[..., RATE], columns[..., SPEED] = enclosed.rate, np.abs(enclosed.rate)
        columns[..., ROUNDING] = columns[..., BOW_ROUNDING] = enclosed.off
        return columns

    def _level(self, cells: Cells, rows: CellRows) -> tuple[frozenset[int], CellRows]:
        """Look at cells; covers to be opened first, and the cells with what stays open."""
        times, after = self._family.time(cells), cells.after[:, 0]
        state = DONE
        while rows.progress[NEXT] < len(times) or state != DONE:
            before = int(rows.progress[LOOKED_AT])
            if self._is_over(float(times[min(rows.progress[NEXT], len(times) - 1)])):
                return frozenset(), rows
            state = directly(check_cells, self._table.arrays, self._sweep, rows, _CELLS_A_CALL)
            self._looked_at += int(rows.progress[LOOKED_AT]) - before
            if state == FULL:
                self._sweep = enlarge(self._sweep)
            elif state == CROWDED:
                rows = rows.enlarged()
            nearest, last = int(rows.progress[NEAREST]), int(rows.progress[NEXT]) - 1
            if nearest >= 0:
                self._note_nearest(float(times[nearest]), float(after[nearest]))
            if state == ASKING:
                more = self._judge_referred(float(times[last]), float(after[last]))
                state = DONE
                if more or self.found is not None:
                    return more, rows
        return frozenset(), rows

    def _judge_referred(self, time: float, after: float) -> frozenset[int]:
        """Measure pairs that are nearer than their margin in the middle of the last cell."""
        sweep, arrays, table = self._sweep, self._table.arrays, self._table
        for i, j in sweep.referred[: sweep.counters[REFERRED]].tolist():
            closed = {table.closed_cover(i), table.closed_cover(j)} - {None}
            if closed:
                return frozenset(row for row in closed if row is not None)
            apart = 0.0 if i < arrays.moving else float(arrays.margins[i]) + arrays.margin
            distance = convex_distance(table.solid(i), self._pose(i), table.solid(j), self._pose(j))
            if distance <= apart:
                self._note_fault(time, after, (i, j), distance, apart)
                return frozenset()
        return frozenset()

    def _pose(self, k: int) -> Array:
        """Pose of element k in the middle of the last cell."""
        joint, T = int(self._table.arrays.joints[k]), self._table.arrays.poses[k]
        return np.asarray(self._sweep.frames[joint] @ T) if joint >= 0 else T

    def _note_nearest(self, time: float, after: float) -> None:
        """Note where the proved clearance is least."""
        sweep = self._sweep
        against = OBSTACLE if sweep.clearance[OBSTACLE] <= sweep.clearance[OWN] else OWN
        least = float(sweep.clearance[against])
        if least < self._nearest.clearance:
            i, j = sweep.closest[against].tolist()
            self._nearest = Worst(time, after, self._table.names(i, j), least)

    def _note_fault(
        self, time: float, after: float, pair: tuple[int, int], distance: float, apart: float
    ) -> None:
        names = self._table.names(*pair)
        far = f"overlap by {-distance:.6g} m" if distance < 0.0 else f"are {distance:.6g} m apart"
        message = (
            f"with all joints braking from {time:.6g} s on {names[0]!r} and {names[1]!r} {far} "
            f"after {after:.3g} s"
        )
        message += f", {apart:.6g} m are asked for" if apart > 0.0 else ""
        worst = Worst(time, after, names, distance)
        self.found = FamilyProof(False, worst, message, self._looked_at)

    def _is_over(self, time: float) -> bool:
        """Whether time or cells are used up, which proves nothing."""
        late = self._deadline is not None and self._deadline.passed
        if not late and self._looked_at < _MAX_CELLS:
            return False
        message = "time was up before all stops were proved"
        message = message if late else f"{_MAX_CELLS} cells did not settle the stops"
        worst = self._nearest._replace(time=time)
        self.found = FamilyProof(False, worst, message, self._looked_at, late)
        return True

    def _give_up(self, cells: Cells, pairs: Indices) -> None:
        """Note the first pair that halving does not settle: it keeps its margin to rounding."""
        i, j = pairs[0].tolist()
        time, names = float(self._family.time(cells)[0]), self._table.names(i, j)
        message = f"{names[0]!r} and {names[1]!r} keep their margin to rounding at best"
        self.found = FamilyProof(
            False, Worst(time, float(cells.after[0, 0]), names, 0.0), message, self._looked_at
        )


def _outside(family: StopFamily, robot: RobotGeometry) -> FamilyProof | None:
    """The first stop found that takes a joint out of its range; None where none does."""
    limits, names = robot.chain.limits, robot.chain.joint_names
    lower, upper = limits.lower - RATIO_TOLERANCE, limits.upper + RATIO_TOLERANCE
    cells = family.cells(_FIRST_PART)
    cells = cells._replace(after=np.zeros_like(cells.after))
    looked_at = 0
    while len(cells.piece):
        looked_at += len(cells.piece)
        low, high = family.farthest(cells)
        out = ((low < lower) | (high > upper)).any(axis=1)
        cells = cells.chosen(np.flatnonzero(out))
        if not len(cells.piece):
            return None
        still = cells._replace(begin=cells.begin * [1.0, 0.0])
        low, high = family.farthest(still)
        # Joints without a range have room.
        room = np.nan_to_num(np.minimum(low - lower, upper - high), nan=np.inf)
        k, j = np.unravel_index(int(np.argmin(room)), room.shape)
        surely = room[k, j] < -_ROUNDED_ROOM
        if surely or looked_at > _MAX_RANGE_CELLS:
            time, name = float(family.time(cells)[k]), names[j]
            what = "takes" if surely else "may take"
            excess = max(-float(room[k, j]), 0.0)
            message = (
                f"braking all joints from {time:.6g} s on {what} {name!r} out of its range"
                + (f" by {excess:.6g}" if surely else "")
            )
            after = float(family.durations(still)[k])
            worst = Worst(time, after, (name, name), float(room[k, j]))
            return FamilyProof(False, worst, message, looked_at)
        cells = cells.halves(np.ones(len(cells.piece), dtype=np.bool_))
    return None


#: What the enclosure of a single instant is wide by [rad or m].
_ROUNDED_ROOM = 1e-10
#: Cells of the begins alone, all joints at once, after which a range is taken as left.
_MAX_RANGE_CELLS = 50_000
