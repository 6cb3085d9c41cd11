"""Proof of how deep pairs that may touch overlap at most, for every instant of a trajectory.

A sweep over time as that of the pairs that must stay apart: along a direction, the overlap of two
convex solids is less their gap, so what bounds gaps over an interval bounds depths
(``interval_check.check_overlaps``). Bodies of several convex pieces, covers of meshes among them,
are as deep as the deepest two pieces.
"""

from collections.abc import Callable, Sequence
from functools import cache

import numpy as np

from compiled.kernel import direct, kernel
from kinematics.arrays import Array, Indices
from kinematics.caches.bounded_cache import bounded_cache
from kinematics.trajectory.trajectory import Trajectory
from obstacles.robots.allowed_pairs import (
    DEPTH_TOLERANCE,
    AllowedPair,
    Overlap,
    allowed_pairs,
    piece_pairs,
)
from obstacles.robots.robot_geometry import RobotGeometry, sorted_pair
from obstacles.scenes.scene import Scene
from planning.proof.collision.interval_check import RESOLUTION, AllowedRows, check_overlaps
from planning.proof.collision.pair_table import PairArrays, PairTable, any_pairs
from planning.proof.collision.proposals import empty_proposal, propose_deepest
from planning.proof.collision.sweep import DONE, FULL, PAUSED
from planning.proof.collision.sweep_state import (
    OPEN,
    TOP,
    VISITS,
    Sweep,
    enlarge,
    moves_far,
    pass_on,
    pop_interval,
    push_halves,
    start_kernel,
)
from planning.proof.limits.limit_uses import Violation, at_an_end
from planning.values.deadline import Deadline

#: Intervals between two looks at the clock: a few milliseconds.
_INTERVALS_A_CALL = 1000


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
    _distances_of_still()(arrays, elements, distances)
    told = {item.pair for item in allowed_pairs(robot, scene)}
    found = {
        (robot.links[j], scene.ids[owners[i - arrays.moving]])
        for i, j in elements[distances <= RESOLUTION].tolist()
    }
    return tuple(sorted(pair for pair in found if sorted_pair(*pair) not in told))


@cache
def _distances_of_still() -> Callable[[PairArrays, Indices, Array], None]:
    model = any_pairs()
    return direct(distances_of_still, model, model.roots, np.zeros(1))


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
        state = _run()(*motion, sweep, _INTERVALS_A_CALL)
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


@cache
def _run() -> Callable[[PairArrays, Array, Array, AllowedRows, Sweep, int], int]:
    breaks, coefficients, model = np.zeros(2), np.zeros((1, 1, 1)), any_pairs()
    numbers, values = np.zeros(1, dtype=np.int64), np.zeros(1)
    rows = AllowedRows(model.roots, numbers, values, values, values, values)
    sweep = start_kernel(breaks, coefficients, model.roots, (1, 1, 1))
    return direct(run_overlaps, model, breaks, coefficients, rows, sweep, 1)


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
