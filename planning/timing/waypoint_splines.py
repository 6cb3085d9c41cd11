"""Splines of time through the waypoints of a path, which leave it between them.

With more waypoints on its legs a spline keeps nearer to the path.
"""

from collections.abc import Callable, Iterator
from functools import partial

import numpy as np

from kinematics.arrays import Array
from kinematics.errors import InvalidOption
from planning.timing.failure import TimingFailed
from planning.timing.options import TimingOptions
from planning.timing.parametrization import TimeParametrization
from planning.timing.spline.spline import Ends
from planning.timing.time_scaling import ScaledTime
from planning.values.limits import RATIO_TOLERANCE

# Velocity at an end that still counts as rest [rad/s or m/s].
_REST = 1e-9
#: How often the legs of a path are halved to bring a spline nearer to them.
_HALVINGS = 5


def waypoint_splines(
    points: Array,
    parametrization: TimeParametrization,
    timing: TimingOptions,
    names: tuple[str, ...],
) -> Iterator[Callable[[], ScaledTime]]:
    """Splines to be tried in turn, with ever more waypoints.

    Args:
        points: A polyline proved free, no two neighbours equal, shape (k, n).
        parametrization: The method and the limits.
        timing: What else was asked of the timing.
        names: Of the joints.

    Raises:
        InvalidOption: Times that do not fit the waypoints, or a natural spline, whose ends move.
    """
    ends: Ends = "natural" if timing.interpolation == "natural_spline" else "clamped"
    times = None if timing.times is None else np.array(timing.times, dtype=np.float64)
    if times is not None and len(times) != len(points):
        raise InvalidOption(
            f"timing.times has {len(times)} values, the path that was found has {len(points)} "
            "waypoints",
            hint="Leave times out, or time a path of your own by POST /v1/retime.",
            waypoints=points.tolist(),
        )
    if ends == "natural":
        _refuse_moving_ends(_spline(points, times, ends, parametrization, timing, names))
    for _ in range(_HALVINGS + 1):
        yield partial(_spline, points, times, ends, parametrization, timing, names)
        points = _halve(points)
        times = None if times is None else _halve(times[:, None])[:, 0]


def _refuse_moving_ends(timed: ScaledTime) -> None:
    """Refuse a natural spline, whose ends move: a plan begins and ends at rest."""
    motion = timed.trajectory
    start, end = motion.sample([0.0, motion.duration], 1)
    for label, velocity in (("begin", start), ("end", end)):
        j = int(np.argmax(np.abs(velocity)))
        if abs(velocity[j]) > _REST:
            raise InvalidOption(
                f"a natural spline would {label} with {velocity[j]:.6g} in joint "
                f"{motion.joint_names[j]!r}, and a plan begins and ends at rest",
                hint="Ask for clamped_spline, or time the path by POST /v1/retime, which takes "
                "boundary velocities.",
                start_velocity=start.tolist(),
                end_velocity=end.tolist(),
            )


def _spline(
    points: Array,
    times: Array | None,
    ends: Ends,
    parametrization: TimeParametrization,
    timing: TimingOptions,
    names: tuple[str, ...],
) -> ScaledTime:
    timed = parametrization.time_spline(points, times, ends, names, timing.scale_times)
    checked = times is not None and not timing.scale_times
    factor = parametrization.needed_factor(timed.trajectory) if checked else 1.0
    if factor > 1.0 + RATIO_TOLERANCE:
        raise TimingFailed(
            f"the times given are too short: limits are kept by times {factor:.9g} times as long",
            hint="Give longer times, or ask for scale_times.",
            factor=factor,
        )
    return timed


def _halve(rows: Array) -> Array:
    """Insert the middle of each two neighbours between them."""
    answer = np.empty((2 * len(rows) - 1, rows.shape[1]))
    answer[::2], answer[1::2] = rows, 0.5 * (rows[1:] + rows[:-1])
    return answer
