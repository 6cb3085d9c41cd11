"""Ranges of position along a seam, where the path bends.

The search lets the tool deviate from the pose of a place on the path; the proof measures from the
place that the tool is at, the nearest one. Both agree on deviations across the path. One along a
path that bends is partly one across it, seen from the tool's own place. Where that leaves the
tolerance the way is looked for again with fewer ranges.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from kinematics.arrays import Array
from planning.tool_motions.tool_run import ToolRun
from planning.tool_motions.tool_tolerance import RX, ToolTolerance
from planning.tool_paths.seams.path import SeamPlaces, pack_tolerance

#: Part of the deviation allowed that a range may have along the path and count as across it.
_ALONG = 0.25


def with_fewer_ranges(places: SeamPlaces, position: float) -> Iterator[tuple[SeamPlaces, bool]]:
    """The places as asked for, with ranges across the path only, and with exact positions.

    Args:
        places: Of a seam.
        position: By how much tolerances of position may be exceeded [m].

    Returns:
        With each whether the tool may leave its tolerance as seen from its own places.
    """
    lower = np.array([tolerance.lower[:RX] for tolerance in places.tolerances])
    upper = np.array([tolerance.upper[:RX] for tolerance in places.tolerances])
    ranged = (upper > lower).any(axis=0)
    along = np.abs(np.einsum("kji,kj->ki", _axes(places), _directions(places)))
    largest = np.maximum(np.abs(lower), np.abs(upper))
    across = (along * largest).max(axis=0) <= _ALONG * position
    if not (ranged & ~across).any():
        yield places, False
        return
    yield places, True
    # Deviations that are asked for stay, and may be along the path.
    asked = bool(((lower > 0.0) | (upper < 0.0))[:, ~across].any())
    if (ranged & across).any():
        yield _exact(places, ~across), asked
    yield _exact(places, np.full(RX, True)), asked


def _axes(places: SeamPlaces) -> Array:
    """Axes of the tolerance at each place, by columns, shape (k, 3, 3)."""
    return np.array(
        [
            T[:3, :3] if tolerance.axes is None else tolerance.axes
            for T, tolerance in zip(places.nominal, places.tolerances, strict=True)
        ]
    )


def _directions(places: SeamPlaces) -> Array:
    """Direction of the path at each place, shape (k, 3)."""
    located = [places.runs[run].locate(s) for run, s in zip(places.run, places.s, strict=True)]
    return np.array([motion.direction(at) for motion, at in located])


def _exact(places: SeamPlaces, columns: Array) -> SeamPlaces:
    """Places whose tolerances have no range along some axes, but the value nearest to none."""
    asked = {t for run in places.runs for t in run.tolerances}
    changed = {id(t): _without_ranges(t, columns) for t in asked}
    tolerances = tuple(changed[id(t)] for t in places.tolerances)
    runs = tuple(
        replace(run, tolerances=tuple(changed[id(t)] for t in run.tolerances))
        for run in places.runs
    )
    boxes = np.array([pack_tolerance(tolerance) for tolerance in tolerances])
    return replace(places, runs=runs, tolerances=tolerances, boxes=boxes)


def _without_ranges(tolerance: ToolTolerance, columns: Array) -> ToolTolerance:
    lower, upper = tolerance.lower.copy(), tolerance.upper.copy()
    nearest = np.clip(0.0, lower[:RX], upper[:RX])
    lower[:RX] = np.where(columns, nearest, lower[:RX])
    upper[:RX] = np.where(columns, nearest, upper[:RX])
    return replace(tolerance, lower=lower, upper=upper)


def is_within_at_own_places(run: ToolRun, poses: Array, allowed: Array) -> bool:
    """Whether the tool keeps its tolerances as seen from the places that it is at.

    Args:
        run: The path, with tolerances.
        poses: Of the tool, in the order in which it passes them, shape (k, 4, 4).
        allowed: By how much the tolerances may be exceeded [m], [rad], shape (2,).
    """
    owner = _owners(run, poses[:, :3, 3])
    for k in np.unique(owner):
        T, tolerance = poses[owner == k], run.tolerances[k]
        nominal = run.motions[k].poses(run.motions[k].places(T[:, :3, 3]))
        if (tolerance.excess(tolerance.deviations(nominal, T)) > allowed).any():
            return False
    return True


def _owners(run: ToolRun, points: Array) -> NDArray[np.int64]:
    """The motion that each point belongs to: up to the plane across the path at its end."""
    ends = [motion.T_end[:3, 3] for motion in run.motions[:-1]]
    across = [
        first.direction(1.0) + second.direction(0.0)
        for first, second in zip(run.motions[:-1], run.motions[1:], strict=True)
    ]
    owners, k = np.zeros(len(points), dtype=np.int64), 0
    for i, point in enumerate(points):
        while k < len(ends) and (point - ends[k]) @ across[k] >= 0.0:
            k += 1
        owners[i] = k
    return owners
