"""Corners between tool motions, rounded by a curve of continuous curvature or by two arcs each.

The tool leaves a motion at a distance b before its corner and joins the next one b after it: by
``planning.tool_motions.tool_corner``, or, where it may deviate within a box of tolerances along
lines and arcs, by two circular arcs. They run between the two points p_0, p_1 with the directions
t_0, t_1 and meet with one tangent at

    p = (p_0 + p_1 + d (t_0 - t_1)) / 2,   v = p_1 - p_0,
    2 (1 - t_0 t_1) d^2 + 2 d v (t_0 + t_1) - v^2 = 0,  d > 0,

a biarc. Between lines of which equal parts are cut both are parts of one circle.

Source: Juckett, "Biarc Interpolation" (2014).
"""

import math
from collections.abc import Sequence

import numpy as np

from kinematics.arrays import Array
from kinematics.pose import from_axis_angle, rotation_error, transform
from planning.tool_motions.tool_corner import ToolCurve, angle_between, part_of, rounded_corner
from planning.tool_motions.tool_motion import ToolMotion, arc_about, line, without_spin
from planning.tool_motions.tool_path import ToolRun

#: Corners sharper than this are reversals: a blend would be narrower than it is long [rad].
_REVERSAL = math.radians(170.0)
#: Corners flatter than this are run through without a blend, within a tolerance [rad].
FLAT_CORNER = math.radians(30.0)
#: Motions and blends shorter than this are none [m].
_SHORTEST = 1e-6


def runs(
    motions: Sequence[ToolMotion],
    blends: Sequence[float],
    *,
    arcs: bool = False,
    axis_only: Sequence[bool] = (),
) -> tuple[ToolRun, ...]:
    """Runs without a rest, with corners rounded where a blend is asked for.

    Args:
        motions: Motions in order, k of them, each from where the one before ends.
        blends: Distance from the end of each motion at which the tool may leave it [m], shape (k,);
            0 for a rest, with arcs at corners that are not flat. At most half of both motions is
            cut; the last one is not used.
        arcs: Whether corners are rounded by arcs, else without a jump of curvature.
        axis_only: Whether of each motion at its end only the tool's axis z is asked for, which
            alone is led through the corner then; with arcs.

    Returns:
        One run from each rest to the next. The tool rests at reversals and at turns on the spot
        too.
    """
    distances = [
        _distance(a, b, blend, arcs=arcs)
        for a, b, blend in zip(motions[:-1], motions[1:], blends[:-1], strict=True)
    ]
    finished: list[ToolRun] = []
    parts: list[tuple[ToolCurve, int, bool]] = []
    before = 0.0
    for k, motion in enumerate(motions):
        after = distances[k] if k < len(distances) else None
        kept = _cut(motion, before, after or 0.0)
        if kept is not None:
            parts.append((kept, k, False))
        if after is None:
            finished.append(_run(parts))
            parts, before = [], 0.0
            continue
        if after > 0.0 and not arcs:
            parts.append((rounded_corner(motion, motions[k + 1], after), k, True))
        elif after > 0.0:
            spins = not (axis_only and axis_only[k])
            arcs_of_corner = _biarc(motion, motions[k + 1], after, spins=spins)
            parts += [(arc, k, True) for arc in arcs_of_corner]
        before = after
    return tuple(finished)


def _run(parts: list[tuple[ToolCurve, int, bool]]) -> ToolRun:
    motions, asked, blends = zip(*parts, strict=True)
    return ToolRun(motions, asked, blends)


def _distance(first: ToolMotion, second: ToolMotion, blend: float, *, arcs: bool) -> float | None:
    """Distance from a corner at which its blend begins [m]; None where the tool rests."""
    shorter = min(first.length, second.length)
    if shorter < _SHORTEST:
        return None
    angle = corner_angle(first, second)
    # Corners flatter than this need no rest between arcs within a tolerance.
    unblended = 0.0 if arcs and angle <= FLAT_CORNER else None
    # Directions that differ by less go on in each other without a blend [rad].
    if blend > 0.0 and angle <= 1e-6 and (arcs or _go_on_alike(first, second)):
        return 0.0
    # Share of a motion that the blend of one of its corners may take.
    distance = min(blend, 0.5 * shorter)
    return unblended if angle > _REVERSAL or distance < _SHORTEST else distance


