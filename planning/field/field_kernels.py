"""Kernels of the potential field: its terms, their joint force, and where that vanishes."""

import math
from typing import NamedTuple

import numpy as np

from compiled.kernel import kernel
from kinematics.arrays import Array, Indices
from obstacles.projection.projection import ProjectionArrays, project_kernel

#: On a surface nothing points out of it: there the distance itself is differentiated [m].
ON_SURFACE = 1e-9
#: Step of that numerical derivative [m].
NUDGE = 1e-6


class FieldArrays(NamedTuple):
    """A field packed for the kernels, with m control points.

    Args:
        joints: Joint that carries each point, shape (m,).
        places: Positions in the joints' frames, shape (m, 3) [m].
        radii: Radius of the arm about each, shape (m,) [m].
        goals: Positions at the goal, shape (m, 3) [m].
        attractive: c_i, shape (m,).
        repulsive: eta_i, shape (m,).
        cap: d [m].
        reach: rho_0 [m].
        least: rho_m [m].
    """

    joints: Indices
    places: Array
    radii: Array
    goals: Array
    attractive: Array
    repulsive: Array
    cap: float
    reach: float
    least: float


@kernel
def attraction_kernel(field: FieldArrays, points: Array, forces: Array) -> float:
    """Write F_att of the points (m, 3) into ``forces`` (m, 3); the sum of U_att."""
    goals, weights, cap = field.goals, field.attractive, field.cap
    total = 0.0
    for i in range(points.shape[0]):
        x, y, z = goals[i, 0] - points[i, 0], goals[i, 1] - points[i, 1], goals[i, 2] - points[i, 2]
        length = np.sqrt(x * x + y * y + z * z)
        pull = weights[i]
        if length <= cap:
            total += 0.5 * weights[i] * length * length
        else:
            total += weights[i] * cap * (length - 0.5 * cap)
            pull *= cap / length
        forces[i, 0], forces[i, 1], forces[i, 2] = pull * x, pull * y, pull * z
    return total


@kernel
def repulsion_kernel(
    field: FieldArrays,
    obstacles: ProjectionArrays,
    points: Array,
    within: Array,
    projections: Array,
    distances: Array,
    forces: Array,
) -> float:
    """Write F_rep of the points (m, 3) into ``forces`` (m, 3); the sum of U_rep.

    ``projections`` (m, o, 3) and ``distances`` (m, o) are written on the way, of what is no farther
    than ``within`` (m,), which must be as far as an obstacle is felt.
    """
    weights, reach = field.repulsive, field.reach
    project_kernel(points, obstacles, within, projections, distances)
    total = 0.0
    u = np.empty(3)
    for i in range(points.shape[0]):
        for row in range(3):
            forces[i, row] = 0.0
        for k in range(distances.shape[1]):
            rho = distances[i, k] - field.radii[i]
            if not rho <= reach:
                continue
            near = max(rho, field.least)
            rise = 1.0 / near - 1.0 / reach
            push = weights[i] * rise / (near * near)
            total += 0.5 * weights[i] * rise * rise + push * (near - rho)
            outward_kernel(points[i], projections[i, k], distances[i, k], k, obstacles, u)
            for row in range(3):
                forces[i, row] += push * u[row]
    return total


@kernel
def outward_kernel(
    point: Array, projection: Array, distance: float, k: int, obstacles: ProjectionArrays, u: Array
) -> None:
    """Write the direction (3,) in which the distance of a point from obstacle k grows."""
    if abs(distance) > ON_SURFACE:
        for row in range(3):
            u[row] = (point[row] - projection[row]) / distance
        return
    around = np.empty((6, 3))
    for row in range(6):
        for axis in range(3):
            around[row, axis] = point[axis]
        around[row, row // 2] += NUDGE if row % 2 == 0 else -NUDGE
    o = obstacles.owners[-1] + 1
    beside, slopes = np.empty((6, o, 3)), np.empty((6, o))
    project_kernel(around, obstacles, np.full(6, np.inf), beside, slopes)
    square = 0.0
    for axis in range(3):
        u[axis] = slopes[2 * axis, k] - slopes[2 * axis + 1, k]
        square += u[axis] * u[axis]
    for axis in range(3):
        u[axis] = u[axis] / np.sqrt(square) if square > 0.0 else 0.0


@kernel
def force_kernel(jacobians: Array, pulls: Array, pushes: Array, joint_force: Array) -> None:
    """Write sum_i J_i^T (F_att + F_rep) into ``joint_force`` (n,)."""
    m, n = jacobians.shape[0], jacobians.shape[2]
    for j in range(n):
        joint_force[j] = 0.0
        for i in range(m):
            for row in range(3):
                joint_force[j] += jacobians[i, row, j] * (pulls[i, row] + pushes[i, row])


@kernel
def smallest_force_kernel(
    jacobians: Array, pulls: Array, pushes: Array, spring: Array, tolerance: float
) -> float:
    """The joint force that counts as none beside its own terms [N m or N].

    That is the largest over joints of tolerance sum_i (|J_i^T F_att| + |J_i^T F_rep|), and not less
    than the rounding of these products.

    Args:
        jacobians: Of the points, shape (m, 3, n).
        pulls: F_att of the points, shape (m, 3) [N].
        pushes: F_rep of the points, shape (m, 3) [N].
        spring: Joint force of the pull in joint space, shape (n,) [N m or N].
        tolerance: Share of the terms.
    """
    m, n = jacobians.shape[0], jacobians.shape[2]
    terms, levers = 0.0, 0.0
    for j in range(n):
        term, lever = abs(spring[j]), abs(spring[j])
        for i in range(m):
            J, F, G = jacobians[i], pulls[i], pushes[i]
            term += abs(J[0, j] * F[0] + J[1, j] * F[1] + J[2, j] * F[2])
            term += abs(J[0, j] * G[0] + J[1, j] * G[1] + J[2, j] * G[2])
            length = math.sqrt(J[0, j] ** 2 + J[1, j] ** 2 + J[2, j] ** 2)
            lever += length * math.sqrt(F[0] ** 2 + F[1] ** 2 + F[2] ** 2)
            lever += length * math.sqrt(G[0] ** 2 + G[1] ** 2 + G[2] ** 2)
        terms, levers = max(terms, term), max(levers, lever)
    # A joint force below a trillionth of forces times levers is their rounding.
    return max(tolerance * terms, 1e-12 * levers)
