"""Directions that the Jacobian of six joints loses near a singularity."""

import math

import numpy as np

from compiled.kernel import kernel
from compiled.linear_solve import solve_kernel
from kinematics.arrays import Array, Indices

#: Joints of such a Jacobian: as many as a pose has directions.
JOINTS = 6
#: A pivot no larger than this makes a matrix of metres and radians singular.
SINGULAR = 1e-14
#: Added to squares of singular values, so that matrices of them are regular however singular J is:
#: rounding of a pivot is a hundredth of it, and eigenvectors stay as they are.
_REGULAR = 1e-13


@kernel
def weakest_kernel(J: Array, joints: Indices, u: Array, v: Array, across: Array) -> float:
    """Write the left and right unit vectors of the least singular value of J into u, v; its value.

    By inverse iteration; ``across`` (6,) is a direction u must be normal to, or zero.
    """
    M, b = np.empty((JOINTS, JOINTS)), np.empty(JOINTS)
    for i in range(JOINTS):
        u[i] = 1.0 + 0.3 * math.sin(1.0 + 2.0 * i)
    for _ in range(6):
        along = np.dot(across, u)
        for i in range(JOINTS):
            b[i] = u[i] - along * across[i]
            for k in range(JOINTS):
                M[i, k] = 10.0 * across[i] * across[k]
                for a in range(JOINTS):
                    M[i, k] += J[i, joints[a]] * J[k, joints[a]]
            M[i, i] += _REGULAR
        solve_kernel(M, b, 0.0)
        b -= np.dot(across, b) * across
        u[:] = b / math.sqrt(np.sum(b * b))
    for a in range(JOINTS):
        v[a] = 0.0
        for i in range(JOINTS):
            v[a] += J[i, joints[a]] * u[i]
    value = math.sqrt(np.sum(v * v))
    # J^T u is rounding where the value is: what J moves least, directly.
    for a in range(JOINTS):
        b[a] = v[a] / value if value > 1e-6 else 1.0 + 0.3 * math.sin(1.0 + 2.0 * a)
    for _ in range(0 if value > 1e-6 else 6):
        for a in range(JOINTS):
            for c in range(JOINTS):
                M[a, c] = _REGULAR if a == c else 0.0
                for i in range(JOINTS):
                    M[a, c] += J[i, joints[a]] * J[i, joints[c]]
        solve_kernel(M, b, 0.0)
        b /= math.sqrt(np.sum(b * b))
    v[:] = b
    return value


@kernel
def joint_direction_kernel(J: Array, joints: Indices, w: Array) -> Array:
    """The unit direction of the joints (6,) that J takes to the direction w, or nearest to it."""
    M, v = np.empty((JOINTS, JOINTS)), np.zeros(JOINTS)
    for i in range(JOINTS):
        for k in range(JOINTS):
            M[i, k] = 1e-16 if i == k else 0.0
            for a in range(JOINTS):
                M[i, k] += J[i, joints[a]] * J[k, joints[a]]
    b = w.copy()
    solve_kernel(M, b, 0.0)
    for a in range(JOINTS):
        for i in range(JOINTS):
            v[a] += J[i, joints[a]] * b[i]
    return v / math.sqrt(np.sum(v * v))
