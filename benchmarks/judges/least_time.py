"""Durations that motion with bounded jerk is compared with: with stops, and IPOPT's optimum."""

import itertools
from typing import Any

import casadi
import numpy as np
import ruckig

from kinematics.arrays import Array
from planning.timing.path.path import JointPath


def stops(waypoints: Array, limits: tuple[Array, Array, Array]) -> float:
    """The duration of ruckig's motions in straight lines from waypoint to waypoint."""
    total = 0.0
    for start, end in itertools.pairwise(waypoints):
        # In phase means as one joint that has the least of what the joints leave to each.
        length, ways = np.linalg.norm(end - start), np.abs(end - start)
        asked = ruckig.InputParameter(1)
        asked.current_position, asked.target_position = [0.0], [float(length)]
        shared = [[float((limit / ways).min() * length)] for limit in limits]
        asked.max_velocity, asked.max_acceleration, asked.max_jerk = shared
        motion = ruckig.Trajectory(1)
        result = ruckig.Ruckig(1).calculate(asked, motion)
        if result != ruckig.Result.Working:
            raise RuntimeError(f"ruckig: {result}")
        total += motion.duration
    return total


def optimum(path: JointPath, limits: Array, cells_each: int) -> float:
    """The least time with constant jerk along the path in each of many cells, by IPOPT.

    The cells' ends are fixed, so that none can grow long and hide what happens inside; limits hold
    at the ends and in the middle of each.
    """
    breaks, share = path.breaks, np.linspace(0.0, 1.0, cells_each + 1)
    places = [low + (high - low) * share for low, high in itertools.pairwise(breaks)]
    # Close together where the motion starts and where it ends.
    places[0] = breaks[1] * share**2
    places[-1] = breaks[-1] - (breaks[-1] - breaks[-2]) * share[::-1] ** 2
    where = np.append(np.concatenate([p[:-1] for p in places]), breaks[-1])
    count = len(where) - 1
    opti = casadi.Opti()
    v, a = opti.variable(count + 1), opti.variable(count + 1)
    j, h = opti.variable(count), opti.variable(count)
    for value in (v[0], a[0], v[count], a[count]):
        opti.subject_to(value == 0.0)
    # All cells in one: each value is a column with a row for each cell.
    v0, a0 = v[:count], a[:count]
    opti.subject_to(v0 * h + a0 * h**2 / 2 + j * h**3 / 6 == np.diff(where))
    opti.subject_to(v[1:] == v0 + a0 * h + j * h**2 / 2)
    opti.subject_to(a[1:] == a0 + j * h)
    pieces = np.arange(count) // cells_each
    begins = where[:-1] - breaks[pieces]
    for part in (0.0, 0.5, 1.0):
        t = part * h
        u = begins + v0 * t + a0 * t**2 / 2 + j * t**3 / 6
        speed, rate = v0 + a0 * t + j * t**2 / 2, a0 + j * t
        for c, (vm, am, jm) in zip(path.coefficients[pieces].swapaxes(0, 1), limits.T, strict=True):
            _, c1, c2, c3 = c.T
            q1 = c1 + 2 * c2 * u + 3 * c3 * u**2
            q2, q3 = 2 * c2 + 6 * c3 * u, 6 * c3
            opti.subject_to(opti.bounded(-1, q1 * speed / vm, 1))
            opti.subject_to(opti.bounded(-1, (q1 * rate + q2 * speed**2) / am, 1))
            jerk = q1 * j + 3 * q2 * speed * rate + q3 * speed**3
            opti.subject_to(opti.bounded(-1, jerk / jm, 1))
    opti.subject_to(h >= 1e-4)
    opti.subject_to(v >= 0)
    opti.minimize(casadi.sum1(h))
    x = np.linspace(0.0, 1.0, 5001)
    time = np.interp(where / breaks[-1], 10 * x**3 - 15 * x**4 + 6 * x**5, x)
    slow = 8.0
    opti.set_initial(v, (30 * time**2 - 60 * time**3 + 30 * time**4) * breaks[-1] / slow)
    opti.set_initial(h, np.maximum(np.diff(time) * slow, 1e-3))
    quiet: dict[str, Any] = {"ipopt.print_level": 0, "print_time": 0, "ipopt.sb": "yes"}
    opti.solver("ipopt", quiet, {"max_iter": 1000})
    return float(opti.solve().value(casadi.sum1(h)))
