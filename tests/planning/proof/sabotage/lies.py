"""The lies: each verdict that planners use, and how it is made to be wrong.

A lie is told at the place where planners ask, by every module that knows the verdict by name: where
the certificate asked the same function, it would be lied to as well. Kernels that call kernels are
beyond names; they are lied to by what they are given: a robot or scene packed wrongly, rows that
are too wide, limits that are too high.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from dynamics.enclosure import Use, tool_speed_use, torque_use
from kinematics.arrays import Array
from kinematics.trajectory import Extrema, Peaks, Trajectory
from obstacles.brackets import OUTER
from obstacles.bvh import Tree, tree
from obstacles.checker import Checker, Motion, collision_model
from obstacles.collision_model import CollisionModel, skipped_pairs
from obstacles.piece_set import RADIUS
from obstacles.robot_geometry import RobotGeometry, hulled
from obstacles.scene import Obstacle, Scene
from obstacles.shapes import Box, Cylinder, Shape
from planning.cartesian.tool_following import _Following, _spline
from planning.constrained.checker import ConstrainedChecker, narrow_rows
from planning.constraints import edge_bounds
from planning.constraints.row import LOWER, UPPER
from planning.effort_limits import EffortLimits
from planning.motion_limits import with_limits
from planning.options import Options
from planning.search.shortcut import shortcut
from planning.timing.blend import blend, largest_reaches
from planning.timing.corner_blending import certified_reaches
from planning.timing.effort_limits import knot_limits, slow_down
from planning.timing.jerk_limited import time_path_with_jerk
from planning.timing.minimum_time import time_path
from planning.timing.time_scaling import ScaledTime, dilate, fit, peak_ratios
from planning.tool_deviation import piece_deviations
from planning.tool_motion import ToolMotion
from tests.planning.proof.sabotage.cases import case
from tests.planning.proof.sabotage.trial import Lie, Sabotage

#: What limits are multiplied by, and ratios to them divided.
TOO_MUCH = 1.05
#: What solids are shrunk to.
_SMALLER = 0.3

_COLLISION = frozenset({"collision"})
_LIMITS = frozenset({"velocity", "acceleration", "jerk"})
_BLOCKED = (
    "panda around a post", "ur5e around a wall", "elbow around a post", "dh arm around a post",
)  # fmt: skip
_EVERY_BLOCKED = (
    *_BLOCKED, "panda around a post, jerk limited", "panda around a post, by splines",
    "panda past a post with a margin", "panda unfolding",
)  # fmt: skip


# -------------------------------------------------------------------------- states and edges


def _free(self: Checker, *_: Any) -> Motion:
    return Motion(True, False, 1.0, None, 1.0, 1)


def _state_check(sabotage: Sabotage) -> None:
    """Ends are always valid, and edges leave them to the state check."""
    true = Checker.segment

    def between(self: Checker, start: Array, end: Array) -> Motion:
        return true(self, start + 0.4 * (end - start), end - 0.4 * (end - start))

    sabotage.method(Checker, "valid", lambda self, q: True)
    sabotage.method(Checker, "clearance", lambda self, q: (1.0, None))
    sabotage.method(Checker, "segment", between)
    sabotage.method(Checker, "free", lambda self, start, end: between(self, start, end).free)


def _edge_check(sabotage: Sabotage) -> None:
    sabotage.method(Checker, "free", lambda self, start, end: True)
    sabotage.method(Checker, "segment", _free)
    sabotage.method(Checker, "curve", _free)
    sabotage.method(Checker, "polyline", lambda self, points: (_free(self), len(points) - 1))


def _edge_check_at_ends(sabotage: Sabotage) -> None:
    def segment(self: Checker, start: Array, end: Array) -> Motion:
        if self.valid(start) and self.valid(end):
            return _free(self)
        return Motion(False, True, 0.0, ("one", "other"), -np.inf, 2)

    sabotage.method(Checker, "segment", segment)
    sabotage.method(Checker, "free", lambda self, start, end: segment(self, start, end).free)
    sabotage.method(
        Checker, "curve", lambda self, b0, b1, b2, b3=0.0: segment(self, b0, b0 + b1 + b2 + b3)
    )


# ----------------------------------------------------------------------- what is packed for kernels

#: ``collision_model``, which packs a robot and a scene for every kernel of the planners.
_Pack = Callable[[RobotGeometry, Scene, float], CollisionModel]


def _packed(
    doctored: Callable[[RobotGeometry, Scene, float], tuple[RobotGeometry, Scene, float]],
) -> Callable[[Sabotage], None]:
    """A lie that packs something else than it is given."""

    def pack(
        true: _Pack, robot: RobotGeometry, scene: Scene, margin: float = 0.0
    ) -> CollisionModel:
        return true(*doctored(robot, scene, margin))

    return lambda sabotage: sabotage.wrap(collision_model, pack)


def _shrunk(shape: Shape) -> Shape:
    if isinstance(shape, Box):
        return Box(_SMALLER * shape.size)
    assert isinstance(shape, Cylinder)
    return Cylinder(_SMALLER * shape.radius, shape.height)


def _shrunk_scene(scene: Scene) -> Scene:
    return Scene(tuple(replace(o, shape=_shrunk(o.shape)) for o in scene.obstacles))


def _shrunk_robot(robot: RobotGeometry) -> RobotGeometry:
    pieces = tuple(
        replace(
            piece, vertices=_SMALLER * piece.vertices, radius=_SMALLER * piece.radius,
            half_height=_SMALLER * piece.half_height, surface=None,
        )
        for piece in robot.pieces
    )  # fmt: skip
    return replace(robot, pieces=pieces)


def _without_scene(scene: Scene) -> Scene:
    far = np.diag([1.0, 1.0, 1.0, 1.0])
    far[2, 3] = -50.0
    return Scene(tuple(Obstacle(o.id, o.shape, far) for o in scene.obstacles))


def _own_pairs_allowed(robot: RobotGeometry) -> RobotGeometry:
    names = robot.names
    everything = {(min(a, b), max(a, b)): "srdf" for a in names for b in names if a != b}
    return replace(robot, allowed=everything)


def _small_balls(true: _Pack, robot: RobotGeometry, scene: Scene, margin: float = 0.0) -> Any:
    """The balls that hold solids, which decide first, have no size; spheres that cover likewise."""
    model = true(robot, scene, margin)
    arrays = model.arrays
    rows, around, spheres = (np.array(a) for a in (arrays.robot, arrays.scene, arrays.spheres))
    rows[:, RADIUS], around[:, RADIUS], spheres[:, OUTER] = 0.0, 0.0, 0.0
    doctored = arrays._replace(robot=rows, scene=around, spheres=spheres)
    object.__setattr__(model, "_arrays", doctored)
    return model


def _tree_elsewhere(sabotage: Sabotage) -> None:
    """The boxes over the scene's solids hang fifty metres above them."""

    def grown(true: Callable[..., Tree], low: Array, high: Array, *more: Any) -> Tree:
        up = np.array([0.0, 0.0, 50.0])
        return true(low + up, high + up, *more)

    sabotage.wrap(tree, grown)


