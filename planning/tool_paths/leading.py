"""Joint paths that lead the tool along several motions, proved free."""

from collections.abc import Sequence

import numpy as np

from kinematics.arrays import Array
from kinematics.model.chain import Chain
from obstacles.collision.checker import Checker
from planning.tool_motions.tool_motion import ToolMotion
from planning.tool_motions.tool_path import Stop, Tolerances, ToolPath, ToolSegment
from planning.tool_motions.tool_run import ToolRun, run_of
from planning.tool_paths.tool_following import follow
from planning.values.deadline import Deadline

#: Bisections of the stretch on which a motion meets something, to come near to it.
_BISECTIONS = 12


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
        deadline: When to give up.
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
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        free = middle > 0.0 and checker.curve(*_first_part(piece, middle)).free
        low, high = (middle, high) if free else (low, middle)
    return low
