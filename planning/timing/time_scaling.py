"""Uniform dilation: the least slowing down that brings every exact peak within its limit.

Time stretched by a factor f divides velocity by f, acceleration by f^2, jerk by f^3.

The starts of all pieces come first. A piece holds nothing worse where the sums of its coefficients,
or its Bernstein coefficients, are within what is known to be the worst of all joints; only the
others cost roots.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from compiled.kernel import kernel
from kinematics.arrays import Array
from kinematics.errors import InvalidOption
from kinematics.trajectory.polynomial import (
    horner_kernel,
    inside_hull_kernel,
    unit_derivative_kernel,
    widen_inside_kernel,
)
from kinematics.trajectory.trajectory import Trajectory
from planning.timing.options import Solver, TimingFailed
from planning.values.limits import LimitsBetween, MotionLimits


@kernel
def worst_kernel(breaks: Array, coefficients: Array, limits: Array, worst: Array) -> None:
    """Write the exact worst ratios of velocity, acceleration and jerk to their limits.

    Args:
        breaks: Shape (m + 1,) [s].
        coefficients: Shape (m, n, k).
        limits: inf where there is none, shape (3, n).
        worst: Comes as zeros, shape (3,).
    """
    m, n, size = coefficients.shape
    work = np.empty((size + 4, max(size, 4)))
    c, roots, spare, best, table = work[0], work[1], work[2], work[3], work[4:]
    for row in range(min(3, size - 1)):
        factor = 1.0 if row == 0 else row * (row + 1.0)
        for joint in range(n):
            for i in range(m):
                start = abs(coefficients[i, joint, row + 1]) * factor
                worst[row] = max(worst[row], start / limits[row, joint])
        for joint in range(n):
            limit = limits[row, joint]
            for i in range(m if limit < np.inf else 0):
                h = breaks[i + 1] - breaks[i]
                count = unit_derivative_kernel(coefficients[i, joint], h, row + 1, c)
                worst[row] = max(worst[row], abs(horner_kernel(c, count, 1.0)) / limit)
                # Pieces are passed over that stay below the worst ratio by this part of it: far
                # more than rounding.
                cap = worst[row] * limit * (1.0 - 1e-12)
                if count < 3 or _sums_inside(c, count, cap):
                    continue
                if not inside_hull_kernel(c, count, -cap, cap, spare):
                    best[0], best[1], best[2], best[3] = -cap, 0.0, cap, 0.0
                    widen_inside_kernel(c, count, 0.0, 1.0, table, roots, spare, best)
                    worst[row] = max(worst[row], max(best[2], -best[0]) / limit)


@kernel(allocates=False)
def _sums_inside(c: Array, count: int, cap: float) -> bool:
    """Whether a coefficient and the sums of those of one sign beyond it are within +-``cap``."""
    below, above = c[0], c[0]
    for k in range(1, count):
        below, above = below + min(c[k], 0.0), above + max(c[k], 0.0)
    # Said this way round a NaN is never inside.
    return bool(-cap <= below and above <= cap)


# Aimed at below each limit, so that whoever evaluates the polynomials in another order of
# operations still finds them inside; it costs a trillionth of the duration.
_HAIR = 1e-12


class ScaledTime(NamedTuple):
    """A trajectory within its limits, and how many times as long it had to be made for that.

    Args:
        trajectory: The motion.
        factor: Factor by which its time was stretched.
        solver: Name of the solver that found it, where the method has several.
        narrower: Limits that hold beside others, each with its first piece and the one after its
            last.
    """

    trajectory: Trajectory
    factor: float
    solver: Solver | None = None
    narrower: tuple[tuple[int, int, MotionLimits], ...] = ()

    def held_to(self, limits: MotionLimits) -> MotionLimits:
        """Limits that the motion is held to: those given, and narrower ones between instants."""
        if not self.narrower:
            return limits
        breaks = self.trajectory.breaks.tolist()
        own = [LimitsBetween(breaks[i], breaks[k], there) for i, k, there in self.narrower]
        return replace(limits, between=tuple(own))


def peak_ratios(trajectory: Trajectory, limits: Array, derivative: int) -> Array:
    """Exact largest |derivative| of each joint over its limit, shape (n,).

    Args:
        trajectory: Motion to be judged.
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
        trajectory: Motion to be slowed down.
        velocity: Limits, shape (n,), inf where there is none.
        acceleration: Limits, likewise.
        jerk: Limits, likewise.

    Raises:
        InvalidOption: A limit is not positive, or their number is not n.
    """
    limits = motion_bounds(trajectory.n, velocity, acceleration, jerk)
    breaks, coefficients = trajectory.breaks.copy(), trajectory.coefficients.copy()
    factor = stretch_kernel(breaks, coefficients, limits, 1.0)
    if factor == 1.0:
        return ScaledTime(trajectory, factor)
    return scaled_motion(trajectory.joint_names, breaks, coefficients, factor)


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
    limits, worst = motion_bounds(trajectory.n, velocity, acceleration, jerk), np.zeros(3)
    worst_kernel(trajectory.breaks, trajectory.coefficients, limits, worst)
    return float(max(worst ** (1.0 / np.arange(1.0, 4.0))))


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
    limits = motion_bounds(trajectory.n, velocity, acceleration, jerk)
    breaks, coefficients = trajectory.breaks.copy(), trajectory.coefficients.copy()
    return scaled_motion(
        trajectory.joint_names, breaks, coefficients, fit_kernel(breaks, coefficients, limits)
    )


def with_duration(scaled: ScaledTime, duration: float | None, at_least: bool) -> ScaledTime:
    """The motion slowed down uniformly to a duration.

    Args:
        scaled: The motion.
        duration: Its duration then [s]; None leaves it as it is.
        at_least: Whether a motion that takes longer stays as it is.

    Raises:
        TimingFailed: It takes longer.
    """
    motion = scaled.trajectory
    if duration is None or (at_least and duration <= motion.duration):
        return scaled
    # Part of a duration by which rounding may miss it: an answer can be asked for again [-].
    if duration < motion.duration * (1.0 - _HAIR):
        raise TimingFailed(
            f"the motion takes {motion.duration:.9g} s within its limits, and timing.duration is "
            f"{duration:.9g} s",
            hint="Give a longer duration, at_least, or higher limits.",
            least_duration=motion.duration,
        )
    slower = motion.dilate(duration / motion.duration)
    breaks = np.append(slower.breaks[:-1], duration)
    return scaled._replace(trajectory=Trajectory(motion.joint_names, breaks, slower.coefficients))


def slowed_at_ends(
    make: Callable[[tuple[float, float]], ScaledTime],
    slow: Callable[[ScaledTime], ScaledTime],
    end_speeds: tuple[float, float],
) -> ScaledTime:
    """A motion that meets the speeds at its ends after it was slowed down.

    Slowing down changes the speeds at the ends: they are asked for that much higher.

    Args:
        make: Maker of a motion with speeds at its ends.
        slow: Function that slows a motion down as far as it has to be.
        end_speeds: ds/dt at the start and at the end.

    Raises:
        TimingFailed: The speeds can't be kept.
    """
    factor = 1.0
    # How often an answer that has to be slowed down is asked for with higher speeds at its ends.
    for _ in range(8):
        made = make((end_speeds[0] * factor, end_speeds[1] * factor))
        slowed = slow(made)
        needed = slowed.factor / made.factor
        if needed == factor or not any(end_speeds):
            return slowed
        if needed < factor:
            return ScaledTime(made.trajectory.dilate(factor), made.factor * factor)
        # Slowed down by this part more than was needed, so that the next trial needs no more.
        factor = needed * (1.0 + 1e-6)
    raise end_speed_failure()


def end_speed_failure() -> TimingFailed:
    """The failure of speeds at the ends that can't be kept."""
    return TimingFailed(
        "the boundary velocities can't be kept within all limits",
        hint="Give lower boundary velocities, or higher limits.",
    )