# ------------------------------------------------------------------------------------------ pairs


def _pairs_skipped(sabotage: Sabotage) -> None:
    """All pairs with links of which something meets an obstacle in the cases."""

    def skipped(true: Callable[..., Any], robot: RobotGeometry, scene: Scene) -> Any:
        return np.ones_like(true(robot, scene))

    sabotage.wrap(skipped_pairs, skipped)


def _own_pairs_dropped(sabotage: Sabotage) -> None:
    for name in ("panda unfolding",):
        robot = case(name).problem.robot
        sabotage.value(robot, "self_pairs", np.zeros((0, 2), dtype=np.int64))


def _small_hulls(sabotage: Sabotage) -> None:
    sabotage.wrap(hulled, lambda true, robot: _shrunk_robot(true(robot)))


# ------------------------------------------------------------------------------------ constraints


def _constraint_always_holds(sabotage: Sabotage) -> None:
    sabotage.replace(edge_bounds.edge_kernel, lambda *_: (edge_bounds.HOLDS, 1.0))
    sabotage.replace(edge_bounds.edge_holds, lambda *_: True)


def _constraint_bound_dropped(sabotage: Sabotage) -> None:
    """A cell is as good as its middle: the kernel itself, interpreted, with a bound of nothing."""
    slow = edge_bounds.edge_kernel.py_func  # type: ignore[attr-defined]
    true = edge_bounds.bound_kernel

    def bound(*values: Any) -> tuple[float, float]:
        residual, _ = true(*values)
        return residual, residual

    sabotage.replace(edge_bounds.edge_kernel, slow)
    sabotage.replace(edge_bounds.bound_kernel, bound)


