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
from kinematics.chain import Chain
from kinematics.compiled.kernel import kernel
from obstacles.fcl_projection import FclProjector
from obstacles.projection import Projector, project_kernel
from obstacles.projection_arrays import ProjectionArrays
from planning.field.control_points import ControlPoints, control_points, control_points_kernel
from planning.field.weights import FieldWeights

#: On a surface nothing points out of it: there the distance itself is differentiated [m].
_ON_SURFACE = 1e-9
#: Step of that numerical derivative [m].
_NUDGE = 1e-6


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
    if abs(distance) > _ON_SURFACE:
        for row in range(3):
            u[row] = (point[row] - projection[row]) / distance
        return
    around = np.empty((6, 3))
    for row in range(6):
        for axis in range(3):
            around[row, axis] = point[axis]
        around[row, row // 2] += _NUDGE if row % 2 == 0 else -_NUDGE
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


class FieldModel(NamedTuple):
    """A field for the kernels: the arm, its control points, the obstacles and the goal.

    Args:
        chain: ``Chain.model`` of the arm.
        points: The control points.
        obstacles: The obstacles, packed.
        goal: Configuration of the goal, shape (n,) [rad or m].
        joint_weight: k of the pull in joint space [N m].
    """

    chain: Array
    points: FieldArrays
    obstacles: ProjectionArrays
    goal: Array
    joint_weight: float


@kernel
def value_kernel(field: FieldModel, q: Array, joint_force: Array) -> float:
    """U at q (n,); -grad U is written into ``joint_force`` (n,)."""
    m, n = field.points.joints.shape[0], q.shape[0]
    owners = field.obstacles.owners
    o = owners[-1] + 1 if owners.shape[0] > 0 else 0
    points, jacobians = np.empty((m, 3)), np.empty((m, 3, n))
    pulls, pushes = np.empty((m, 3)), np.empty((m, 3))
    projections, distances = np.empty((m, o, 3)), np.empty((m, o))
    control_points_kernel(
        field.chain, field.points.joints, field.points.places, q, points, jacobians
    )
    potential = attraction_kernel(field.points, points, pulls)
    potential += repulsion_kernel(
        field.points,
        field.obstacles,
        points,
        field.points.radii + field.points.reach,
        projections,
        distances,
        pushes,
    )
    force_kernel(jacobians, pulls, pushes, joint_force)
    for j in range(n):
        e = field.goal[j] - q[j]
        potential += 0.5 * field.joint_weight * e * e
        joint_force[j] += field.joint_weight * e
    return potential


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
        self._goal = goal
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
    def model(self) -> FieldModel:
        """The field for the kernels, whose projections are closed forms.

        Raises:
            TypeError: The projections are FCL's.
        """
        if isinstance(self._obstacles, FclProjector):
            raise TypeError("kernels do not call FCL")
        return FieldModel(
            chain=self._chain.model,
            points=self._arrays,
            obstacles=self._obstacles.arrays,
            goal=np.array(self._goal, dtype=np.float64),
            joint_weight=float(self._joint_weight),
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

    def value(self, q: Array) -> tuple[float, Array]:
        """U at q, shape (n,), and -grad U, shape (n,); obstacles that are not felt are left out."""
        terms = self._terms(q, self._arrays.radii + self._arrays.reach)
        return terms.potential, terms.force

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
        if self._joint_weight > 0.0:
            e = self._goal - q
            potential += 0.5 * self._joint_weight * float(e @ e)
            force += self._joint_weight * e
        return _Terms(float(potential), force, points, pulls, pushes, projections, distances)


class _Terms(NamedTuple):
    """The terms of a field at a configuration, as ``FieldValue`` has them, for every obstacle."""

    potential: float
    force: Array
    points: Array
    pulls: Array
    pushes: Array
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
    for i, k in np.argwhere(np.abs(distances) <= _ON_SURFACE):
        steps = _NUDGE * np.vstack([np.eye(3), -np.eye(3)])
        beside = obstacles(points[i] + steps)[1][:, k]
        slope = beside[:3] - beside[3:]
        length = float(np.linalg.norm(slope))
        outward[i, k] = slope / length if length > 0.0 else 0.0
    return outward