def scaled_motion(
    joint_names: Sequence[str], breaks: Array, coefficients: Array, factor: float
) -> ScaledTime:
    """The motion that ``fit_kernel`` has left, which takes the arrays as they are.

    Raises:
        InvalidOption: No limit bounds the motion.
    """
    if not factor > 0.0:
        raise InvalidOption(
            "no limit bounds this motion, so there is no fastest one",
            hint="Give finite velocity, acceleration or jerk limits, and a motion that moves.",
        )
    for array in (breaks, coefficients):
        array.setflags(write=False)
    return ScaledTime(Trajectory(tuple(joint_names), breaks, coefficients), factor)


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


def motion_bounds(n: int, *limits: ArrayLike | None) -> Array:
    """The limits, checked, by the order of the derivative, inf where none is given; (3, n).

    Raises:
        InvalidOption: A limit is not positive, or their number is not n.
    """
    bounds, names = np.full((3, n), np.inf), ("velocity", "acceleration", "jerk")
    for row, (values, name) in enumerate(zip(limits, names, strict=False)):
        if values is not None:
            bounds[row] = checked_limits(values, name, n)
    return bounds


@kernel
def fit_kernel(breaks: Array, coefficients: Array, limits: Array) -> float:
    """Scale the time of a motion in place so that all limits just hold; the factor.

    Args:
        breaks: Shape (m + 1,) [s].
        coefficients: Shape (m, n, k).
        limits: Limits of velocity, acceleration and jerk, inf where there is none, shape (3, n).

    Returns:
        Factor of its duration, 0 where no limit bounds it.
    """
    worst, factor = np.zeros(3), 0.0
    worst_kernel(breaks, coefficients, limits, worst)
    for row in range(3):
        factor = max(factor, worst[row] ** (1.0 / (row + 1.0)))
    if not factor > 0.0:
        return 0.0
    near = limits.copy()
    _spare_kernel(worst, factor, near)
    return stretch_kernel(breaks, coefficients, near, factor * (1.0 + _HAIR))


