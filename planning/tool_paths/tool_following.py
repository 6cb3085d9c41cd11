"""Joint paths that keep the tool on its motion, or within its tolerance of it.

Through configurations goes a cubic spline in s, whose second derivative is continuous, so that
every method can time it; where the spline takes the tool too far off, more configurations are put
in between. A seam gives the configurations that its search has chosen. Of a motion without a
tolerance they are found one after the other: from the one at hand Newton's method goes to the next
pose, so that it stays in its branch; steps are halved where it fails or the joints jump. What
limits the joints is reported where no step is small enough.

Reasons why the tool can't be led on: what is in the way, by how much, and what to try.
"""

from collections.abc import Sequence
from dataclasses import replace
from operator import itemgetter
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from kinematics.arrays import Array
from kinematics.ik.numeric import numeric
from kinematics.ik.numeric.numeric import AXES, POSITION
from kinematics.jacobian import geometric
from kinematics.model.chain import Chain
from kinematics.trajectory.trajectory import Trajectory
from obstacles.collision.checker import Checker
from planning.result import Failure
from planning.timing.path.path import JointPath
from planning.tool_motions.tool_path import Reason, Stop, Tolerances, ToolPath, ToolRun, ToolSegment
from planning.tool_paths.projection import REACHED, pack_tolerance, project
from planning.tool_paths.tool_deviation import pieces_within
from planning.values.deadline import Deadline

#: What to try, by the reason.
HINTS: dict[Reason, str] = {
    "limit": "Start in another branch, turn the tool elsewhere, or move the work or the base.",
    "singularity": "Start in another branch, or lead the tool past the singularity.",
    "unreachable": "Bring what is to be reached nearer.",
    "branch": "Start in another branch, or split the way where the longest part ends.",
    "collision": "Move what is in the way, or lead the tool round it.",
    "deviation": "Allow a larger max_deviation, or give waypoints farther apart.",
    "time": "Allow more time.",
}
#: Name of the planner.
NAME = "cartesian"


def stop_failure(stop: Stop, message: str, hint: str | None = None, /, **details: Any) -> Failure:
    """Failure of a tool path that ends with a stop.

    Args:
        stop: The reason.
        message: How far the path goes.
        hint: Advice; that for the reason if None.
        details: Values beside those of the reason.
    """
    return Failure(
        "TIMED_OUT" if stop.reason == "time" else "PLANNING_FAILED",
        f"{message}: {stop.message}",
        HINTS[stop.reason] if hint is None else hint,
        NAME,
        details={"reason": stop.reason, **details, **stop.details},
    )


def at_limit(chain: Chain, q: Array) -> Stop:
    """The joint that is farthest beyond its limits at a configuration (n,)."""
    limits = chain.limits
    beyond = np.maximum(limits.lower - q, q - limits.upper)
    j = int(np.argmax(beyond))
    limit = float(limits.lower[j] if limits.lower[j] > q[j] else limits.upper[j])
    name, excess = chain.joint_names[j], max(float(beyond[j]), 0.0)
    text = f"joint {name!r} would have to go {excess:.4g} beyond its limit {limit:.6g}"
    details = {"joint": name, "limit": limit, "value": float(q[j]), "excess": excess}
    return Stop("limit", text, details)


def out_of_reach(
    chain: Chain, target: Array, options: numeric.SearchOptions, seed: Array
) -> tuple[Stop | None, Array]:
    """Reason why no configuration has the tool at a pose, and the nearest one; None if one has.

    Args:
        chain: The robot; its tip is the tool.
        target: The pose, shape (4, 4).
        options: Starts to spend, and the axes that count.
        seed: First of them, shape (n,).
    """
    found = numeric.solve(chain, target, options, seed_joints=seed)
    if found.solutions:
        return None, found.solutions[0].joints
    nearest = found.nearest
    names = ("position_error", "orientation_error")
    errors = {name: float(getattr(nearest, name)) for name in names}
    text = "the arm comes no nearer than {:.4g} m and {:.4g} rad".format(*errors.values())
    return Stop("unreachable", text, errors), nearest.joints


