"""Proof that nothing touches for every instant of a trajectory, or its first collision.

A sweep of separating directions (``sweep``) settles pair after pair; FCL decides what no direction
settles, since it touches or nearly so. Meshes that are not convex are swept as the solids that
cover them first: where these stay apart, so does all that they hold, and no triangle is looked at.

Of pairs that may touch it is proved how deep they overlap at most, by a sweep of the same kind:
along a direction, the overlap of two convex solids is less their gap, so what bounds gaps over an
interval bounds depths (``interval_check.check_overlaps``). Bodies of several convex pieces, covers
of meshes among them, are as deep as the deepest two pieces.
"""

from collections.abc import Callable, Sequence
from functools import cache

import numpy as np

from compiled.kernel import direct, directly, kernel
from kinematics.arrays import Array, Indices
from kinematics.caches.bounded_cache import bounded_cache
from kinematics.trajectory.trajectory import Trajectory
from obstacles.distance.signed_distance import ACCURACY, convex_distance
from obstacles.robots.allowed_pairs import (
    DEPTH_TOLERANCE,
    AllowedPair,
    Overlap,
    allowed_pairs,
    piece_pairs,
)
from obstacles.robots.robot_geometry import RobotGeometry, sorted_pair
from obstacles.scenes.scene import Scene
from planning.proof.collision.containment import first_inside
from planning.proof.collision.interval_check import (
    COVERED,
    RESOLUTION,
    AllowedRows,
    check_overlaps,
    sharp_enough,
)
from planning.proof.collision.pair_table import PairArrays, PairTable, any_pairs
from planning.proof.collision.proposals import empty_proposal, propose_deepest
from planning.proof.collision.sweep import (
    ASKING,
    DONE,
    FULL,
    PAUSED,
    Proved,
    sweep_from_start,
    sweep_on,
)
from planning.proof.collision.sweep_state import (
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
    Sweep,
    enlarge,
    moves_far,
    note_clearance,
    pass_on,
    pop_interval,
    push_halves,
    start_kernel,
)
from planning.proof.limits.limit_uses import Violation, at_an_end
from planning.proof.motion_bounds import VALUE
from planning.values.deadline import Deadline


def prove_overlaps(
    trajectory: Trajectory, robot: RobotGeometry, scene: Scene, deadline: Deadline | None
) -> tuple[tuple[Overlap, ...], Violation | None]:
    """All pairs that may touch with bounds of how deep they do, and the first that is too deep.

    Args:
        trajectory: The motion.
        robot: The arm with its geometry.
        scene: The obstacles.
        deadline: Instant at which the proof is given up: depths are not known then, no limit of
            them proved.
    """
    pairs = allowed_pairs(robot, scene)
    measured = [item for item in pairs if item.measured]
    if not measured:
        return tuple(Overlap(item.pair, item.reason, None) for item in pairs), None
    table, rows = _rows(robot, scene, measured)
    late = not _swept(trajectory, table.arrays, rows, deadline)
    bounds = {item.pair: float(rows.bounds[k]) for k, item in enumerate(measured)}
    told = tuple(
        Overlap(item.pair, item.reason, None if late else bounds.get(item.pair)) for item in pairs
    )
    if late:
        message = "time was up before the depth of allowed contacts was bounded"
        return told, Violation("time", 0.0, message, {})
    return told, _too_deep(trajectory, measured, rows)


@bounded_cache(maxsize=8)
def unlooked(robot: RobotGeometry, scene: Scene) -> tuple[str, ...]:
    """Contacts that were not checked beside allowed pairs, a sentence each.

    Links that are drawn and have no solids; and obstacles that touch, or are inside of, what stands
    still with the base: an arm touches the table that it is bolted to, and can't be moved off it.

    Args:
        robot: The robot.
        scene: Scene around the robot.
    """
    drawn = (
        f"{name!r} is drawn and has no collision geometry: nothing was compared with it"
        for name in robot.unseen
    )
    touching = (
        f"{obstacle!r} touches {link!r}, which does not move: the two were not compared"
        for link, obstacle in _touching_base(robot, scene)
    )
    return (*drawn, *touching)


