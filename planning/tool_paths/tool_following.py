"""Joint paths that keep the tool on its motion: one branch of inverse kinematics, followed.

From the configuration at hand the numeric method goes to the next pose along the motion, starting
where it is: so it stays in its branch. Steps are halved where it fails or the joints jump. Through
the configurations goes a cubic spline in s, whose second derivative is continuous, so that every
method can time it; where the spline takes the tool too far off, more configurations are put in
between. What limits the joints is reported where no step is small enough.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline

from kinematics.arrays import Array
from kinematics.ik.numeric import numeric
from kinematics.ik.numeric.numeric import AXES, POSITION, Axis
from kinematics.jacobian import pose_and_jacobian
from kinematics.model.chain import Chain, Limits
from kinematics.pose import rotation_error
from kinematics.trajectory.trajectory import Trajectory
from obstacles.collision.checker import Checker
from planning.timing.path.path import JointPath
from planning.tool_motions.tool_motion import ToolMotion
from planning.tool_motions.tool_path import Stop, Tolerances, ToolPath, ToolRun, ToolSegment, run_of
from planning.tool_paths.tool_deviation import pieces_within
from planning.values.deadline import Deadline

#: A joint that moves more than this in one step [rad or m] may have changed its branch.
_JUMP = 0.35
#: Steps below this part of a motion tell that it can't be followed any further.
_LEAST_STEP = 1e-5
#: The solver keeps this far inside the joint limits [rad or m], for the spline between its answers.
_INSET = 1e-4
#: Least singular value, as part of the largest, below which an arm counts as singular.
_SINGULAR = 1e-2


def lead_tool(
    chain: Chain,
    checker: Checker,
    start: Array,
    motions: Sequence[ToolMotion | ToolRun],
    tolerances: Tolerances,
    deadline: Deadline,
) -> ToolPath:
    """Lead the tool along motions from a configuration, as far as can be proved free.

    Each motion begins where the one before ends, the first at the tool's pose in ``start``. The
    joints stay in one branch: they never jump. Between the configurations found by inverse
    kinematics the tool is within the tolerances too, which is proved, not sampled.

    Args:
        chain: The robot; its tip is the tool.
        checker: The robot in its scene.
        start: Free and inside the limits, shape (n,).
        motions: Lines and arcs, at least one, or runs of them without a rest.
        tolerances: How far the tool may be off them.
        deadline: Time at which to give up.
    """
    segments: list[ToolSegment] = []
    q = start
    for motion in motions:
        segment = free_part(checker, follow(chain, motion, q, tolerances, deadline))
        segments.append(segment)
        q = segment.end
        if segment.stop is not None:
            break
    last = segments[-1]
    counts = [len(run_of(motion).motions) for motion in motions]
    done = sum(counts[: len(segments) - 1]) + _completed(run_of(motions[len(segments) - 1]), last)
    begun = tuple(motions[: len(segments)])
    return ToolPath(begun, tuple(segments), done / sum(counts), last.stop, tolerances)


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
            return segment.cut(at + clear, Stop(at + clear, "collision", text, details))
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
    motion: ToolMotion | ToolRun,
    start: Array,
    tolerances: Tolerances,
    deadline: Deadline,
) -> ToolSegment:
    """Follow a motion of the tool from a configuration whose tool is where it begins.

    Args:
        chain: The robot; its tip is the tool.
        motion: The motion, or several that are run through without a rest.
        start: Inside the limits, shape (n,).
        tolerances: How far the tool may be off it, between the configurations too.
        deadline: Time at which to give up.
    """
    following = _Following(chain, run_of(motion), start, tolerances, deadline)
    stop = following.march()
    while True:
        places, joints = following.places, following.joints
        if len(places) < 2 or not np.ptp(joints, axis=0).any():
            reached = places[-1] if stop is not None else 1.0
            return ToolSegment(None, start, start, reached, stop)
        path = _spline(np.array(places), np.array(joints))
        wide = following.deviating_pieces(path)
        if not wide:
            return ToolSegment(path, start, joints[-1], places[-1], stop)
        stop = following.insert(path, wide) or stop


class _Following:
    """Places s on a motion, from 0 on, and the configurations there."""

    def __init__(
        self,
        chain: Chain,
        run: ToolRun,
        start: Array,
        tolerances: Tolerances,
        deadline: Deadline,
    ) -> None:
        self.places, self.joints = [0.0], [start]
        self._chain, self._run, self._deadline = chain, run, deadline
        self._ends = run.breaks[1:]
        self._tolerances = tolerances
        self._usual_steps = self._find_usual_steps()
        self._narrow = replace(chain, limits=_narrow_limits(chain.limits, start))

    def march(self) -> Stop | None:
        """Go along the motion as far as the arm can; the stop, where that is not the end."""
        step = np.inf
        while self.places[-1] < 1.0:
            k = int(np.searchsorted(self._ends, self.places[-1], side="right"))
            step = min(step, self._usual_steps[k])
            at, end = self.places[-1] + step, float(self._ends[k])
            # A last step of rounding would be one too many.
            at = end if end - at < _LEAST_STEP else at
            target = self._run.pose(at)
            q = self._solve_inside(target, self._predict(target))
            if q is not None and np.abs(q - self.joints[-1]).max() <= _JUMP:
                self.places.append(at)
                self.joints.append(q)
                step *= 2.0
            elif step / 2.0 < _LEAST_STEP or self._deadline.passed:
                return self._explain(len(self.places) - 1, at)
            else:
                step /= 2.0
        return None

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

    def _predict(self, target: Array) -> Array:
        """The joints after the least motion that moves the tool as asked, to first order."""
        q = self.joints[-1]
        T, J = pose_and_jacobian(self._chain, q)
        error = target[:3, 3] - T[:3, 3]
        if self._tolerances.orientation is None:
            J = J[:3]
        else:
            error = np.concatenate([error, rotation_error(T[:3, :3], target[:3, :3])])
        step = np.linalg.lstsq(J, error, rcond=_SINGULAR)[0]
        limits = self._narrow.limits
        return np.asarray(np.clip(q + step, limits.lower, limits.upper))

    def _solve_inside(self, target: Array, seed: Array) -> Array | None:
        """The solution nearest to the seed, at a limit only if there is no other."""
        q = self._solve(self._narrow, target, seed)
        return q if q is not None else self._solve(self._chain, target, seed)

    def _solve(self, chain: Chain, target: Array, seed: Array) -> Array | None:
        position, orientation = _solver_tolerances(self._tolerances)
        options = numeric.SearchOptions(
            starts=1,
            position_tolerance=position,
            orientation_tolerance=orientation,
            axes=_axes(self._tolerances),
        )
        result = numeric.solve(chain, target, options, seed_joints=seed)
        return result.solutions[0].joints if result.solutions else None

    def deviating_pieces(self, path: JointPath) -> list[int]:
        """Pieces on which the tool is off its motion, or a joint beyond its limit."""
        chain, breaks = self._chain, path.breaks
        position, orientation = self._tolerances.pair
        # A tenth of the deviation allowed is left to what lies between samples.
        share = (0.9 * position, 0.9 * orientation)
        fine = pieces_within(
            chain, self._run, np.array(self.places), breaks, path.coefficients, share
        )
        low, high = Trajectory(chain.joint_names, breaks, path.coefficients).piece_extrema()
        outside = np.any((low < chain.limits.lower) | (high > chain.limits.upper), axis=1)
        return [int(i) for i in np.flatnonzero(outside | ~fine)]

    def insert(self, path: JointPath, wide: list[int]) -> Stop | None:
        """Insert a configuration in the middle of these pieces; the stop, where that fails.

        Where it fails, the configurations after that place are dropped.
        """
        breaks = path.breaks
        for piece in wide:
            at = 0.5 * float(breaks[piece] + breaks[piece + 1])
            k = int(np.searchsorted(self.places, at))
            q = None
            narrow = breaks[piece + 1] - breaks[piece] < 2.0 * _LEAST_STEP
            # Configurations on one motion at most.
            if not (narrow or self._deadline.passed or len(self.places) >= 6000):
                seed = path.sample([at])[0]
                q = self._solve_inside(self._run.pose(at), seed)
            if q is None or np.abs(q - seed).max() > _JUMP:
                del self.places[k:], self.joints[k:]
                return self._explain(k - 1, at, between=True)
            self.places.insert(k, at)
            self.joints.insert(k, q)
        return None

    def _explain(self, k: int, at: float, *, between: bool = False) -> Stop:
        """The reason why the arm can't go on from its k-th place."""
        reached, q = self.places[k], self.joints[k]
        if self._deadline.passed:
            return Stop(reached, "time", "time was up", {})
        at_limit = self._limit_stop(reached, q, at)
        if at_limit is not None:
            return at_limit
        values = self._singular_values(q)
        details: dict[str, Any] = {"smallest_singular_value": float(values[-1])}
        # Starts spent on finding out whether a pose can be reached at all.
        options = numeric.SearchOptions(starts=150, axes=_axes(self._tolerances))
        other = numeric.solve(self._chain, self._run.pose(at), options, seed_joints=q)
        if not other.solutions:
            nearest = other.nearest
            details["position_error"] = nearest.position_error
            details["orientation_error"] = nearest.orientation_error
            return Stop(reached, "unreachable", "the arm does not reach any farther", details)
        if values[-1] < _SINGULAR * values[0]:
            text = f"the arm is singular here (smallest singular value {values[-1]:.3g})"
            return Stop(reached, "singularity", text, details)
        if between:
            text = "the joints would have to turn too sharply to keep the tool within max_deviation"
            return Stop(reached, "deviation", text, details)
        details["other_joints"] = other.solutions[0].joints.tolist()
        text = "the arm could only go on in another branch of its inverse kinematics"
        return Stop(reached, "branch", text, details)

    def _limit_stop(self, reached: float, q: Array, at: float) -> Stop | None:
        """The stop at a joint limit, where the arm could go on without it."""
        chain = self._chain
        n, limits = chain.n, chain.limits
        endless = replace(limits, lower=np.full(n, -np.inf), upper=np.full(n, np.inf))
        beyond = self._solve(replace(chain, limits=endless), self._run.pose(at), q)
        if beyond is None or np.abs(beyond - q).max() > _JUMP:
            return None
        below, above = limits.lower + _INSET - beyond, beyond - limits.upper + _INSET
        j = int(np.argmax(np.maximum(below, above)))
        if max(below[j], above[j]) <= 0.0:
            return None
        which = "lower" if below[j] > above[j] else "upper"
        limit, name = float(getattr(limits, which)[j]), chain.joint_names[j]
        details = {"joint": name, "limit": limit, "value": float(q[j])}
        text = f"joint {name!r} comes to its {which} limit {limit:.6g}"
        return Stop(reached, "limit", text, details)

    def _singular_values(self, q: Array) -> Array:
        """Singular values of the Jacobian's rows that count and are not always 0, largest first."""
        _, J = pose_and_jacobian(self._chain, q)
        rows = J[:3] if self._tolerances.orientation is None else J
        # Rows of the Jacobian below this are 0: no joint moves the tool that way.
        some = rows[np.linalg.norm(rows, axis=1) > 1e-9]
        return np.asarray(np.linalg.svd(some if len(some) else rows, compute_uv=False))