def _rows_widened(sabotage: Sabotage) -> None:
    def wide(true: Callable[..., Array], *values: Any) -> Array:
        rows = true(*values)
        rows[:, UPPER] *= 2.0
        rows[:, LOWER] *= 2.0
        return rows

    sabotage.wrap(narrow_rows, wide)


def _constrained_edges_free(sabotage: Sabotage) -> None:
    sabotage.method(ConstrainedChecker, "free", Checker.free)
    sabotage.method(ConstrainedChecker, "curve", Checker.curve)


# ----------------------------------------------------------------------------------------- limits


def _never_slows_down(sabotage: Sabotage) -> None:
    """What was timed for limits half as high again stays as it is."""

    def high(true: Callable[..., Any], limits: EffortLimits, *values: Any, **more: Any) -> Any:
        higher = EffortLimits(
            limits.chain,
            None if limits.effort is None else 1.5 * limits.effort,
            None if limits.tool_speed is None else 1.5 * limits.tool_speed,
        )
        return true(higher, *values, **more)

    sabotage.wrap(knot_limits, high)
    sabotage.replace(slow_down, lambda limits, dilated: dilated)


def _use_understated(sabotage: Sabotage) -> None:
    def less(true: Callable[..., Use], *values: Any) -> Use:
        use = true(*values)
        return use._replace(ratio=use.ratio / TOO_MUCH)

    sabotage.wrap(torque_use, less)
    sabotage.wrap(tool_speed_use, less)


def _limits_dropped(sabotage: Sabotage) -> None:
    """Constraints on torque and tool speed do not reach the timing."""

    def dropped(options: Options, constraints: Any) -> Options:
        return options

    sabotage.replace(with_limits, dropped)


def _limits_raised(sabotage: Sabotage) -> None:
    """Timing is given higher limits than the certificate."""

    def raised(true: Callable[..., Any], path: Any, names: Any, *limits: Any, **more: Any) -> Any:
        return true(path, names, *(TOO_MUCH * np.asarray(limit) for limit in limits), **more)

    def raised_fit(true: Callable[..., Any], motion: Trajectory, *limits: Any, **more: Any) -> Any:
        higher = {name: TOO_MUCH * np.asarray(value) for name, value in more.items()}
        return true(motion, *(TOO_MUCH * np.asarray(limit) for limit in limits), **higher)

    sabotage.wrap(time_path, raised)
    sabotage.wrap(time_path_with_jerk, raised)
    sabotage.wrap(fit, raised_fit)


def _dilation_too_small(sabotage: Sabotage) -> None:
    """What is slowed down to its limits is sped up again."""

    def hasty(true: Callable[..., ScaledTime], *values: Any, **more: Any) -> ScaledTime:
        trajectory, factor = true(*values, **more)
        return ScaledTime(trajectory.dilate(1.0 / TOO_MUCH), factor / TOO_MUCH)

    sabotage.wrap(dilate, hasty)
    sabotage.wrap(fit, hasty)


def _ratios_understated(sabotage: Sabotage) -> None:
    """The peaks that timing asks for, of limits that are higher."""

    def less(true: Callable[..., Array], *values: Any) -> Array:
        return true(*values) / TOO_MUCH

    def raised(true: Callable[..., Any], path: Any, names: Any, *limits: Any, **more: Any) -> Any:
        return true(path, names, *(TOO_MUCH * np.asarray(limit) for limit in limits), **more)

    sabotage.wrap(peak_ratios, less)
    sabotage.wrap(time_path, raised)


