"""Uniform dilation: the least slowing down that brings every exact peak within its limit.

Time stretched by a factor f divides velocity by f, acceleration by f^2, jerk by f^3.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from kinematics.arrays import Array
from kinematics.errors import InvalidOption
from kinematics.trajectory import Trajectory
from planning.timing.options import Solver

# Aimed at below each limit, so that whoever evaluates the polynomials in another order of
# operations still finds them inside; it costs a trillionth of the duration.
_HAIR = 1e-12
# Ratios below this part of what slowing down brings to 1 are far from it whatever is rounded.
_NEAR = 0.999


class ScaledTime(NamedTuple):
    """A trajectory within its limits, and how many times as long it had to be made for that.

    Args:
        trajectory: The motion.
        factor: By which its time was stretched.
        solver: Name of the solver that found it, where the method has several.
    """

    trajectory: Trajectory
    factor: float
    solver: Solver | None = None


def peak_ratios(trajectory: Trajectory, limits: Array, derivative: int) -> Array:
    """Exact largest |derivative| of each joint over its limit, shape (n,).

    Args:
        trajectory: What is judged.
        limits: Positive, inf where there is none, shape (n,).
        derivative: 1 velocity, 2 acceleration, 3 jerk.
    """
    return np.asarray(trajectory.peaks(derivative).value / limits)


def dilate(
    trajectory: Trajectory,
    velocity: ArrayLike | None = None,
    acceleration: ArrayLike | None = None,
    jerk: ArrayLike | None = None,
) -> ScaledTime:
    """The trajectory slowed down uniformly by the least factor that keeps all limits given.

    Afterwards every peak ratio is at most 1 in floating point. The jerk is that within the pieces:
    a jump of the acceleration from one to the next has none.

    Args:
        trajectory: To be slowed down.
        velocity: Limits, shape (n,), inf where there is none.
        acceleration: Limits, likewise.
        jerk: Limits, likewise.

    Raises:
        InvalidOption: A limit is not positive, or their number is not n.
    """
    limits = _bounds(trajectory.n, velocity, acceleration, jerk)
    return _stretch(trajectory, limits, 1.0)


def fitting_factor(
    trajectory: Trajectory,
    velocity: ArrayLike | None = None,
    acceleration: ArrayLike | None = None,
    jerk: ArrayLike | None = None,
) -> float:
    """Factor of a trajectory's duration with which all limits just hold; below 1 is faster.

    Raises:
        InvalidOption: As in ``dilate``.
    """
    worst = _worst(trajectory, _bounds(trajectory.n, velocity, acceleration, jerk))
    return max((ratio ** (1.0 / order) for order, ratio in worst.items()), default=0.0)


def fit(
    trajectory: Trajectory,
    velocity: ArrayLike | None = None,
    acceleration: ArrayLike | None = None,
    jerk: ArrayLike | None = None,
) -> ScaledTime:
    """As ``dilate``, but sped up where there is room: the fastest of all uniform time scalings.

    Raises:
        InvalidOption: As in ``dilate``, or no limit given bounds the motion.
    """
    limits = _bounds(trajectory.n, velocity, acceleration, jerk)
    factor = fitting_factor(trajectory, velocity, acceleration, jerk)
    if not factor > 0.0:
        raise InvalidOption(
            "no limit bounds this motion, so there is no fastest one",
            hint="Give finite velocity, acceleration or jerk limits, and a motion that moves.",
        )
    return _stretch(trajectory, limits, factor * (1.0 + _HAIR))


def checked_limits(values: ArrayLike, name: str, n: int) -> Array:
    """Limits as an array of shape (n,) of positive numbers, inf perhaps among them.

    Raises:
        InvalidOption: They are not.
    """
    try:
        limits = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError):
        raise InvalidOption(f"the {name} limits are not a list of numbers") from None
    if limits.shape != (n,) or not (limits > 0.0).all():
        raise InvalidOption(
            f"the {name} limits must be {n} positive number(s), got {np.array2string(limits)}",
            hint="Give one limit for each joint, in the order of the joints.",
        )
    return limits


def _bounds(n: int, *limits: ArrayLike | None) -> dict[int, Array]:
    """The limits that are given, checked, by the order of the derivative."""
    names = ("velocity", "acceleration", "jerk")
    return {
        order: checked_limits(values, name, n)
        for order, (values, name) in enumerate(zip(limits, names, strict=True), start=1)
        if values is not None
    }


def _stretch(trajectory: Trajectory, limits: dict[int, Array], factor: float) -> ScaledTime:
    dilated = trajectory if factor == 1.0 else trajectory.dilate(factor)
    worst = _worst(dilated, limits)
    while (missing := _missing_factor(worst)) > 1.0:
        factor *= missing * (1.0 + _HAIR)
        dilated = trajectory.dilate(factor)
        # Looked at again is what comes near its limit: the rest has only become smaller.
        near = {k: limits[k] for k, r in worst.items() if r > _NEAR * missing**k}
        worst = _worst(dilated, near)
    return ScaledTime(dilated, factor)


def _worst(trajectory: Trajectory, limits: dict[int, Array]) -> dict[int, float]:
    """The worst ratio to the limits of each order."""
    return {
        order: float(peak_ratios(trajectory, values, order).max())
        for order, values in limits.items()
    }


def _missing_factor(worst: dict[int, float]) -> float:
    """The factor by which time is still too short: the largest ratio^(1 / order), at least 1."""
    # The root of a ratio just above 1 may round to 1.
    over = (max(r ** (1.0 / k), 1.0 + _HAIR) for k, r in worst.items() if r > 1.0)
    return max(over, default=1.0)