def _touching_base(robot: RobotGeometry, scene: Scene) -> tuple[tuple[str, str], ...]:
    """Links that stand still, each with an obstacle that touches it and that nobody allows to."""
    still, owners = np.flatnonzero(robot.joints < 0), scene.pieces()[1]
    if not (len(still) and len(owners)):
        return ()
    arrays = PairTable.of(robot, scene, 0.0, frozenset()).arrays
    around = arrays.moving + np.arange(len(owners))
    gaps = np.linalg.norm(arrays.centers[still, None] - arrays.centers[around], axis=2)
    near = np.argwhere(gaps <= arrays.radii[still, None] + arrays.radii[around])
    if not len(near):
        return ()
    elements = np.column_stack([around[near[:, 1]], still[near[:, 0]]])
    distances = np.empty(len(elements))
    directly(distances_of_still, arrays, elements, distances)
    told = {item.pair for item in allowed_pairs(robot, scene)}
    found = {
        (robot.links[j], scene.ids[owners[i - arrays.moving]])
        for i, j in elements[distances <= RESOLUTION].tolist()
    }
    return tuple(sorted(pair for pair in found if sorted_pair(*pair) not in told))


@kernel
def distances_of_still(model: PairArrays, elements: Indices, distances: Array) -> None:
    """Write lower bounds of the distances of elements that stand still with the base [m].

    Args:
        model: The pairs.
        elements: Pairs of elements, shape (k, 2).
        distances: Filled, shape (k,).
    """
    proposal = empty_proposal()
    for k in range(elements.shape[0]):
        i, j = elements[k, 0], elements[k, 1]
        for axis in range(3):
            proposal.axis[axis] = model.centers[i, axis] - model.centers[j, axis]
        poses, centers = model.poses, model.centers
        distances[k] = propose_deepest(model.proposals, i, j, poses, centers, proposal)


def _any_depth(elements: Indices, owner: Indices) -> AllowedRows:
    """Pairs of elements (k, 2) of bodies (k,), of which nothing is known, and that may be deep."""
    count = int(owner.max(initial=-1)) + 1
    bounds = np.zeros(count), np.zeros(count), np.full(count, np.inf)
    return AllowedRows(np.ascontiguousarray(elements), owner, np.full(count, np.inf), *bounds)


def _rows(
    robot: RobotGeometry, scene: Scene, measured: Sequence[AllowedPair]
) -> tuple[PairTable, AllowedRows]:
    table = PairTable.of(robot, scene, 0.0, frozenset())
    arrays, p = table.arrays, len(robot.pieces)
    elements, owner = [], []
    for number, item in enumerate(measured):
        pieces = piece_pairs(robot, scene, item.pair)
        around = pieces[:, 1] >= p
        # Elements of the scene come behind all of the robot's, and first in a pair.
        pieces[around, 1] += arrays.moving - p
        joints = arrays.joints[pieces]
        swapped = around | (joints[:, 0] > joints[:, 1])
        pieces[swapped] = pieces[swapped, ::-1]
        elements.append(pieces)
        owner.append(np.full(len(pieces), number))
    limits = np.array([item.touch_depth + DEPTH_TOLERANCE for item in measured])
    rows = _any_depth(np.concatenate(elements), np.concatenate(owner))
    return table, rows._replace(limits=limits)


def _swept(
    trajectory: Trajectory, arrays: PairArrays, rows: AllowedRows, deadline: Deadline | None
) -> bool:
    """Bound all depths; False where time was up before."""
    arrays = arrays._replace(asked=np.ones_like(arrays.asked))
    breaks, coefficients = trajectory.breaks, trajectory.coefficients
    roots = np.zeros_like(rows.elements)
    roots[:, 0] = np.arange(len(roots))
    motion = arrays, breaks, coefficients, rows
    state, sweep = _run_first()(*motion, roots, _INTERVALS_A_CALL)
    while state != DONE:
        assert sweep is not None
        if deadline is not None and deadline.passed:
            return False
        sweep = enlarge(sweep) if state == FULL else sweep
        state = directly(run_overlaps, *motion, sweep, _INTERVALS_A_CALL)
    return True


def _too_deep(
    trajectory: Trajectory, measured: Sequence[AllowedPair], rows: AllowedRows
) -> Violation | None:
    """The first pair that is deeper than it may be."""
    beyond = np.flatnonzero((rows.known > rows.limits) | (rows.bounds > rows.limits))
    if not len(beyond):
        return None
    k = int(beyond[np.argmin(rows.beyond[beyond])])
    found, time = rows.known[k] > rows.limits[k], float(min(rows.beyond[k], trajectory.duration))
    message, details = measured[k].deeper(float(rows.known[k] if found else rows.bounds[k]))
    where = at_an_end(trajectory, trajectory.sample([time])[0]) if found else None
    if where is not None:
        message, details["at"] = f"{message} at the {where}", where
    return Violation("collision" if found else "undecided", time, message, details)