def _peaks_understated(sabotage: Sabotage) -> None:
    """A trajectory says less of its own derivatives than is true."""
    peaks, extrema = Trajectory.peaks, Trajectory.extrema

    def low_peaks(self: Trajectory, derivative: int = 0) -> Peaks:
        value, time = peaks(self, derivative)
        return Peaks(value / (TOO_MUCH if derivative else 1.0), time)

    def low_extrema(self: Trajectory, derivative: int = 0) -> Extrema:
        low, low_time, high, high_time = extrema(self, derivative)
        share = TOO_MUCH if derivative else 1.0
        return Extrema(low / share, low_time, high / share, high_time)

    sabotage.method(Trajectory, "peaks", low_peaks)
    sabotage.method(Trajectory, "extrema", low_extrema)
    _ratios_understated(sabotage)


# --------------------------------------------------------------------------- shortcuts and corners


def _shortcut_to_the_end(sabotage: Sabotage) -> None:
    sabotage.replace(shortcut, lambda checker, waypoints, deadline: waypoints[[0, -1]])


def _shortcut_in_an_empty_scene(sabotage: Sabotage) -> None:
    def blind(true: Callable[..., Array], checker: Checker, *values: Any) -> Array:
        model = checker.model
        empty = CollisionModel(model.robot, _without_scene(model.scene), model.margin)
        return true(Checker(empty, checker.slack), *values)

    sabotage.wrap(shortcut, blind)


def _corners_rounded_fully(sabotage: Sabotage) -> None:
    def fully(checker: Checker, waypoints: Array, *_: Any, **__: Any) -> Array:
        return largest_reaches(waypoints)

    sabotage.replace(certified_reaches, fully)


def _corners_rounded_wider(sabotage: Sabotage) -> None:
    """A corner is rounded four times as wide as was asked for."""

    def wider(
        true: Callable[..., Any], waypoints: Any, reaches: Any, *more: Any, **how: Any
    ) -> Any:
        wide = np.minimum(4.0 * np.asarray(reaches), largest_reaches(waypoints))
        return true(waypoints, wide, *more, **how)

    sabotage.wrap(blend, wider)


# ------------------------------------------------------------------------------------- tool motions


def _deviation_always_fine(sabotage: Sabotage) -> None:
    """Nothing is said to be off, and so no configuration is put in between."""

    def fine(chain: Any, breaks: Array, *_: Any) -> tuple[Array, Any, Array]:
        pieces = len(breaks) - 1
        return np.zeros((pieces, 2)), np.ones(pieces, dtype=np.bool_), np.zeros(pieces)

    sabotage.replace(piece_deviations, fine)


def _deviation_unseen(sabotage: Sabotage) -> None:
    sabotage.method(_Following, "deviating_pieces", lambda self, path: [])


def _knots_left_out(sabotage: Sabotage) -> None:
    """Of the configurations on a line only every third becomes a knot of the spline."""

    def sparse(true: Callable[..., Any], places: Array, joints: Array) -> Any:
        chosen = np.unique([*range(0, len(places), 3), len(places) - 1])
        return true(places[chosen], joints[chosen])

    sabotage.wrap(_spline, sparse)
    _deviation_unseen(sabotage)


def _poses_beside_the_line(sabotage: Sabotage) -> None:
    """Between its ends a line bulges by two millimetres."""
    true = ToolMotion.pose

    def bulging(self: ToolMotion, s: float) -> Array:
        T = np.array(true(self, s))
        T[2, 3] += 2e-3 * np.sin(np.pi * s)
        return T

    sabotage.method(ToolMotion, "pose", bulging)
    _deviation_unseen(sabotage)


