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

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from kinematics.arrays import Array, Indices
from kinematics.model.chain import Chain
from obstacles.projection.fcl_projection import FclProjector
from obstacles.projection.projection import Projector
from planning.field.control_points import ControlPoints, control_points
from planning.field.field_kernels import (
    NUDGE,
    ON_SURFACE,
    FieldArrays,
    attraction_kernel,
    force_kernel,
    repulsion_kernel,
    smallest_force_kernel,
)
from planning.field.weights import FieldWeights


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
        m, o = len(self._where), len(self._obstacles.ids)
        points, jacobians = control_points(self._chain, self._where, q)
        pulls, pushes, force = np.empty((m, 3)), np.empty((m, 3)), np.empty(self._chain.n)
        projections, distances = np.empty((m, o, 3)), np.empty((m, o))
        potential = attraction_kernel(self._arrays, points, pulls)
        if isinstance(self._obstacles, FclProjector):
            projections, distances = self._obstacles(points, within)
            outward = _outward(self._obstacles, points, projections, distances)
            potential += repulsion(self._arrays, distances, outward, pushes)
        else:
            potential += repulsion_kernel(
                self._arrays,
                self._obstacles.arrays,
                points,
                within,
                projections,
                distances,
                pushes,
            )
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


def repulsion(field: FieldArrays, distances: Array, outward: Array, forces: Array) -> float:
    """Write F_rep of m points into ``forces`` (m, 3), from distances that are known.

    Args:
        field: The weights.
        distances: Signed, of the points from o obstacles, shape (m, o) [m].
        outward: Directions in which these grow, shape (m, o, 3).
        forces: Shape (m, 3) [N].

    Returns:
        The sum of U_rep [J].
    """
    rho = distances - field.radii[:, None]
    felt = rho <= field.reach
    near = np.where(felt, np.maximum(rho, field.least), field.reach)
    rise = 1.0 / near - 1.0 / field.reach
    push = field.repulsive[:, None] * rise / (near * near)
    forces[:] = np.einsum("mo,moi->mi", push, np.where(felt[..., None], outward, 0.0))
    tangent = np.where(felt, push * (near - np.where(felt, rho, near)), 0.0)
    return float((0.5 * field.repulsive[:, None] * rise * rise + tangent).sum())


def _outward(obstacles: FclProjector, points: Array, projections: Array, distances: Array) -> Array:
    """The directions in which distances (m, o) of points (m, 3) grow, shape (m, o, 3)."""
    with np.errstate(invalid="ignore", divide="ignore"):
        outward = np.asarray((points[:, None] - projections) / distances[..., None])
    for i, k in np.argwhere(np.abs(distances) <= ON_SURFACE):
        steps = NUDGE * np.vstack([np.eye(3), -np.eye(3)])
        beside = obstacles(points[i] + steps)[1][:, k]
        slope = beside[:3] - beside[3:]
        length = float(np.linalg.norm(slope))
        outward[i, k] = slope / length if length > 0.0 else 0.0
    return outward