def _axes(tolerances: Tolerances) -> tuple[Axis, ...]:
    """The axes of a pose that inverse kinematics has to reach."""
    return POSITION if tolerances.orientation is None else AXES


def _solver_tolerances(tolerances: Tolerances) -> tuple[float, float]:
    """Errors that inverse kinematics may leave [m], [rad]."""
    # Tolerance of inverse kinematics, as part of the deviation allowed.
    # Smallest tolerance of inverse kinematics [m or rad].
    # Largest tolerance of inverse kinematics [m or rad].
    fine = np.clip([1e-3 * value for value in tolerances.pair], 1e-10, 1e-6)
    return float(fine[0]), float(fine[1])


def _narrow_limits(limits: Limits, start: Array) -> Limits:
    """Joint limits a little narrower, but for joints that start nearer to them."""
    lower, upper = limits.lower + _INSET, limits.upper - _INSET
    lower = np.maximum(np.minimum(lower, start), limits.lower)
    upper = np.minimum(np.maximum(upper, start), limits.upper)
    return replace(limits, lower=lower, upper=upper)


def _spline(places: Array, joints: Array) -> JointPath:
    """The cubic spline through configurations (k, n) at places (k,)."""
    if len(places) == 2:
        step = (joints[1] - joints[0]) / (places[1] - places[0])
        zero = np.zeros_like(step)
        return JointPath(np.stack([joints[0], step, zero, zero], -1)[None], np.diff(places))
    c = CubicSpline(places, joints, bc_type="not-a-knot").c[::-1]
    return JointPath(np.ascontiguousarray(np.moveaxis(c, 0, 2)), np.diff(places))
