"""Constraints on a chain, packed for the kernels: values, residuals and their Jacobians."""

import hashlib
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from compiled.kernel import kernel
from kinematics.arrays import Array, Indices, frozen
from kinematics.forward import frames_kernel
from kinematics.model.chain import Chain
from planning.constraints.kinds.constraint import (
    ClearanceConstraint,
    Constraint,
    ToolSpeedConstraint,
    TorqueConstraint,
)
from planning.constraints.row import WIDTH, Row
from planning.constraints.row_value import gradient_kernel, residual_kernel


@dataclass(frozen=True, slots=True, eq=False)
class ConstraintSet:
    """Constraints on one robot's configurations and motions (m rows).

    Args:
        chain: The robot.
        constraints: Constraints in the order they were given.

    Also known: ``rows``, m of them; ``owners``, the constraint each row belongs to, (m,);
    ``packed``, the rows as kernels read them, (m, WIDTH); ``weights``, inf for a hard row, (m,);
    ``content_hash``.

    Raises:
        InvalidGoal: A constraint does not fit the chain.
        InvalidLinkName: A constraint names a link that the chain does not have.
    """

    chain: Chain
    constraints: tuple[Constraint, ...] = ()
    rows: tuple[Row, ...] = field(init=False, repr=False)
    owners: Indices = field(init=False, repr=False)
    packed: Array = field(init=False, repr=False)
    weights: Array = field(init=False, repr=False)
    content_hash: str = field(init=False, repr=False)

    def __post_init__(self) -> None:
        rows, owners, weights = [], [], []
        for i, constraint in enumerate(self.constraints):
            own = constraint.rows(self.chain)
            rows += own
            owners += [i] * len(own)
            weights += [np.inf if constraint.weight is None else constraint.weight] * len(own)
        numbers = np.array(owners, dtype=np.int64)
        numbers.setflags(write=False)
        packed = np.array([row.packed() for row in rows]).reshape(-1, WIDTH)
        object.__setattr__(self, "constraints", tuple(self.constraints))
        object.__setattr__(self, "rows", tuple(rows))
        object.__setattr__(self, "owners", numbers)
        object.__setattr__(self, "packed", frozen(packed))
        object.__setattr__(self, "weights", frozen(weights))
        object.__setattr__(self, "content_hash", self._hash())

    def __eq__(self, other: object) -> bool:
        return isinstance(other, ConstraintSet) and other.content_hash == self.content_hash

    def __hash__(self) -> int:
        return hash(self.content_hash)

    def __bool__(self) -> bool:
        return bool(self.constraints)

    def _hash(self) -> str:
        digest = hashlib.sha256(self.chain.content_hash.encode())
        digest.update(self.packed.tobytes() + self.weights.tobytes())
        limits = [] if self.torque is None else [repr(self.torque.limits)]
        digest.update(repr([self.margin, self.tool_speed, *limits]).encode())
        return digest.hexdigest()

    @property
    def margin(self) -> float:
        """The largest clearance asked for, 0 where none is [m]."""
        given = [c.margin for c in self.constraints if isinstance(c, ClearanceConstraint)]
        return max(given, default=0.0)

    @property
    def tool_speed(self) -> float | None:
        """The least tool speed limit [m/s]."""
        given = [c.limit for c in self.constraints if isinstance(c, ToolSpeedConstraint)]
        return min(given, default=None)

    @property
    def torque(self) -> TorqueConstraint | None:
        """The torque constraint, the last one where there are several."""
        given = [c for c in self.constraints if isinstance(c, TorqueConstraint)]
        return given[-1] if given else None

    @property
    def hard(self) -> "ConstraintSet":
        """The constraints that must hold."""
        return ConstraintSet(self.chain, tuple(c for c in self.constraints if c.weight is None))

    @property
    def soft(self) -> "ConstraintSet":
        """The constraints that have a weight."""
        return ConstraintSet(self.chain, tuple(c for c in self.constraints if c.weight is not None))

    def label(self, row: int) -> str:
        """Name of the scalar that a row bounds."""
        name, scalar = self.constraints[int(self.owners[row])].name, self.rows[row].label
        told = name if scalar == name else f"{name}, {scalar}"
        return f"constraint {int(self.owners[row])} ({told})"

    def values(self, q: ArrayLike) -> Array:
        """Values of the rows at one configuration (n,) or many (..., n), shape (..., m).

        Raises:
            InvalidRobotState: Wrong length or not finite.
        """
        return self._evaluate_batch(q)[0]

    def residuals(self, q: ArrayLike) -> Array:
        """Residuals max(value - upper, lower - value), shape (..., m), positive where violated.

        Raises:
            InvalidRobotState: Wrong length or not finite.
        """
        return self._evaluate_batch(q)[1]

    def evaluate(self, q: ArrayLike) -> tuple[Array, Array]:
        """Residuals (..., m) and their Jacobian (..., m, n).

        Raises:
            InvalidRobotState: Wrong length or not finite.
        """
        _, residuals, jacobian = self._evaluate_batch(q)
        return residuals, jacobian

    def _evaluate_batch(self, q: ArrayLike) -> tuple[Array, Array, Array]:
        batch = self.chain.configuration(q)
        flat, m, n = batch.reshape(-1, self.chain.n), len(self.rows), self.chain.n
        values, residuals = np.empty((len(flat), m)), np.empty((len(flat), m))
        jacobian = np.empty((len(flat), m, n))
        evaluate_batch_kernel(self.chain.model, self.packed, flat, values, residuals, jacobian)
        shape = batch.shape[:-1]
        return (
            values.reshape(*shape, m),
            residuals.reshape(*shape, m),
            jacobian.reshape(*shape, m, n),
        )


class RowWork(NamedTuple):
    """Values of m rows at a configuration, with scratch.

    Args:
        frames: Frames of the joints, shape (n, 4, 4).
        E: Scratch, shape (3, 3).
        values: Shape (m,).
        residuals: Shape (m,).
        jacobian: Jacobian of the residuals, shape (m, n).
    """

    frames: Array
    E: Array
    values: Array
    residuals: Array
    jacobian: Array


@kernel
def evaluate_kernel(chain: Array, packed: Array, q: Array, work: RowWork) -> float:
    """Write values, residuals and the residuals' Jacobian at q (n,); the largest residual."""
    frames_kernel(chain, q, work.frames)
    worst = -np.inf
    for i in range(packed.shape[0]):
        value = gradient_kernel(chain, q, work.frames, packed[i], work.E, work.jacobian[i])
        residual, sign = residual_kernel(value, packed[i])
        work.values[i], work.residuals[i] = value, residual
        worst = max(worst, residual)
        if sign < 0.0:
            for j in range(q.shape[0]):
                work.jacobian[i, j] = -work.jacobian[i, j]
    return worst


@kernel
def evaluate_batch_kernel(
    chain: Array,
    packed: Array,
    q: Array,
    values: Array,
    residuals: Array,
    jacobian: Array,
) -> None:
    """Values, residuals (k, m) and Jacobians (k, m, n) of a batch q (k, n)."""
    frames, E = np.empty((q.shape[1], 4, 4)), np.empty((3, 3))
    for k in range(q.shape[0]):
        work = RowWork(frames, E, values[k], residuals[k], jacobian[k])
        evaluate_kernel(chain, packed, q[k], work)