def no_way_on(chain: Chain, configurations: Array, rows: slice = slice(6)) -> Stop:
    """Reason why no motion leads on from some configurations to a pose that can be reached.

    Args:
        chain: The robot; its tip is the tool.
        configurations: Shape (k, n).
        rows: Rows of the Jacobian that count.
    """
    values = [_singular_values(chain, q, rows) for q in configurations]
    least, share = max(values, key=itemgetter(1), default=(0.0, 1.0))
    details = {"smallest_singular_value": least}
    # Least singular value, as part of the largest, below which an arm counts as singular.
    if share < 1e-2:
        text = f"the arm is singular here (smallest singular value {least:.3g})"
        return Stop("singularity", text, details)
    return Stop(
        "branch", "the arm could only go on in another branch of its inverse kinematics", details
    )


def _singular_values(chain: Chain, q: Array, rows: slice) -> tuple[float, float]:
    """The least singular value of the Jacobian's rows that count, and as part of the largest."""
    J = geometric(chain, q)[rows]
    # Rows of the Jacobian below this are 0: no joint moves the tool that way.
    some = J[np.linalg.norm(J, axis=1) > 1e-9]
    values = np.linalg.svd(some if len(some) else J, compute_uv=False)
    return float(values[-1]), float(values[-1]) / max(float(values[0]), 1e-300)


#: A joint that moves more than this in one step [rad or m] may have changed its branch.
_JUMP = 0.35
#: Steps below this part of a motion tell that it can't be followed any further.
_LEAST_STEP = 1e-5
#: What the solver adds to the joint limits to keep inside them [rad or m], for the spline between.
_INSIDE = np.array([[1e-4], [-1e-4]])
_SHARP = "the joints would have to turn too sharply to keep the tool within max_deviation"
TIME = Stop("time", "time was up", {})
#: Places of a run from 0 to 1 and configurations there, shapes (k,) and (k, n).
Knots = tuple[Array, Array]


def lead_tool(
    checker: Checker,
    start: Array,
    runs: Sequence[ToolRun],
    tolerances: Tolerances,
    deadline: Deadline,
    knots: Sequence[Knots] | None = None,
) -> ToolPath:
    """Lead the tool along motions from a configuration, as far as can be proved free.

    Each motion begins where the one before ends, the first at the tool's pose in ``start``. The
    joints stay in one branch: they never jump. Between the configurations found by inverse
    kinematics the tool is within the tolerances too, which is proved, not sampled.

    Args:
        checker: The robot in its scene.
        start: Free and inside the limits, shape (n,).
        runs: Lines and arcs from rest to rest, at least one.
        tolerances: How far the tool may be off them, or out of their boxes.
        deadline: Time at which to give up.
        knots: Configurations on each run that a search has chosen; None to find them in the
            branch of the start.
    """
    chain, q = checker.model.robot.chain, start
    segments: list[ToolSegment] = []
    for k, run in enumerate(runs):
        chosen = None if knots is None else knots[k]
        segment = follow(chain, run, q, tolerances, deadline, chosen)
        if chosen is None or segment.stop is None:
            segment = free_part(checker, segment)
        segments.append(segment)
        q = segment.end
        if segment.stop is not None:
            break
    begun, last = tuple(runs[: len(segments)]), segments[-1]
    done = sum(len(run.motions) for run in begun[:-1]) + _completed(begun[-1], last)
    fraction = done / sum(len(run.motions) for run in runs)
    return ToolPath(begun, tuple(segments), fraction, last.stop, tolerances)


def _completed(run: ToolRun, segment: ToolSegment) -> float:
    """Number of motions of a run that were carried out, with the share of one that was begun."""
    if segment.stop is None:
        return float(len(run.motions))
    *before, last = run.parts_until(segment.reached)
    return len(before) + min((segment.reached - last.begin) / (last.end - last.begin), 1.0)


