"""Joint paths along a seam: made calmer within the tolerances, joined by splines, proved free.

The deviations of the tool are refined by alternating two least-squares problems: of a way near the
one at hand with the least squared joint rates, and of the nearest configurations that keep the
tolerances (projected Jacobi smoothing). Through the places goes one cubic spline for each run, with
more of them where the tool would leave its tolerance.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from kinematics.arrays import Array
from planning.result import Failure
from planning.tool_motions.tool_path import Tolerances, ToolPath
from planning.tool_motions.tool_tolerance import RX, ToolTolerance
from planning.tool_paths.projection import REACHED
from planning.tool_paths.seams.failure import explain_bend, explain_path
from planning.tool_paths.seams.nodes import COARSE, DENSE, FINE, Density
from planning.tool_paths.seams.path import SeamPlaces, spaced
from planning.tool_paths.seams.search import SeamGraph, SeamJoints, SeamSearch
from planning.tool_paths.tool_following import TIME, lead_tool, stop_failure


def refine(search: SeamSearch, joints: Array) -> Array:
    """Calm a way along a seam within its tolerances, at rest where runs meet.

    Args:
        search: Search of the seam.
        joints: Configurations at its places, shape (k, n).

    Returns:
        Shape (k, n), free of collision at all places; the way itself where nothing is gained.
    """
    best, roughness = joints, _roughness(joints)
    # Weight of the squared joint rates beside the squared change, in units of squared places.
    stiffness = 1280.0
    # Rounds of smoothing and projection.
    for _ in range(24):
        if search.deadline.passed or stiffness < 5.0:
            break
        calmer = _smooth(best, stiffness)
        # Part of half of a joint's range that calmer ways keep free at either end, where there is
        # room.
        is_reached = search.project(calmer, 0.02).max() <= REACHED
        rough = _roughness(calmer)
        # A round that calms the way by less than this part can't be used.
        is_calmer = rough <= 0.99 * roughness
        if is_reached and is_calmer and all(search.checker.valid(q) for q in calmer):
            best, roughness = calmer, rough
        else:
            stiffness *= 0.25
    return best


def _roughness(joints: Array) -> float:
    """Sum of the squared steps and of their squared changes."""
    steps = np.diff(joints, axis=0)
    return float((steps**2).sum() + (np.diff(steps, axis=0) ** 2).sum())


def _smooth(joints: Array, stiffness: float) -> Array:
    """The way x of the least |x - q|^2 + stiffness sum |x_(k+1) - x_k|^2."""
    k = len(joints)
    bands = np.zeros((2, k))
    bands[0, 1:] = -stiffness
    bands[1] = 1.0 + 2.0 * stiffness
    bands[1, 0] = bands[1, -1] = 1.0 + stiffness
    return np.ascontiguousarray(scipy.linalg.solveh_banded(bands, joints))


class Followed(NamedTuple):
    """Result of the search for a joint path along a seam.

    Args:
        path: Joint path of all runs, proved free; None where there is none.
        failure: Failure of the first way that was found; None where there was none.
        unfound: Graphs in which there was no way.
    """

    path: ToolPath | None
    failure: Failure | None = None
    unfound: tuple[SeamGraph, ...] = ()


#: Searches in turn: whether all places are layers, and the density of their configurations.
LOOKS: tuple[tuple[bool, Density], ...] = (
    (False, COARSE), (False, DENSE), (True, COARSE), (True, FINE),
)  # fmt: skip


def follow_seam(
    search: SeamSearch, tolerances: Tolerances, looks: Sequence[tuple[bool, Density]] = LOOKS
) -> Followed:
    """Find a joint path along a seam in one branch, of few configurations, or of more.

    Args:
        search: Search of the seam.
        tolerances: Deviations that are added to the tolerances of the seam.
        looks: Searches in turn.
    """
    unfound: list[SeamGraph] = []
    failure: Failure | None = None
    for every, density in looks:
        if search.deadline.passed and (unfound or failure):
            break
        # Places of a seam up to which all of them are searched where a few have no way.
        if every and len(search.places.s) > 600:
            continue
        for places in with_fewer_ranges(search.places, tolerances.position):
            narrower = replace(search, places=places)
            found = narrower.run(every, density)
            if found.joints is None:
                unfound.append(found.graph)
                break
            followed = _follow_one(narrower, found, tolerances)
            if isinstance(followed, ToolPath):
                return Followed(followed)
            failure = failure or followed
            if followed.details["reason"] != "deviation":
                break
    return Followed(None, failure, tuple(unfound))


def _follow_one(
    search: SeamSearch, found: SeamJoints, tolerances: Tolerances
) -> ToolPath | Failure:
    """Joint path of the way that was found, or of another where its spline meets something."""
    # Ways that are tried.
    for _ in range(6):
        assert found.joints is not None
        followed = _follow(search, found.joints, tolerances)
        if isinstance(followed, ToolPath) or followed.details["reason"] != "collision":
            break
        found = search.around(found, followed.details["fraction"])
        if found.joints is None:
            break
    return followed


def _follow(search: SeamSearch, joints: Array, tolerances: Tolerances) -> ToolPath | Failure:
    """Joint path of the calmer way, or of the one that was found."""
    places, deadline = search.places, search.deadline
    failure = None
    # A calmer way would begin elsewhere than where the arm has to.
    calmer = [] if search.first is not None else [refine(search, joints)]
    for way in (*calmer, joints):
        knots = []
        for first, last in pairwise((0, *places.ends)):
            chosen = _knots(places, first, last)
            knots.append((np.append(places.s[chosen[:-1]], 1.0), way[chosen]))
        path = lead_tool(search.checker, way[0], places.runs, tolerances, deadline, knots)
        if path.stop is None:
            return path
        if path.stop.reason == "collision":
            failure = explain_path(places, path)
    if deadline.passed:
        return stop_failure(TIME, "the seam was not followed to its end")
    return failure or explain_bend(places)


def _knots(places: SeamPlaces, first: int, last: int) -> NDArray[np.int64]:
    """Indices of the places that the spline of a run goes through at first."""
    # Way between two knots of a spline, where places are nearer together [m].
    # Turn of the tool between two knots, likewise [rad].
    # Bend of the path between two knots, likewise [rad].
    measure = np.max([places.along / 0.02, places.turned / 0.12, places.bent / 0.1], axis=0)
    chosen = first + np.array(spaced(measure[first : last + 1]))
    # Knots of a spline at least.
    least_knots = 6
    if last - first >= least_knots >= len(chosen):
        chosen = np.linspace(first, last, least_knots).round().astype(int)
    return chosen


def with_fewer_ranges(places: SeamPlaces, position: float) -> Iterator[SeamPlaces]:
    """The places as asked for, with ranges across the path only, and with exact positions.

    Args:
        places: Places of a seam.
        position: Excess allowed of tolerances of position [m].
    """
    lower = np.array([tolerance.lower[:RX] for tolerance in places.tolerances])
    upper = np.array([tolerance.upper[:RX] for tolerance in places.tolerances])
    ranged = (upper > lower).any(axis=0)
    along = np.abs(np.einsum("kji,kj->ki", _axes(places), places.directions))
    largest = np.maximum(np.abs(lower), np.abs(upper))
    # Part of the deviation allowed that a range may have along the path and count as across it.
    across = (along * largest).max(axis=0) <= 0.25 * position
    yield places
    if not (ranged & ~across).any():
        return
    if (ranged & across).any():
        yield _exact(places, ~across)
    yield _exact(places, np.full(RX, True))


def _axes(places: SeamPlaces) -> Array:
    """Axes of the tolerance at each place, by columns, shape (k, 3, 3)."""
    return np.array(
        [
            T[:3, :3] if tolerance.axes is None else tolerance.axes
            for T, tolerance in zip(places.nominal, places.tolerances, strict=True)
        ]
    )


def _exact(places: SeamPlaces, columns: Array) -> SeamPlaces:
    """Places whose tolerances have no range along some axes, but the value nearest to none."""
    asked = {t for run in places.runs for t in run.tolerances}
    changed = {id(t): _without_ranges(t, columns) for t in asked}
    tolerances = tuple(changed[id(t)] for t in places.tolerances)
    runs = tuple(
        replace(run, tolerances=tuple(changed[id(t)] for t in run.tolerances))
        for run in places.runs
    )
    return replace(places, runs=runs, tolerances=tolerances)


def _without_ranges(tolerance: ToolTolerance, columns: Array) -> ToolTolerance:
    lower, upper = tolerance.lower.copy(), tolerance.upper.copy()
    nearest = np.clip(0.0, lower[:RX], upper[:RX])
    lower[:RX] = np.where(columns, nearest, lower[:RX])
    upper[:RX] = np.where(columns, nearest, upper[:RX])
    return replace(tolerance, lower=lower, upper=upper)