LIES = (
    Lie("state check", "always valid", _state_check,
        ("panda starting in a box", "panda ending in a box"), _COLLISION),
    Lie("edge check", "always free", _edge_check,
        (*_EVERY_BLOCKED, "panda along a blocked line"), _COLLISION),
    Lie("edge check", "looks at the ends alone", _edge_check_at_ends, _EVERY_BLOCKED, _COLLISION),
    Lie("packed scene", "obstacles shrunk", _packed(lambda r, s, m: (r, _shrunk_scene(s), m)),
        (*_BLOCKED, "ur5e around a wall, by random trees"), _COLLISION),
    Lie("packed scene", "an obstacle dropped", _packed(lambda r, s, m: (r, _without_scene(s), m)),
        (*_BLOCKED, "hook over a bar"), _COLLISION),
    Lie("packed robot", "solids shrunk", _packed(lambda r, s, m: (_shrunk_robot(r), s, m)),
        _BLOCKED, _COLLISION),
    Lie("packed robot", "balls around solids shrunk",
        lambda sabotage: sabotage.wrap(collision_model, _small_balls), _BLOCKED, _COLLISION),
    Lie("margin", "taken for 0", _packed(lambda r, s, m: (r, s, 0.0)),
        ("panda past a post with a margin",), _COLLISION),
    Lie("hull cover", "smaller than what it holds", _small_hulls, ("hook over a bar",),
        _COLLISION),
    Lie("pair choice", "obstacles skipped", _pairs_skipped, (*_BLOCKED, "hook over a bar"),
        _COLLISION),
    Lie("pair choice", "own pairs allowed",
        _packed(lambda r, s, m: (_own_pairs_allowed(r), s, m)), ("panda unfolding",), _COLLISION),
    Lie("shortcut", "straight to the end", _shortcut_to_the_end, _BLOCKED, _COLLISION),
    Lie("shortcut", "in an empty scene", _shortcut_in_an_empty_scene, _BLOCKED, _COLLISION),
    Lie("corner blending", "every corner rounded fully", _corners_rounded_fully,
        ("panda around a post", "ur5e around a wall", "elbow around a post"), _COLLISION),
    Lie("corner blending", "corners rounded wider than proved", _corners_rounded_wider,
        ("panda around a post", "ur5e around a wall", "elbow around a post"), _COLLISION),
    Lie("constraint bound", "always holds", _constraint_always_holds,
        ("panda upright", "ur5e level"),
        frozenset({"constraint"})),
    Lie("constraint bound", "only the middle of a cell counts", _constraint_bound_dropped,
        ("ur5e level",), frozenset({"constraint"})),
    Lie("constraint bound", "rows twice as wide", _rows_widened, ("panda upright", "ur5e level"),
        frozenset({"constraint"})),
    Lie("constraint bound", "edges not asked", _constrained_edges_free,
        ("panda upright", "ur5e level"),
        frozenset({"constraint"})),
    Lie("limit slow-down", "never slows down", _never_slows_down,
        ("ur5e with weak joints", "ur5e with weak joints, by splines", "ur5e with a slow tool"),
        frozenset({"torque", "tool_speed"})),
    Lie("timing", "limits scaled by 1.05", _limits_raised,
        ("panda around a post", "panda around a post, jerk limited",
         "panda around a post, by splines", "panda along a line"), _LIMITS),
    Lie("timing dilation", "5 % too fast", _dilation_too_small,
        ("panda around a post", "panda around a post, by splines"), _LIMITS),
    Lie("timing dilation", "ratios understated by 1.05", _ratios_understated,
        ("panda around a post", "panda around a post, by splines"), _LIMITS),
    Lie("packed scene", "box tree elsewhere", _tree_elsewhere, _BLOCKED, _COLLISION),
    Lie("pair choice", "own pairs dropped", _own_pairs_dropped, ("panda unfolding",), _COLLISION),
    Lie("limit slow-down", "use understated by 1.05", _use_understated,
        ("ur5e with weak joints, by splines", "panda with a slow tool, jerk limited"),
        frozenset({"torque", "tool_speed"})),
    Lie("limit slow-down", "constraints not passed on", _limits_dropped,
        ("ur5e with constraints on speed and torque",), frozenset({"tool_speed"})),
    Lie("trajectory extrema", "peaks understated by 1.05", _peaks_understated,
        ("panda around a post", "panda around a post, by splines"), _LIMITS),
    Lie("tool deviation", "always fine", _deviation_always_fine,
        ("panda along a line", "panda along a line, by splines"), frozenset({"deviation"})),
    Lie("tool deviation", "pieces that are off unseen", _deviation_unseen,
        ("panda along a line", "panda along a line, by splines"), frozenset({"deviation"})),
    Lie("tool interpolation", "knots left out", _knots_left_out,
        ("panda along a line", "panda along a line, by splines"), frozenset({"deviation"})),
    Lie("tool interpolation", "poses beside the line", _poses_beside_the_line,
        ("panda along a line",), frozenset({"deviation"})),
)  # fmt: skip
