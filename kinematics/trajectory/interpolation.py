"""Trajectories through samples: what lies between the samples is said by a name, never guessed."""

from collections.abc import Sequence
from typing import Literal

import numpy as np
import scipy
from numpy.typing import ArrayLike

from kinematics.arrays import Array
from kinematics.errors import InvalidOption, InvalidTrajectory
from kinematics.trajectory.trajectory import Trajectory

INTERPOLATIONS = ("linear", "cubic", "quintic", "natural_spline", "clamped_spline")


def interpolate(
    joint_names: Sequence[str],
    times: ArrayLike,
    positions: ArrayLike,
    interpolation: str,
    velocities: ArrayLike | None = None,
    accelerations: ArrayLike | None = None,
) -> Trajectory:
    """The trajectory through samples.

    "linear" connects positions by straight lines; "cubic" is the Hermite cubic through positions
    and velocities, "quintic" the Hermite quintic through positions, velocities and accelerations;
    "natural_spline" and "clamped_spline" are the cubic splines with continuous accelerations, which
    at the ends are 0 or such that the velocities are 0.

    Args:
        joint_names: n names.
        times: Strictly increasing, shape (m,), m >= 2; the trajectory begins at the first [s].
        positions: Shape (m, n).
        interpolation: One of ``INTERPOLATIONS``.
        velocities: Shape (m, n), for "cubic" and "quintic".
        accelerations: Shape (m, n), for "quintic".

    Raises:
        InvalidOption: The interpolation is unknown, or what it needs is not given.
        InvalidTrajectory: Shapes do not fit, or times do not increase.
    """
    if interpolation not in INTERPOLATIONS:
        raise InvalidOption(
            f"there is no interpolation {interpolation!r}",
            hint=f"Choose one of: {', '.join(INTERPOLATIONS)}.",
            interpolations=list(INTERPOLATIONS),
        )
    t = _sample_times(times)
    shape = (len(t), len(joint_names))
    q = _rows(positions, shape, "positions")
    if interpolation in ("natural_spline", "clamped_spline"):
        ends: Literal["natural", "clamped"]
        ends = "natural" if interpolation == "natural_spline" else "clamped"
        # From scipy's descending powers (4, m - 1, n) to ours (m - 1, n, 4).
        c = np.moveaxis(scipy.interpolate.CubicSpline(t, q, bc_type=ends).c[::-1], 0, 2)
        return Trajectory(tuple(joint_names), t - t[0], c)
    needed = {"linear": 0, "cubic": 1, "quintic": 2}[interpolation]
    derivatives = [q]
    for name, rows in (("velocities", velocities), ("accelerations", accelerations))[:needed]:
        if rows is None:
            raise InvalidOption(
                f"interpolation {interpolation!r} needs {name}, which are not given",
                hint='Give them, or choose "natural_spline", which needs positions only.',
            )
        derivatives.append(_rows(rows, shape, name))
    return Trajectory(tuple(joint_names), t - t[0], _hermite(np.diff(t), derivatives))


def _hermite(lengths: Array, derivatives: Sequence[Array]) -> Array:
    """Coefficients (m - 1, n, 2 d) of the pieces that meet d derivatives at both their ends.

    On the unit interval the lower half of the coefficients is given by the start; the upper half
    solves a system of binomials for what is then left over at the end.
    """
    d = len(derivatives)
    h = lengths[:, None]
    powers = np.arange(2 * d)
    # Scaled to the unit interval: the i-th derivative times h^i.
    start = [rows[:-1] * h**i for i, rows in enumerate(derivatives)]
    end = [rows[1:] * h**i for i, rows in enumerate(derivatives)]
    factorials = np.cumprod([1.0, *range(1, d)])
    lower = [rows / factorials[i] for i, rows in enumerate(start)]
    # Row i: the i-th derivative of u^k at 1.
    falling = np.array([[np.prod(k - np.arange(i)) for k in powers] for i in range(d)], dtype=float)
    left = np.stack(end) - np.tensordot(falling[:, :d], np.stack(lower), axes=1)
    upper = np.linalg.solve(falling[:, d:], left.reshape(d, -1)).reshape(left.shape)
    c = np.stack([*lower, *upper], axis=2)
    return np.asarray(c / h[:, :, None] ** powers)


def _sample_times(times: ArrayLike) -> Array:
    t = np.asarray(times, dtype=np.float64)
    if t.ndim != 1 or len(t) < 2 or not np.isfinite(t).all():
        raise InvalidTrajectory("samples need at least two finite times")
    steps = np.diff(t)
    if not (steps > 0.0).all():
        i = int(np.argmax(steps <= 0.0)) + 1
        raise InvalidTrajectory(
            f"time {i} of the samples ({t[i]:.6g} s) is not after the one before",
            hint="Times must strictly increase.",
        )
    return t


def _rows(values: ArrayLike, shape: tuple[int, int], name: str) -> Array:
    try:
        rows = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError):
        rows = np.zeros(0)  # rows of different lengths
    if rows.shape != shape:
        raise InvalidTrajectory(
            f"the {name} of the samples must be {shape[0]} rows of {shape[1]} values",
            hint="One row for each time, one value for each joint.",
        )
    if not np.isfinite(rows).all():
        raise InvalidTrajectory(f"the {name} of the samples are not all finite")
    return rows
