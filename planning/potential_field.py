"""Planning by descent on an artificial potential, U = sum_i U_att(O_i) + U_rep(O_i).

The control points O_i are the origins of the frames that each joint moves (the last one is the
tip). With e_i = O_i - O_i(goal), pi the orthogonal projection onto a convex obstacle and
rho = |O_i - pi(O_i)|,

    F_att = -c e_i min(1, d / |e_i|),
    F_rep = eta (1 / rho - 1 / rho_0) (O_i - pi(O_i)) / rho^3      where rho <= rho_0,
    q <- q + alpha sum_i J_i^T (F_att + F_rep).

It is cheap and has local minima, so it notices that it no longer gets nearer and gives up early.
Every step is proved free before it is taken, and it has arrived as soon as the straight way to the
goal is. Source: "Real-time obstacle avoidance for manipulators and mobile robots", International
Journal of Robotics Research, 1986.
"""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from kinematics.chain import Array, Chain, Indices
from kinematics.errors import InvalidOption
from kinematics.forward import forward_kernel
from kinematics.jacobian import jacobian_kernel
from kinematics.kernel import kernel
from obstacles.checker import Checker
from obstacles.projection import Projector
from obstacles.scene import Scene
from planning.deadline import Deadline

#: A control point inside an obstacle is pushed as if it were this near to its surface [m].
_LEAST_DISTANCE = 5e-3
_HALVINGS = 4


@dataclass(frozen=True, slots=True)
class FieldOptions:
    """Parameters of the field and the descent.

    Args:
        attractive_weight: c, pull towards the goal [1/m].
        attractive_cap: d, distance beyond which the pull no longer grows [m].
        repulsive_weight: eta, push away from obstacles.
        influence_distance: rho_0, distance within which an obstacle is felt [m].
        step: Longest joint motion in one step [rad or m].
        max_iterations: Steps before it gives up.
        patience: Steps without getting nearer before it gives up.

    Raises:
        InvalidOption: A value is not a positive number.
    """

    attractive_weight: float = 1.0
    attractive_cap: float = 0.2
    repulsive_weight: float = 2e-4
    influence_distance: float = 0.1
    step: float = 0.08
    max_iterations: int = 150
    patience: int = 12

    def __post_init__(self) -> None:
        for item in fields(self):
            value = getattr(self, item.name)
            if isinstance(value, bool) or not isinstance(value, int | float) or not value > 0:
                raise InvalidOption(f"planner_options.{item.name} must be a positive number")

    @classmethod
    def of(cls, options: Mapping[str, Any]) -> "FieldOptions":
        """The parameters named in ``options``, the others as they are by default.

        Raises:
            InvalidOption: A name is unknown, or a value out of its range.
        """
        known = [item.name for item in fields(cls)]
        unknown = sorted(set(options) - set(known))
        if unknown:
            raise InvalidOption(
                f"planner 'potential_field' has no option {unknown[0]!r}",
                hint=f"Its options are: {', '.join(known)}.",
            )
        return cls(**options)


@dataclass(frozen=True, slots=True, eq=False)
class FieldResult:
    """Where the descent went.

    Args:
        waypoints: Shape (k, n), every leg proved free; None where it got stuck.
        iterations: Steps taken.
        detail: How it ended, for a person.
    """

    waypoints: Array | None
    iterations: int
    detail: str


@kernel
def control_points_kernel(
    types: Indices, offsets: Array, T_tip: Array, q: Array, points: Array, jacobians: Array
) -> None:
    """Write the control points (n, 3) and their linear Jacobians (n, 3, n) at q (n,)."""
    n = q.shape[0]
    frames, J = np.empty((n, 4, 4)), np.empty((6, n))
    forward_kernel(types, offsets, q, frames)
    for i in range(n):
        local = T_tip[:3, 3] if i == n - 1 else offsets[i + 1, :3, 3]
        for row in range(3):
            points[i, row] = frames[i, row, 3]
            for k in range(3):
                points[i, row] += frames[i, row, k] * local[k]
        jacobian_kernel(types, frames, points[i], i, J)
        jacobians[i] = J[:3]


