"""Least times from rest to rest between configurations, in closed form."""

import numpy as np
from numpy.typing import NDArray

from compiled.kernel import kernel
from kinematics.arrays import Array, Indices

Times = NDArray[np.float32]


@kernel(allocates=False)
def unit_time_kernel(speed: float, acceleration: float, jerk: float) -> float:
    """Least time from rest to rest over a path of length 1 [s].

    With the largest speed V, acceleration A and jerk J: getting to speed v takes A/J + v/A, or
    2 sqrt(v/J) where the acceleration does not get to A; the way covered meanwhile is half of v
    times that. Source: the double S profile of Biagiotti and Melchiorri, Trajectory Planning for
    Automatic Machines and Robots, section 3.4.

    Args:
        speed: Largest speed along the path [1/s].
        acceleration: Largest acceleration [1/s^2].
        jerk: Largest jerk [1/s^3]; infinite where there is none.
    """
    V, A, J = speed, acceleration, jerk
    if np.isinf(J):
        return 1.0 / V + V / A if V * V <= A else 2.0 / np.sqrt(A)
    ramp = A / J + V / A if V * J >= A * A else 2.0 * np.sqrt(V / J)
    if V * ramp <= 1.0:
        return float(ramp + 1.0 / V)
    if 2.0 * A**3 <= J * J:
        ratio = A * A / J
        peak = 0.5 * (np.sqrt(ratio * ratio + 4.0 * A) - ratio)
        return float(2.0 * (A / J + peak / A))
    return float(4.0 * np.cbrt(0.5 / J))


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
                v = max(v, d / velocity[joint])
                a = max(a, d / acceleration[joint])
                j = max(j, d / jerk[joint])
                if not straight:
                    alone = unit_time_kernel(1.0 / v, 1.0 / a, 1.0 / j if j > 0.0 else np.inf)
                    time = max(time, alone)
                    v = a = j = 0.0
            if straight and v > 0.0:
                time = unit_time_kernel(1.0 / v, 1.0 / a, 1.0 / j if j > 0.0 else np.inf)
            out[i, k] = time
            out[k, i] = time