def free_part(checker: Checker, segment: ToolSegment) -> ToolSegment:
    """The part of a joint path that is proved free, from its start on."""
    path = segment.path
    if path is None:
        return segment
    at = 0.0
    for piece, length in zip(path.coefficients, path.lengths, strict=True):
        motion = checker.curve(*_first_part(piece, float(length)))
        if not motion.free:
            clear = _clear_until(checker, piece, float(length), motion.at)
            assert motion.pair is not None
            a, b = motion.pair
            text = f"{a!r} and {b!r} come too near to each other"
            details = {"pair": [a, b], "colliding": motion.colliding}
            return segment.cut(at + clear, Stop("collision", text, details))
        at += float(length)
    return segment


def _first_part(piece: Array, length: float) -> tuple[Array, Array, Array, Array]:
    """The beginning of a cubic piece (n, 4) as coefficients on [0, 1]."""
    b0, b1, b2, b3 = (piece * length ** np.arange(4)).T
    return b0, b1, b2, b3


def _clear_until(checker: Checker, piece: Array, length: float, met: float) -> float:
    """Length along a piece that is proved free, at most to the first contact."""
    low, high = 0.0, met * length
    # Bisections of the stretch on which a motion meets something, to come near to it.
    for _ in range(12):
        middle = 0.5 * (low + high)
        free = middle > 0.0 and checker.curve(*_first_part(piece, middle)).free
        low, high = (middle, high) if free else (low, middle)
    return low


def follow(
    chain: Chain,
    run: ToolRun,
    start: Array,
    tolerances: Tolerances,
    deadline: Deadline,
    knots: Knots | None = None,
) -> ToolSegment:
    """Follow a run from a configuration whose tool is where it begins.

    Args:
        chain: The robot; its tip is the tool.
        run: The motions, with the boxes that the tool may be in.
        start: Inside the limits, shape (n,).
        tolerances: How far the tool may be off it, between the configurations too.
        deadline: Time at which to give up.
        knots: Places from 0 to 1 and configurations there, shapes (k,) and (k, n), to which more
            are added where they are needed; None to find them from the start on.
    """
    if knots is None:
        following = _Following(chain, run, ([0.0], [start]), tolerances, deadline)
        return following.spline(following.march())
    places, joints = knots
    following = _Following(chain, run, (places.tolist(), list(joints)), tolerances, deadline)
    following.grade()
    # Times that places are put where the spline leaves the tolerance.
    return following.spline(None, rounds=10)


