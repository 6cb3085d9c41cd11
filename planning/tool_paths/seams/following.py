"""Joint paths along a seam: made calmer within the tolerances, joined by splines, proved free.

The deviations of the tool are refined by alternating two least-squares problems: of a way near the
one at hand with the least squared joint rates, and of the nearest configurations that keep the
tolerances (projected Jacobi smoothing). Through the places goes one cubic spline for each run, with
more of them where the tool would leave its tolerance.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.linalg import solveh_banded

from kinematics.arrays import Array
from kinematics.forward import forward
from kinematics.trajectory.trajectory import Trajectory
from obstacles.collision.checker import Checker
from planning.timing.path.path import JointPath
from planning.tool_motions.tool_path import Tolerances, ToolSegment
from planning.tool_paths.seams.kernels import project_kernel
from planning.tool_paths.seams.path import SeamPlaces, pack_tolerance
from planning.tool_paths.seams.ranges import is_within_at_own_places
from planning.tool_paths.seams.search import SeamSearch
from planning.values.deadline import Deadline

#: Rounds of smoothing and projection.
_REFINEMENTS = 24
#: Weight of the squared joint rates beside the squared change, in units of squared places: at
#: first, by what it falls after a round that can't be used, and the least that is tried.
_STIFFNESS = 1280.0
_SOFTER = 0.25
_LEAST_STIFFNESS = 5.0
#: A round that calms the way by less than this part can't be used.
_LEAST_GAIN = 0.01
#: Part of half of a joint's range that calmer ways keep free at either end, where there is room.
_ROOM = 0.02
#: Errors that a projection may leave [m], [rad].
_REACHED = 1e-6
#: Looks at each piece of a spline.
_LOOKS = 6
#: Way between two knots of a spline, where places are nearer together [m].
_KNOT_LENGTH = 0.02
#: Turn of the path between two knots, likewise [rad].
_KNOT_ANGLE = 0.12
#: Knots of a spline at least.
_LEAST_KNOTS = 6
#: Share of the deviations allowed that the spline may use.
_SHARE = 0.7
#: Share that it may use as seen from the places that the tool is at, as the proof measures.
_OWN_SHARE = 0.95
#: Times that places are put where the spline leaves the tolerance.
_MAX_INSERTIONS = 7
#: Newton steps of a projection.
_ROUNDS = 12


def refine(search: SeamSearch, joints: Array) -> Array:
    """Calm a way along a seam within its tolerances, at rest where runs meet.

    Args:
        search: Of the seam.
        joints: Configurations at its places, shape (k, n).

    Returns:
        Shape (k, n), free of collision at all places; the way itself where nothing is gained.
    """
    best, roughness = joints, _roughness(joints)
    stiffness = _STIFFNESS
    for _ in range(_REFINEMENTS):
        if search.deadline.passed or stiffness < _LEAST_STIFFNESS:
            break
        calmer = _smooth(best, stiffness)
        is_reached = search.project(calmer, _ROOM).max() <= _REACHED
        rough = _roughness(calmer)
        is_calmer = rough <= (1.0 - _LEAST_GAIN) * roughness
        if is_reached and is_calmer and all(search.checker.valid(q) for q in calmer):
            best, roughness = calmer, rough
        else:
            stiffness *= _SOFTER
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
    return np.ascontiguousarray(solveh_banded(bands, joints))


def segments(
    checker: Checker,
    places: SeamPlaces,
    joints: Array,
    deviations: Tolerances,
    deadline: Deadline,
    *,
    own_places: bool = False,
) -> tuple[ToolSegment, ...] | None:
    """Joint paths of all runs of a seam; None where a spline can't be brought into the tolerance.

    Args:
        checker: The robot; collisions are not looked at here.
        places: Of the seam.
        joints: Configurations there, shape (k, n).
        deviations: By how much the tolerances may be exceeded.
        deadline: When to give up.
        own_places: Whether to look at the tolerance from the tool's own places on the path too.
    """
    finished: list[ToolSegment] = []
    first = 0
    for number, last in enumerate(places.ends):
        chosen = _knots(places, first, last)
        s = np.append(places.s[chosen[:-1]], 1.0)
        knots = s, joints[chosen]
        path = _spline_within(checker, places, number, knots, deviations, own_places)
        if path is None or deadline.passed:
            return None
        finished.append(ToolSegment(path, joints[first], joints[last], 1.0, None))
        first = last
    return tuple(finished)


def _knots(places: SeamPlaces, first: int, last: int) -> NDArray[np.int64]:
    """Indices of the places that the spline of a run goes through at first."""
    chosen = [first]
    measure = np.maximum(places.along / _KNOT_LENGTH, places.turned / _KNOT_ANGLE)
    for k in range(first + 1, last):
        if measure[k + 1] - measure[chosen[-1]] > 1.0:
            chosen.append(k)
    if last - first >= _LEAST_KNOTS > len(chosen):
        chosen = np.linspace(first, last, _LEAST_KNOTS).round().astype(int)[:-1].tolist()
    return np.array([*chosen, last])


def _spline_within(
    checker: Checker,
    places: SeamPlaces,
    number: int,
    knots: tuple[Array, Array],
    deviations: Tolerances,
    own_places: bool,
) -> JointPath | None:
    """The spline through the configurations of a run, with more of them where it needs them."""
    chain, run = checker.model.chain, places.runs[number]
    limits = chain.limits
    s, q = knots
    parts = run.parts
    begins = np.array([part.begin for part in parts])
    allowed = np.array([_SHARE * value for value in deviations.pair])
    shares = (np.arange(_LOOKS) + 0.5) / _LOOKS
    for _ in range(_MAX_INSERTIONS):
        spline = CubicSpline(s, q, bc_type="not-a-knot" if len(s) > 3 else "natural")
        looks = (s[:-1, None] + np.outer(np.diff(s), shares)).ravel()
        seen = spline(looks)
        T = forward(chain, seen)
        nominal = run.poses(looks)
        owner = np.searchsorted(begins, looks, side="right") - 1
        over = np.zeros((len(looks), 2))
        for tolerance in set(run.tolerances):
            mine = np.array([t is tolerance for t in run.tolerances])[owner]
            over[mine] = tolerance.excess(tolerance.deviations(nominal[mine], T[mine]))
        wrong = (over > allowed).any(axis=1)
        wrong |= ((seen < limits.lower) | (seen > limits.upper)).any(axis=1)
        pieces = np.flatnonzero(wrong.reshape(-1, _LOOKS).any(axis=1))
        if not pieces.size:
            c = np.ascontiguousarray(np.moveaxis(spline.c[::-1], 0, 2))
            path = JointPath(c, np.diff(s))
            most = _OWN_SHARE * np.array(deviations.pair)
            if own_places and not is_within_at_own_places(run, T, most):
                return None
            low, high = Trajectory(chain.joint_names, path.breaks, c).piece_extrema()
            is_inside = (low >= limits.lower).all() and (high <= limits.upper).all()
            return path if is_inside else None
        at = 0.5 * (s[pieces] + s[pieces + 1])
        more = np.ascontiguousarray(spline(at))
        where = np.searchsorted(begins, at, side="right") - 1
        boxes = np.array([pack_tolerance(run.tolerances[k]) for k in where])
        errors = np.empty((len(at), 2))
        project_kernel(
            chain.model, run.poses(at), boxes,
            np.array([limits.lower, limits.upper]), _ROUNDS, more, errors,
        )  # fmt: skip
        if errors.max() > _REACHED:
            return None
        s, q = np.insert(s, pieces + 1, at), np.insert(q, pieces + 1, more, axis=0)
    return None