@cache
def _run_first() -> Callable[
    [PairArrays, Array, Array, AllowedRows, Indices, int], tuple[int, Sweep | None]
]:
    model, numbers, values = any_pairs(), np.zeros(1, dtype=np.int64), np.zeros(1)
    rows = AllowedRows(model.roots, numbers, values, values, values, values)
    return direct(first_overlaps, model, np.zeros(2), np.zeros((1, 1, 1)), rows, model.roots, 1)


@kernel
def first_overlaps(
    model: PairArrays,
    breaks: Array,
    coefficients: Array,
    rows: AllowedRows,
    roots: Indices,
    most: int,
) -> tuple[int, Sweep | None]:
    """``run_overlaps`` from the start: a sweep that is done is not handed to Python.

    Args:
        model: The pairs.
        breaks: Breaks of the trajectory, shape (m + 1,) [s].
        coefficients: Coefficients of the trajectory, shape (m, n, k).
        rows: The pairs that may touch.
        roots: Numbers of these, in the first column, shape (k, 2).
        most: Intervals to look at.
    """
    sizes = model.bodies.shape[1], model.joints.shape[0], model.moving
    w = start_kernel(breaks, coefficients, roots, sizes)
    state = run_overlaps(model, breaks, coefficients, rows, w, most)
    if state == DONE:
        return state, None
    return state, w


@kernel
def run_overlaps(
    model: PairArrays, breaks: Array, coefficients: Array, rows: AllowedRows, w: Sweep, most: int
) -> int:
    """Sweep on until DONE, FULL, or PAUSED after ``most`` intervals.

    Args:
        model: The pairs.
        breaks: Breaks of the trajectory, shape (m + 1,) [s].
        coefficients: Coefficients of the trajectory, shape (m, n, k).
        rows: The pairs that may touch.
        w: The sweep.
        most: Intervals to look at.
    """
    seen = 0
    while w.counters[TOP] > 0:
        if seen >= most:
            return PAUSED
        seen += 1
        pop_interval(breaks, coefficients, w)
        if moves_far(w):
            pass_on(w, breaks)
            continue
        if not check_overlaps(model, breaks, rows, w):
            w.counters[TOP] += 1
            w.counters[VISITS] -= 1
            return FULL
        if w.counters[OPEN] > 0:
            push_halves(w, breaks, True)
    return DONE


# The referee's decision on a pair.
#: It is free all over the interval.
_FREE = 0
#: It may be free on the halves.
_OPEN = 1
#: It violates its margin.
_HIT = 2
#: Sweeps with ever more covers opened; the last one opens all.
_MAX_SWEEPS = 8
#: Triangles up to which all covers are opened at once: their table costs less than a sweep.
_FEW_TRIANGLES = 15_000
#: Intervals between two looks at the clock: a few milliseconds.
_INTERVALS_A_CALL = 1000