class _Following:
    """Places s on a motion, from 0 on, and the configurations there."""

    def __init__(
        self,
        chain: Chain,
        run: ToolRun,
        knots: tuple[list[float], list[Array]],
        tolerances: Tolerances,
        deadline: Deadline,
    ) -> None:
        self.places, self.joints = knots
        self._chain, self._run, self._deadline = chain, run, deadline
        self._ends = run.breaks[1:]
        self._tolerances = tolerances
        turns = tolerances.orientation is None
        self._boxes = np.array([pack_tolerance(part.tolerance, turns=turns) for part in run.parts])
        self._limits = np.array([chain.limits.lower, chain.limits.upper])
        inside = self._limits + _INSIDE
        start = self.joints[0]
        self._narrow = np.array([np.minimum(inside[0], start), np.maximum(inside[1], start)])
        self._narrow = np.clip(self._narrow, *self._limits)

    def march(self) -> Stop | None:
        """Go along the motion as far as the arm can; the stop, where that is not the end."""
        step, usual_steps = np.inf, self._find_usual_steps()
        while self.places[-1] < 1.0:
            k = int(np.searchsorted(self._ends, self.places[-1], side="right"))
            step = min(step, usual_steps[k])
            at, end = self.places[-1] + step, float(self._ends[k])
            # A last step of rounding would be one too many.
            at = end if end - at < _LEAST_STEP else at
            q, solved = self._solve([at], self.joints[-1][None])
            if solved[0]:
                self.places.append(at)
                self.joints.append(q[0])
                step *= 2.0
            elif step / 2.0 < _LEAST_STEP or self._deadline.passed:
                return self._explain(at)
            else:
                step /= 2.0
        return None

    def grade(self) -> None:
        """Insert configurations until neighbouring pieces differ little in length.

        A spline swings in a long piece beside short ones.
        """
        # Rounds of halving.
        for _ in range(10):
            lengths = np.diff(self.places)
            # Largest ratio of the lengths of neighbouring pieces.
            long = np.flatnonzero(
                lengths > 3.0 * scipy.ndimage.minimum_filter1d(lengths, 3, mode="nearest")
            )
            places, joints = np.array(self.places), np.array(self.joints)
            at = 0.5 * (places[long] + places[long + 1])
            q, solved = self._solve(at, 0.5 * (joints[long] + joints[long + 1]))
            if not solved.any():
                return
            self.places = np.insert(places, long[solved] + 1, at[solved]).tolist()
            self.joints = list(np.insert(joints, long[solved] + 1, q[solved], axis=0))

    def spline(self, stop: Stop | None, rounds: int | None = None) -> ToolSegment:
        """The spline through the configurations, with more of them where it leaves the tolerance.

        Args:
            stop: Why the configurations end before the motion does, if they do.
            rounds: Times that configurations are put in between at most; None for no end.
        """
        start, reach = self.joints[0], 1
        while True:
            places, joints = self.places, self.joints
            if len(places) < 2 or not np.ptp(joints, axis=0).any():
                reached = places[-1] if stop is not None else 1.0
                return ToolSegment(None, start, start, reached, stop)
            path = _spline(np.array(places), np.array(joints))
            wide = self.deviating_pieces(path)
            if not wide:
                return ToolSegment(path, start, joints[-1], places[-1], stop)
            if rounds == 0:
                return ToolSegment(path, start, joints[-1], 1.0, Stop("deviation", _SHARP, {}))
            if rounds is not None:
                # Where pieces of different lengths meet the spline rings: farther off each time.
                wide = _beside(wide, len(path.lengths), reach)
                rounds, reach = rounds - 1, 2 * reach
            stop = self.insert(path, wide) or stop

    def _find_usual_steps(self) -> list[float]:
        """The first step tried on each part of the run."""
        run, (position, orientation) = self._run, self._tolerances.pair
        if run.length < position and run.angle < orientation:
            return [1.0] * len(run.motions)
        # Longest first step along a motion [m].
        # Largest turn of a first step [rad].
        # Least number of first steps.
        steps = max(run.length / 0.04, run.angle / 0.15, 6)
        usual = 1.0 / float(np.ceil(steps))
        # Least number of first steps along a rounded corner: its speed is then even within 0.5 %.
        return [
            min(usual, (part.end - part.begin) / 9) if part.motion.kind == "corner" else usual
            for part in run.parts
        ]

    def _solve(
        self, places: Sequence[float] | Array, seeds: Array, limits: tuple[Array, ...] = ()
    ) -> tuple[Array, NDArray[np.bool_]]:
        """Configurations at places (k,) nearest to seeds (k, n), at a limit only if need be.

        Args:
            places: Places of the run.
            seeds: Configurations to begin at.
            limits: Limits to keep, of shape (2, n), the narrower first; those of the robot if none.

        Returns:
            The configurations, and whether each is one that goes on from its seed, shape (k,).
        """
        s = np.asarray(places)
        owner = np.minimum(np.searchsorted(self._ends, s, side="right"), len(self._boxes) - 1)
        nominal, boxes, joints = self._run.poses(s), self._boxes[owner], np.array(seeds, order="C")
        solved = np.zeros(len(s), dtype=np.bool_)
        # Errors that may be left, as part of the deviation allowed, and the least and most of them.
        allowed = np.clip([1e-3 * value for value in self._tolerances.pair], 1e-9, REACHED)
        for kept in limits or (self._narrow, self._limits):
            left = np.flatnonzero(~solved)
            if not len(left):
                break
            q = np.ascontiguousarray(seeds[left])
            errors = project(self._chain, nominal[left], boxes[left], kept, q)
            near = np.abs(q - seeds[left]).max(axis=1) <= _JUMP
            joints[left], solved[left] = q, near & (errors <= allowed).all(axis=1)
        return joints, solved

    def deviating_pieces(self, path: JointPath) -> list[int]:
        """Pieces on which the tool is off its motion, or a joint beyond its limit."""
        chain, breaks = self._chain, path.breaks
        position, orientation = self._tolerances.pair
        share = self._tolerances.share
        allowed = (share * position, share * orientation)
        fine = pieces_within(
            chain, self._run, np.array(self.places), breaks, path.coefficients, allowed
        )
        low, high = Trajectory(chain.joint_names, breaks, path.coefficients).piece_extrema()
        wide = np.any((low < chain.limits.lower) | (high > chain.limits.upper), axis=1) | ~fine
        return [int(i) for i in np.flatnonzero(wide)]

    def insert(self, path: JointPath, wide: list[int]) -> Stop | None:
        """Insert a configuration inside each of these pieces; the stop, where that fails.

        Where it fails, the configurations after that place are dropped.
        """
        breaks, pieces = path.breaks, np.array(wide)
        at = 0.5 * (breaks[pieces] + breaks[pieces + 1])
        joints, solved = self._solve(at, path.sample(at))
        solved &= breaks[pieces + 1] - breaks[pieces] >= 2.0 * _LEAST_STEP
        # Configurations on one motion at most.
        solved &= len(self.places) + np.arange(len(at)) < 6000
        if self._deadline.passed:
            solved[:] = False
        count = len(at) if solved.all() else int(np.argmin(solved))
        if count < len(at):
            k = wide[count] + 1
            del self.places[k:], self.joints[k:]
        for piece, place, q in reversed(list(zip(wide, at, joints, strict=True))[:count]):
            self.places.insert(piece + 1, float(place))
            self.joints.insert(piece + 1, q)
        if count == len(at):
            return None
        return self._explain(float(at[count]), between=True)

    def _explain(self, at: float, *, between: bool = False) -> Stop:
        """The reason why the arm can't go on from the last configuration to a place."""
        if self._deadline.passed:
            return TIME
        q = self.joints[-1]
        at_limit = self._limit(q, at)
        if at_limit is not None:
            return at_limit
        is_free = self._tolerances.orientation is None
        # Starts spent on finding out whether a pose can be reached at all.
        options = numeric.SearchOptions(starts=150, axes=POSITION if is_free else AXES)
        stop = no_way_on(self._chain, q[None], slice(3 if is_free else 6))
        beyond, other = out_of_reach(self._chain, self._run.pose(at), options, q)
        if beyond is not None:
            return replace(beyond, details=stop.details | beyond.details)
        if stop.reason == "singularity":
            return stop
        if between:
            return Stop("deviation", _SHARP, stop.details)
        return replace(stop, details=stop.details | {"other_joints": other.tolist()})

    def _limit(self, q: Array, at: float) -> Stop | None:
        """The joint limit without which the arm could go on; None where it could not."""
        none = np.full((2, len(q)), np.inf) * [[-1.0], [1.0]]
        beyond, solved = self._solve([at], q[None], (none,))
        if not solved[0]:
            return None
        limits = self._limits + _INSIDE
        if (limits[0] <= beyond[0]).all() and (beyond[0] <= limits[1]).all():
            return None
        return at_limit(self._chain, beyond[0])


def _beside(chosen: list[int], count: int, reach: int) -> list[int]:
    """Numbers below a count that are chosen, or at most so far from one that is."""
    near = np.zeros(count, dtype=np.bool_)
    near[chosen] = True
    return [int(k) for k in np.flatnonzero(scipy.ndimage.maximum_filter1d(near, 2 * reach + 1))]


def _spline(places: Array, joints: Array) -> JointPath:
    """The cubic spline through configurations (k, n) at places (k,)."""
    if len(places) == 2:
        step = (joints[1] - joints[0]) / (places[1] - places[0])
        zero = np.zeros_like(step)
        return JointPath(np.stack([joints[0], step, zero, zero], -1)[None], np.diff(places))
    c = scipy.interpolate.CubicSpline(places, joints, bc_type="not-a-knot").c[::-1]
    return JointPath(np.ascontiguousarray(np.moveaxis(c, 0, 2)), np.diff(places))
