"""The potential U(q) = sum_i U_att(O_i(q)) + U_rep(O_i(q)) and its slope in joint space.

With e_i = O_i - O_i(goal), rho the signed distance of O_i from a convex obstacle, pi the orthogonal
projection onto it, and u = (O_i - pi(O_i)) / rho, which points out of the obstacle,

    U_att = c |e|^2 / 2                       F_att = -c e               where |e| <= d,
    U_att = c d |e| - c d^2 / 2               F_att = -c d e / |e|       beyond,
    U_rep = eta/2 (1/rho - 1/rho_0)^2         F_rep = eta (1/rho - 1/rho_0) u / rho^2
    -grad_q U = sum_i J_i^T (F_att + F_rep).

An obstacle is felt where rho <= rho_0. Nearer than rho_m the potential goes on along its tangent,
so that it and its slope stay finite and continuous on the surface and inside, where the force
points along the shortest way out. An obstacle of several convex pieces (a mesh, a cloud of points)
pushes once, from the piece that is nearest. Source: "Real-time obstacle avoidance for
manipulators and mobile robots", International Journal of Robotics Research, 1986.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from compiled.kernel import kernel
from kinematics.arrays import Array, Indices
from kinematics.model.chain import Chain
from obstacles.projection.fcl_projection import FclProjector
from obstacles.projection.projection import Projector
from planning.field.control_points import ControlPoints, control_points
from planning.field.weights import FieldWeights

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
def repulsion_kernel(field: FieldArrays, distances: Array, outward: Array, forces: Array) -> float:
    """Write F_rep of the points into ``forces`` (m, 3); the sum of U_rep [J].

    Args:
        field: The weights.
        distances: Signed, of the points from o obstacles, shape (m, o) [m].
        outward: Directions in which these grow, shape (m, o, 3).
        forces: Shape (m, 3) [N].
    """
    weights, reach = field.repulsive, field.reach
    total = 0.0
    forces[:] = 0.0
    for i in range(distances.shape[0]):
        for k in range(distances.shape[1]):
            rho = distances[i, k] - field.radii[i]
            if rho <= reach:
                near = max(rho, field.least)
                rise = 1.0 / near - 1.0 / reach
                push = weights[i] * rise / (near * near)
                total += 0.5 * weights[i] * rise * rise + push * (near - rho)
                for row in range(3):
                    forces[i, row] += push * outward[i, k, row]
    return total


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


@dataclass(frozen=True, slots=True, eq=False)
class FieldValue:
    """The potential at a configuration, with m control points and o obstacles.

    Args:
        potential: U [J].
        joint_force: -grad_q U, shape (n,) [N m or N].
        points: O_i, shape (m, 3) [m].
        attractive_forces: Shape (m, 3) [N].
        repulsive_forces: Of all obstacles together, shape (m, 3) [N].
        projections: pi(O_i) onto the nearest obstacle, shape (m, 3) [m]; NaN where there is none.
        distances: Signed distance to it, shape (m,) [m]; infinite where there is none.
        nearest: Which obstacle that is, shape (m,); -1 where there is none.
    """

    potential: float
    joint_force: Array
    points: Array
    attractive_forces: Array
    repulsive_forces: Array
    projections: Array
    distances: Array
    nearest: Indices


class Slope(NamedTuple):
    """The potential at a configuration, and where it falls.

    Args:
        potential: U [J].
        joint_force: -grad_q U, shape (n,) [N m or N].
        least_force: The joint force that counts as none there [N m or N].
    """

    potential: float
    joint_force: Array
    least_force: float


class Field:
    """The potential of an arm on its way to a goal among obstacles.

    Args:
        chain: The arm.
        where: Its control points.
        obstacles: What pushes them, projected onto in closed form or by FCL.
        goal: Where they are pulled to, shape (n,).
        weights: How strongly.
        joint_weight: k of a pull in joint space too, U = k |q - q_goal|^2 / 2 [N m].

    Raises:
        InvalidOption: Weights are given for another number of points.
    """

    def __init__(
        self,
        chain: Chain,
        where: ControlPoints,
        obstacles: Projector | FclProjector,
        goal: Array,
        weights: FieldWeights,
        joint_weight: float = 0.0,
    ) -> None:
        self._chain = chain
        self._where = where
        self._obstacles = obstacles
        self.goal = np.array(goal, dtype=np.float64)
        self._joint_weight = joint_weight
        attractive, repulsive = weights.each(len(where))
        self._arrays = FieldArrays(
            joints=where.joints,
            places=where.places,
            radii=where.radii,
            goals=control_points(chain, where, goal)[0],
            attractive=attractive,
            repulsive=repulsive,
            cap=float(weights.attractive_cap),
            reach=float(weights.influence_distance),
            least=float(weights.least_distance),
        )

    @property
    def goals(self) -> Array:
        """Positions of the control points at the goal, shape (m, 3) [m]."""
        return self._arrays.goals

    def at(self, q: Array) -> FieldValue:
        """The value of the field at a configuration q (n,)."""
        m, o = len(self._where), len(self._obstacles.ids)
        terms = self._terms(q, np.full(m, np.inf))
        projections, distances = terms.projections, terms.distances
        nearest, rows = np.full(m, -1), np.arange(m)
        shown, far = np.full((m, 3), np.nan), np.full(m, np.inf)
        if o > 0:
            nearest = distances.argmin(axis=1)
            shown, far = projections[rows, nearest], distances[rows, nearest]
        return FieldValue(
            terms.potential,
            terms.force,
            terms.points,
            terms.pulls,
            terms.pushes,
            shown,
            far,
            nearest,
        )

    def slope(self, q: Array, tolerance: float = 0.0) -> Slope:
        """Potential, joint force, and the force that counts as none at a configuration q (n,).

        Obstacles that are not felt are left out.

        Args:
            q: Configuration, shape (n,) [rad or m].
            tolerance: Share of the joint force's terms, see ``smallest_force_kernel``.
        """
        terms = self._terms(q, self._arrays.radii + self._arrays.reach)
        least = smallest_force_kernel(
            terms.jacobians, terms.pulls, terms.pushes, terms.spring, tolerance
        )
        return Slope(terms.potential, terms.force, float(least))

    def _terms(self, q: Array, within: Array) -> "_Terms":
        """The terms of the field, of obstacles no farther from the points than ``within``, (m,)."""
        m = len(self._where)
        points, jacobians = control_points(self._chain, self._where, q)
        pulls, pushes, force = np.empty((m, 3)), np.empty((m, 3)), np.empty(self._chain.n)
        potential = attraction_kernel(self._arrays, points, pulls)
        projections, distances = self._obstacles(points, within)
        outward = _outward(self._obstacles, points, projections, distances)
        potential += repulsion_kernel(self._arrays, distances, outward, pushes)
        force_kernel(jacobians, pulls, pushes, force)
        e = self.goal - q
        potential += 0.5 * self._joint_weight * float(e @ e)
        spring = self._joint_weight * e
        force += spring
        return _Terms(
            float(potential), force, points, jacobians, pulls, pushes, spring, projections,
            distances,
        )  # fmt: skip


class _Terms(NamedTuple):
    """The terms of a field at a configuration, as ``FieldValue`` has them, for every obstacle.

    Jacobians are those of the points; ``spring`` is the joint force of the pull in joint space.
    """

    potential: float
    force: Array
    points: Array
    jacobians: Array
    pulls: Array
    pushes: Array
    spring: Array
    projections: Array
    distances: Array


def _outward(
    obstacles: Projector | FclProjector, points: Array, projections: Array, distances: Array
) -> Array:
    """The directions in which distances (m, o) of points (m, 3) grow, shape (m, o, 3)."""
    with np.errstate(invalid="ignore", divide="ignore"):
        outward = np.asarray((points[:, None] - projections) / distances[..., None])
    on_surface = np.abs(distances) <= ON_SURFACE
    for i, k in np.argwhere(on_surface) if on_surface.any() else ():
        steps = NUDGE * np.vstack([np.eye(3), -np.eye(3)])
        beside = obstacles(points[i] + steps)[1][:, k]
        slope = beside[:3] - beside[3:]
        length = float(np.linalg.norm(slope))
        outward[i, k] = slope / length if length > 0.0 else 0.0
    return outward