def control_points(chain: Chain, q: Array) -> tuple[Array, Array]:
    """Origins of the frames that each joint moves, (n, 3) [m], and their Jacobians (n, 3, n)."""
    points, jacobians = np.empty((chain.n, 3)), np.empty((chain.n, 3, chain.n))
    T_tip = chain.tip.T_joint_link
    control_points_kernel(chain.joint_types, chain.offsets, T_tip, q, points, jacobians)
    return points, jacobians


def attractive_forces(points: Array, goal_points: Array, options: FieldOptions) -> Array:
    """Capped pull of each control point towards where it is at the goal, shape (n, 3)."""
    e = goal_points - points
    length = np.linalg.norm(e, axis=1, keepdims=True)
    cap = options.attractive_cap
    return np.asarray(
        options.attractive_weight * e * np.minimum(1.0, cap / np.maximum(length, cap))
    )


def repulsive_forces(points: Array, projector: Projector, options: FieldOptions) -> Array:
    """Push of all obstacles on each control point, shape (n, 3)."""
    projections, distances = projector(points)
    away = points[:, None, :] - projections
    # Inside an obstacle the way out leads through the projection.
    away = np.where(distances[..., None] < 0.0, -away, away)
    direction = away / np.maximum(np.linalg.norm(away, axis=2, keepdims=True), 1e-12)
    rho = np.maximum(distances, _LEAST_DISTANCE)[..., None]
    near = rho <= options.influence_distance
    strength = options.repulsive_weight * (1.0 / rho - 1.0 / options.influence_distance) / rho**2
    return np.asarray(np.where(near, strength * direction, 0.0).sum(axis=1))


def potential_field(
    chain: Chain,
    checker: Checker,
    scene: Scene,
    start: Array,
    goal: Array,
    options: FieldOptions,
    deadline: Deadline,
) -> FieldResult:
    """Descend from ``start`` to ``goal``, both (n,), along proved steps."""
    goal_points, _ = control_points(chain, goal)
    projector = Projector(scene)
    waypoints = [start]
    q, nearest, stale = start, np.inf, 0
    for iteration in range(1, options.max_iterations + 1):
        if deadline.passed:
            return FieldResult(None, iteration, "The time was up.")
        if checker.free(q, goal):
            return FieldResult(np.array([*waypoints, goal]), iteration, "Reached the goal.")
        points, jacobians = control_points(chain, q)
        left = float(np.linalg.norm(points - goal_points))
        stale = 0 if left < 0.99 * nearest else stale + 1
        nearest = min(left, nearest)
        if stale > options.patience:
            return FieldResult(None, iteration, f"A local minimum, {left:.3f} m from the goal.")
        forces = attractive_forces(points, goal_points, options)
        forces += repulsive_forces(points, projector, options)
        moved = _step(chain, checker, q, np.einsum("iaj,ia->j", jacobians, forces), options.step)
        if moved is None:
            return FieldResult(None, iteration, f"Blocked, {left:.3f} m from the goal.")
        waypoints.append(moved)
        q = moved
    return FieldResult(None, options.max_iterations, "The steps were used up.")


def _step(
    chain: Chain, checker: Checker, q: Array, joint_force: Array, step: float
) -> Array | None:
    """The longest proved step along the force, halved a few times; None where none is."""
    strongest = float(np.abs(joint_force).max())
    if strongest < 1e-9:
        return None
    for _ in range(_HALVINGS):
        moved = q + joint_force * (step / strongest)
        moved = np.clip(moved, chain.limits.lower, chain.limits.upper)
        if checker.free(q, moved):
            return np.asarray(moved)
        step /= 2.0
    return None
