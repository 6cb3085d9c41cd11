"""Least times of motions from rest to rest, in closed form."""

import numpy as np
from numpy.typing import NDArray

from compiled.kernel import kernel
from kinematics.arrays import Array, Indices
from kinematics.model.chain import Chain

Times = NDArray[np.float32]


def motion_times(
    chain: Chain, start: Array, ends: Array, limits: tuple[Array, Array] | None = None
) -> Array:
    """Least times of the slowest joint from rest to rest, to configurations (k, n), (k,) [s].

    Args:
        chain: The robot.
        start: Shape (n,) [rad or m].
        ends: Shape (k, n) [rad or m].
        limits: Limits of velocity and acceleration (n,), in place of the robot's.
    """
    v, a = limits or (chain.limits.velocity, chain.limits.acceleration)
    a = np.where(a > 0.0, a, np.inf)
    # A joint without any limit goes 1 rad/s or 1 m/s.
    v = np.where((v > 0.0) & np.isfinite(np.minimum(v, a)), v, 1.0)
    times = np.zeros(len(ends))
    motion_times_kernel(np.ascontiguousarray(np.abs(ends - start)), v, a, times)
    return times


def passing_time(start: Array, end: Array, velocity: Array, slack: float) -> float:
    """Least time of the slowest joint where neither end is at rest: (d - slack) / v [s].

    Args:
        start: Shape (n,) [rad or m].
        end: Shape (n,) [rad or m].
        velocity: Limits, shape (n,) [rad/s or m/s].
        slack: Distance from its ends at which the motion may be passed, in all [rad or m].
    """
    v = np.where(velocity > 0.0, velocity, 1.0)
    return float((np.maximum(np.abs(end - start) - slack, 0.0) / v).max(initial=0.0))


@kernel(allocates=False)
def rest_to_rest_time(distance: float, speed: float, acceleration: float, jerk: float) -> float:
    """Least time from rest to rest over a distance d > 0 [s].

    With the largest speed V, acceleration A and jerk J: getting to speed v takes A/J + v/A, or
    2 sqrt(v/J) where the acceleration does not get to A; the way covered meanwhile is half of v
    times that. Without a limit of the jerk the time is d/V + V/A, or 2 sqrt(d/A) where the speed
    does not get to V. Source: the double S profile of Biagiotti and Melchiorri, Trajectory Planning
    for Automatic Machines and Robots, section 3.4.

    Args:
        distance: The way d, of any unit.
        speed: Largest speed [1/s]; infinite where only the acceleration is limited.
        acceleration: Largest acceleration [1/s^2]; infinite where only the speed is limited.
        jerk: Largest jerk [1/s^3]; infinite where there is none.
    """
    d, V, A, J = distance, speed, acceleration, jerk
    if np.isinf(J):
        return d / V + V / A if A * d >= V * V else 2.0 * np.sqrt(d / A)
    ramp = A / J + V / A if V * J >= A * A else 2.0 * np.sqrt(V / J)
    if V * ramp <= d:
        return float(ramp + d / V)
    if J * J * d >= 2.0 * A**3:
        ratio = A * A / J
        peak = 0.5 * (np.sqrt(ratio * ratio + 4.0 * A * d) - ratio)
        return float(2.0 * (A / J + peak / A))
    return float(4.0 * np.cbrt(0.5 * d / J))


@kernel(allocates=False)
def motion_times_kernel(ways: Array, velocity: Array, acceleration: Array, times: Array) -> None:
    """Raise times (k,) to those of the slowest joint over its way, shape (k, n)."""
    for i in range(ways.shape[0]):
        for joint in range(ways.shape[1]):
            if ways[i, joint] > 0.0:
                time = rest_to_rest_time(
                    ways[i, joint], velocity[joint], acceleration[joint], np.inf
                )
                times[i] = max(times[i], time)


@kernel
def rest_to_rest_kernel(
    q: Array, velocity: Array, acceleration: Array, jerk: Array, straight: bool, rows: Indices,
    out: Times,
) -> None:  # fmt: skip
    """Write the least times between configurations and all those before them [s].

    A straight joint motion keeps all joints in step: its speed is that of the joint with the least
    share of its limit. Without that, the slowest joint alone bounds the time of every motion.

    Args:
        q: Configurations, shape (m, n) [rad or m].
        velocity: Limits, shape (n,) [rad/s or m/s].
        acceleration: Limits, shape (n,) [rad/s^2 or m/s^2].
        jerk: Limits, infinite where there is none, shape (n,) [rad/s^3 or m/s^3].
        straight: True for the straight joint motion, False for the bound of every motion.
        rows: The first of these configurations, and the one behind the last, shape (2,).
        out: Times, symmetric, written, shape (m, m).
    """
    n = q.shape[1]
    for i in range(rows[0], rows[1]):
        out[i, i] = 0.0
        for k in range(i):
            v = a = j = time = 0.0
            for joint in range(n):
                d = abs(q[k, joint] - q[i, joint])
                if d == 0.0:
                    continue
                V, A, J = velocity[joint], acceleration[joint], jerk[joint]
                if straight:
                    v, a, j = max(v, d / V), max(a, d / A), max(j, d / J)
                else:
                    time = max(time, rest_to_rest_time(d, V, A, J))
            if straight and v > 0.0:
                time = rest_to_rest_time(1.0, 1.0 / v, 1.0 / a, 1.0 / j if j > 0.0 else np.inf)
            out[i, k] = time
            out[k, i] = time