class CollisionProof:
    """A sweep of separating directions along a trajectory, FCL the referee of what they leave.

    Args:
        trajectory: The motion.
        robot: The arm with its geometry.
        scene: The obstacles.
        margin: Distance to keep from obstacles beyond their own margins [m].
        deadline: Instant at which the proof is given up.
    """

    def __init__(
        self,
        trajectory: Trajectory,
        robot: RobotGeometry,
        scene: Scene,
        margin: float,
        deadline: Deadline | None,
    ) -> None:
        self._robot, self._scene, self._margin = robot, scene, margin
        self._trajectory, self._deadline = trajectory, deadline
        self._start(frozenset())

    def _start(self, opened: frozenset[int] | None) -> None:
        """Begin a sweep with the triangles of some covers, None for all, others as solids."""
        self._table = PairTable.of(self._robot, self._scene, self._margin, opened)
        self._proved: Proved | None = None
        self._unfinished: Sweep | None = None
        self.violation: Violation | None = None

    @property
    def interval_count(self) -> int:
        """Intervals that were looked at."""
        return 0 if self._proved is None else int(self._proved.counters[VISITS])

    @property
    def clearances(self) -> tuple[float, float]:
        """Proved from obstacles and among the robot's own links [m]."""
        if self._proved is None:
            nothing = np.inf if self.violation is None else 0.0
            return nothing, nothing
        return float(self._proved.clearance[OBSTACLE]), float(self._proved.clearance[OWN])

    @property
    def closest_pairs(self) -> tuple[tuple[str, str] | None, tuple[str, str] | None]:
        """Pairs with the least clearance: of those with obstacles, and of the robot's own."""
        if self._proved is None:
            return None, None
        closest, names = self._proved.closest.tolist(), self._table.names
        (i, j), (k, m) = closest[OBSTACLE], closest[OWN]
        return names(i, j) if i >= 0 else None, names(k, m) if k >= 0 else None

    def run(self) -> None:
        """Settle every pair on every interval, or find the first violation."""
        if not len(self._table.arrays.roots):
            return
        # Whatever covers and triangles are proved apart: who is inside touches neither.
        inside = first_inside(self._robot, self._scene, self._trajectory.start)
        if inside is not None:
            self._note_inside(*inside)
            return
        opened: frozenset[int] = frozenset()
        for sweeps in range(1, _MAX_SWEEPS + 1):
            more = self._run_once()
            if not more:
                return
            opened |= more
            last = sweeps + 1 == _MAX_SWEEPS or self._triangle_count() <= _FEW_TRIANGLES
            self._start(None if last else opened)

    def _run_once(self) -> set[int]:
        """Sweep once; covers that have to be opened first for a proof or a violation, if any."""
        while True:
            if self._is_late():
                message = "time was up before the proof was complete"
                self.violation = self.violation or Violation("time", 0.0, message, {})
                return set()
            state = self._sweep_on()
            if state == ASKING:
                more = self._closed_covers(self._sweep.referred[: self._sweep.counters[REFERRED]])
                if more:
                    return more
                self._decide_referred()
            if state == DONE:
                # Too near for what covers prove to be told as the clearance of what they cover.
                assert self._proved is not None
                least = self._proved.nearest
                if self.violation is not None or min(least.tolist()) > COVERED:
                    return set()
                return self._closed_covers(self._proved.closest[least <= COVERED])

    def _triangle_count(self) -> int:
        """Triangles under all covers of the robot and the scene."""
        pieces = list(self._robot.pieces)
        pieces += [p for o in self._scene.obstacles if not o.is_cloud for p in o.pieces()]
        return sum(len(p.surface.triangles) for p in pieces if p.surface is not None)

    def _closed_covers(self, pairs: Indices) -> set[int]:
        """Covers among pairs of elements (k, 2) that are not opened."""
        covers = {self._table.closed_cover(int(k)) for k in pairs.reshape(-1) if k >= 0}
        return {row for row in covers if row is not None}

    def _note_inside(self, outer: str, inner: str) -> None:
        """Note that of two bodies one is inside the other at the start."""
        message = f"{outer!r} and {inner!r}: one is inside the other at the start"
        details = {"pair": [outer, inner], "distance": 0.0, "margin": 0.0, "at": "start"}
        self.violation = Violation("collision", 0.0, message, details)

    def _is_late(self) -> bool:
        return self._deadline is not None and self._deadline.passed

    def _sweep_on(self) -> int:
        """Sweep on for some milliseconds; why it stopped, with more room where there was none."""
        motion, pairs, most = self._trajectory, self._table.arrays, _INTERVALS_A_CALL
        sharp = self.violation is None
        if self._unfinished is None:
            begun = sweep_from_start(motion, pairs, most, sharp=sharp)
            state, self._proved, self._unfinished = begun
        else:
            state = sweep_on(motion, pairs, self._unfinished, most, sharp=sharp)
        if state == FULL:
            self._unfinished = enlarge(self._sweep)
        return state

    @property
    def _sweep(self) -> Sweep:
        """The sweep that has begun and is not done."""
        assert self._unfinished is not None
        return self._unfinished

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
        message = f"{names[0]!r} and {names[1]!r} {_describe(distance)}"
        if apart > 0.0:
            message += f", {apart:.6g} m are asked for"
        details = {"pair": list(names), "distance": distance, "margin": apart}
        where = at_an_end(trajectory, sweep.joints[: trajectory.n, VALUE])
        if where is not None:
            message, details["at"] = f"{message} at the {where}", where
        decided = distance <= apart or sweep.referred_moves[at] < RESOLUTION
        kind = "collision" if decided else "undecided"
        self.violation = Violation(kind, time, message, details)


def _describe(distance: float) -> str:
    if abs(distance) <= RESOLUTION:
        return "touch"
    return f"overlap by {-distance:.6g} m" if distance < 0.0 else f"are {distance:.6g} m apart"
