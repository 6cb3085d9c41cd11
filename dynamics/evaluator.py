"""One robot's dynamics at one state, with as little as possible between Python and the kernels."""

from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from compiled.kernel import kernel
from dynamics.forward import acceleration_kernel, massless
from dynamics.kernels.composite import (
    COMPOSITE_WORK,
    coriolis_kernel,
    frames_kernel,
    mass_matrix_kernel,
)
from dynamics.kernels.recursion import WORK, gravity_kernel, inverse_kernel
from dynamics.model.body import bodies
from dynamics.parameters.regressor import motor_columns, regressor_kernel
from kinematics.arrays import Array
from kinematics.model.chain import Chain


@kernel
def mass_matrix_at(rows: Array, q: Array, work: Array, D: Array) -> bool:
    """D(q), unless q has the wrong length."""
    if q.shape[0] != D.shape[0]:
        return False
    frames_kernel(rows, q, work)
    mass_matrix_kernel(rows, work, D)
    return True


@kernel
def coriolis_matrix_at(rows: Array, q: Array, qd: Array, work: Array, C: Array) -> bool:
    """C(q, q_dot), unless a vector has the wrong length."""
    n = C.shape[0]
    if q.shape[0] != n or qd.shape[0] != n:
        return False
    frames_kernel(rows, q, work)
    coriolis_kernel(rows, qd, work, C)
    return True


@kernel
def gravity_at(rows: Array, q: Array, work: Array, G: Array) -> bool:
    """G(q), unless q has the wrong length."""
    if q.shape[0] != G.shape[0]:
        return False
    gravity_kernel(rows, q, work, G)
    return True


@kernel
def inverse_at(rows: Array, q: Array, qd: Array, qdd: Array, work: Array, torque: Array) -> bool:
    """Torques of a motion, unless a vector has the wrong length."""
    n = torque.shape[0]
    if q.shape[0] != n or qd.shape[0] != n or qdd.shape[0] != n:
        return False
    inverse_kernel(rows, q, qd, qdd, work, torque)
    return True


@kernel
def regressor_at(rows: Array, q: Array, qd: Array, qdd: Array, work: Array, Y: Array) -> bool:
    """Y(q, q_dot, q_ddot), unless a vector has the wrong length; ``work`` is (n, 30)."""
    n = Y.shape[0]
    if q.shape[0] != n or qd.shape[0] != n or qdd.shape[0] != n:
        return False
    motion = work[:, 26:]
    for i in range(n):
        motion[i, 0], motion[i, 1], motion[i, 2], motion[i, 3] = q[i], qd[i], qd[i], qdd[i]
    frames_kernel(rows, q, work)
    regressor_kernel(rows, motion, work[:, 12:26], work, Y)
    motor_columns(motion, Y)
    return True


class DynamicsEvaluator:
    """The dynamics of one robot, state by state, for loops in Python that can't be batched.

    The functions of this package check what they are given and answer new arrays; here the vectors
    must be contiguous float64 arrays of length n, nothing is checked but that length, and every
    answer is a buffer that the next call of the same method overwrites. Not for several threads.

    Args:
        chain: The robot.
        gravity: (3,) [m/s^2] in the base frame; the robot's own where none is given.

    Raises:
        MissingInertia: No link that a joint carries has an inertia.
    """

    __slots__ = ("_C", "_D", "_G", "_M", "_Y", "_qdd", "_rows", "_tau", "_work", "chain")

    def __init__(self, chain: Chain, gravity: ArrayLike | None = None) -> None:
        n = chain.n
        self.chain = chain
        # Writable like all else, so that each kernel is compiled for one kind of array only.
        self._rows = bodies(chain, gravity).rows.copy()
        self._work = np.zeros((n, max(COMPOSITE_WORK, WORK)))
        self._D, self._C, self._M = np.empty((3, n, n))
        self._G, self._tau, self._qdd = np.empty((3, n))
        self._Y = np.empty((n, 12 * n))

    def copy(self) -> Self:
        """Another evaluator of the same robot, say for another thread."""
        return type(self)(self.chain, self._rows[-1, :3])

    def mass_matrix(self, q: Array) -> Array:
        """D(q), shape (n, n), without the motors; see ``dynamics.mass_matrix``."""
        if mass_matrix_at(self._rows, q, self._work, self._D):
            return self._D
        raise self._wrong(q)

    def coriolis_matrix(self, q: Array, qd: Array) -> Array:
        """C(q, q_dot), shape (n, n); see ``dynamics.coriolis``."""
        if coriolis_matrix_at(self._rows, q, qd, self._work, self._C):
            return self._C
        raise self._wrong(q, qd)

    def gravity(self, q: Array) -> Array:
        """G(q), shape (n,); see ``dynamics.gravity``."""
        if gravity_at(self._rows, q, self._work, self._G):
            return self._G
        raise self._wrong(q)

    def inverse(self, q: Array, qd: Array, qdd: Array) -> Array:
        """Torques tau, shape (n,); see ``dynamics.inverse``."""
        if inverse_at(self._rows, q, qd, qdd, self._work, self._tau):
            return self._tau
        raise self._wrong(q, qd, qdd)

    def regressor(self, q: Array, qd: Array, qdd: Array) -> Array:
        """Regressor Y(q, q_dot, q_ddot) with the motors' columns, shape (n, 12 n)."""
        if regressor_at(self._rows, q, qd, qdd, self._work, self._Y):
            return self._Y
        raise self._wrong(q, qd, qdd)

    def forward(self, q: Array, qd: Array, torque: Array) -> Array:
        """Accelerations q_ddot, shape (n,); see ``dynamics.forward``.

        Raises:
            InvalidRobotState: A vector has the wrong length.
            MissingInertia: The mass matrix is not positive definite.
        """
        if not len(q) == len(qd) == len(torque) == self.chain.n:
            raise self._wrong(q, qd, torque)
        failed = acceleration_kernel(self._rows, q, qd, torque, self._work, self._M, self._qdd)
        if failed >= 0:
            raise massless(self.chain, failed)
        return self._qdd

    def _wrong(self, *vectors: Array) -> Exception:
        for vector in vectors:
            self.chain.configuration(vector)
        return AssertionError("the kernel refused vectors of the right length")