@kernel
def stretch_kernel(breaks: Array, coefficients: Array, limits: Array, factor: float) -> float:
    """Stretch a motion in place by a factor, and by more until its limits hold; the whole factor.

    Args:
        breaks: Shape (m + 1,) [s].
        coefficients: Shape (m, n, k).
        limits: inf where none is to be checked, shape (3, n).
        factor: Least factor of the duration, at least.
    """
    given, pieces = breaks.copy(), coefficients.copy()
    near, worst = limits.copy(), np.zeros(3)
    while True:
        if factor != 1.0:
            # As ``Trajectory.dilate`` does.
            for i in range(given.shape[0]):
                breaks[i] = given[i] * factor
            for k in range(pieces.shape[2]):
                power = factor ** float(-k)
                for i in range(pieces.shape[0]):
                    for joint in range(pieces.shape[1]):
                        coefficients[i, joint, k] = pieces[i, joint, k] * power
        worst[:] = 0.0
        worst_kernel(breaks, coefficients, near, worst)
        missing = 1.0
        for row in range(3):
            if worst[row] > 1.0:
                # The root of a ratio just above 1 may round to 1.
                over = max(worst[row] ** (1.0 / (row + 1.0)), 1.0 + _HAIR)
                missing = max(missing, over)
        if not missing > 1.0:
            return factor
        factor *= missing * (1.0 + _HAIR)
        near[:] = limits
        _spare_kernel(worst, missing, near)


@kernel(allocates=False)
def _spare_kernel(worst: Array, factor: float, limits: Array) -> None:
    """Set limits to inf that are not worth another look once time is stretched by a factor.

    Ratios whose limits are used up just so by it are checked again; others are far below 1.
    """
    for row in range(3):
        # Ratios below this part of what slowing down brings to 1 are far from it whatever is
        # rounded.
        if not worst[row] > 0.999 * factor ** (row + 1.0):
            limits[row] = np.inf