def _go_on_alike(first: ToolMotion, second: ToolMotion) -> bool:
    """Whether a motion ends with the curvature and rate of turning that the next begins with."""
    rates = [
        (_curvature(motion, s), motion.turn / motion.length)
        for motion, s in ((first, 1.0), (second, 0.0))
    ]
    # Rates of turning and curvatures that differ by less are the same [rad/m], [1/m].
    return all(np.abs(a - b).max() <= 1e-6 for a, b in zip(*rates, strict=True))


def _curvature(motion: ToolMotion, s: float) -> Array:
    """Curvature vector at a place, shape (3,) [1/m]."""
    if motion.kind == "lin":
        return np.zeros(3)
    return np.asarray(np.cross(motion.normal, motion.direction(s)) / motion.radius)


def _cut(motion: ToolMotion, before: float, after: float) -> ToolMotion | None:
    """A motion without lengths at its start and end [m]; None where nothing is left."""
    length = motion.length
    if before == after == 0.0:
        return motion
    if length - before - after < _SHORTEST:
        return None
    return part_of(motion, before / length, 1.0 - after / length)


def _biarc(
    first: ToolMotion, second: ToolMotion, distance: float, *, spins: bool
) -> list[ToolMotion]:
    """The two arcs from a motion to the next, at a distance from their corner [m]."""
    s_first, s_second = 1.0 - distance / first.length, distance / second.length
    T_start, T_end = first.pose(s_first), second.pose(s_second)
    if not spins:
        T_end = without_spin(T_start, T_end)
    start, end = first.direction(s_first), second.direction(s_second)
    between = _meeting_point(T_start[:3, 3], start, T_end[:3, 3], end)
    # The orientation turns in proportion to the length: half way at the meeting point, nearly.
    lengths = [np.linalg.norm(between - T[:3, 3]) for T in (T_start, T_end)]
    turn = rotation_error(T_start[:3, :3], T_end[:3, :3])
    angle = float(np.linalg.norm(turn))
    R = T_start[:3, :3]
    if angle > 0.0:
        R = from_axis_angle(turn / angle, angle * float(lengths[0] / sum(lengths))) @ R
    T = transform(R, between)
    flipped = _arc(T_end, -end, T)
    return [_arc(T_start, start, T), _reverse(flipped)]


def _meeting_point(p: Array, t: Array, r: Array, u: Array) -> Array:
    """Point where the two arcs of a biarc meet, shape (3,) [m].

    Args:
        p: First point, shape (3,) [m].
        t: Direction there, of length 1, shape (3,).
        r: Last point, shape (3,) [m].
        u: Direction there, of length 1, shape (3,).
    """
    v = r - p
    a, b, c = 2.0 * (1.0 - float(t @ u)), 2.0 * float(v @ (t + u)), float(v @ v)
    # The root in the form that does not cancel; a is positive at corners.
    d = 2.0 * c / (b + math.sqrt(b * b + 4.0 * a * c))
    return np.asarray(0.5 * (p + r + d * (t - u)))


def _arc(T_start: Array, tangent: Array, T_end: Array) -> ToolMotion:
    """The arc from a pose in a direction to another pose; a line where it is straight."""
    start, way = T_start[:3, 3], T_end[:3, 3] - T_start[:3, 3]
    axis = np.cross(tangent, way)
    size, length = float(np.linalg.norm(axis)), float(np.linalg.norm(way))
    # Sine of the angle between a direction and a chord below which an arc is a line.
    if size <= 1e-9 * length:
        return line(T_start, T_end)
    normal = axis / size
    inward = np.cross(normal, tangent)
    center = start + inward * (length * length / (2.0 * float(inward @ way)))
    return arc_about(T_start, T_end, center, normal)


def _reverse(motion: ToolMotion) -> ToolMotion:
    """A motion the other way round."""
    if motion.kind == "lin":
        return line(motion.T_end, motion.T_start)
    return arc_about(motion.T_end, motion.T_start, motion.center, -motion.normal)


def corner_angle(first: ToolCurve, second: ToolCurve) -> float:
    """Angle between the directions in which two motions meet [rad]."""
    return angle_between(first.direction(1.0), second.direction(0.0))
