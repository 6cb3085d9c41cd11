"""Lies about motions: constraints, limits, timing and the tool's deviation."""

from collections.abc import Callable
from typing import Any

import numpy as np

from dynamics.enclosure import Use, tool_speed_use, torque_use
from kinematics.arrays import Array
from kinematics.trajectory.trajectory import Extrema, Peaks, Trajectory
from obstacles.collision.checker import Checker
from planning.constrained.checker import ConstrainedChecker, narrow_rows
from planning.constraints import edge_bounds
from planning.constraints.row import Column
from planning.options import Options, with_limits
from planning.timing.jerk.jerk_limited import time_path_with_jerk
from planning.timing.speed.effort_limits import knot_limits, slow_down
from planning.timing.speed.minimum_time import time_path
from planning.timing.time_scaling import ScaledTime, dilate, fit, peak_ratios
from planning.tool_motions.tool_motion import ToolMotion
from planning.tool_paths.tool_deviation import run_errors
from planning.tool_paths.tool_following import _Following, _spline
from planning.values.limits import EffortLimits
from tests.planning.proof.sabotage.trial import Lie, Sabotage

#: What limits are multiplied by, and ratios to them divided.
TOO_MUCH = 1.05


_LIMITS = frozenset({"velocity", "acceleration", "jerk"})


def _constraint_always_holds(sabotage: Sabotage) -> None:
    sabotage.replace(edge_bounds.edge_kernel, lambda *_: (edge_bounds.EdgeVerdict.HOLDS, 1.0))
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
        rows[:, Column.UPPER] *= 2.0
        rows[:, Column.LOWER] *= 2.0
        return rows

    sabotage.wrap(narrow_rows, wide)


def _constrained_edges_free(sabotage: Sabotage) -> None:
    sabotage.method(ConstrainedChecker, "free", Checker.free)
    sabotage.method(ConstrainedChecker, "curve", Checker.curve)


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
        trajectory, factor, *_ = true(*values, **more)
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


def _deviation_always_fine(sabotage: Sabotage) -> None:
    """Nothing is said to be off, and so no configuration is put in between."""
    sabotage.replace(run_errors, lambda chain, run, owners, T, q: np.zeros((len(T), 2)))


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
    true = ToolMotion.poses

    def bulging(self: ToolMotion, places: Array) -> Array:
        T = np.array(true(self, places))
        T[:, 2, 3] += 2e-3 * np.sin(np.pi * np.asarray(places))
        return T

    sabotage.method(ToolMotion, "poses", bulging)
    _deviation_unseen(sabotage)


MOTION_LIES = (
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
