"""The mass matrix D(q), and M(q) = D(q) + J with the motors."""

import numpy as np
from numpy.typing import ArrayLike

from dynamics.body import Bodies, bodies
from dynamics.vector import (
    Vector,
    add,
    apply,
    axis,
    cross,
    dot,
    origin,
    rotate_tensor,
    row,
    scale,
    subtract,
)
from kinematics.chain import Array, Chain
from kinematics.forward import forward_kernel
from kinematics.kernel import kernel


@kernel
def join(
    mass: float, center: Vector, tensor: Array, other_mass: float, other_center: Vector
) -> tuple[float, Vector]:
    """Mass and centre of two bodies together; the parallel-axis term is added to ``tensor``.

    With d between the centres and m = m_1 m_2 / (m_1 + m_2), that term is m (|d|^2 I - d d^T).
    """
    total = mass + other_mass
    if total == 0.0:
        return 0.0, other_center
    share = other_mass / total
    d = subtract(other_center, center)
    reduced = mass * share
    square = dot(d, d)
    for i in range(3):
        for j in range(3):
            tensor[i, j] -= reduced * d[i] * d[j]
        tensor[i, i] += reduced * square
    return total, add(center, scale(share, d))


@kernel
def mass_matrix_kernel(bodies: Bodies, frames: Array, tensors: Array, D: Array) -> None:
    """Write D(q) of the joint ``frames`` (n, 4, 4) into D (n, n); ``tensors`` (2, 3, 3) is scratch.

    Composite rigid bodies: what joint j and all beyond it carry accelerates with the unit
    acceleration of joint j; the force this takes is felt at every joint i <= j.
    """
    composite, own = tensors[0], tensors[1]
    composite[:] = 0.0
    mass, center = 0.0, (0.0, 0.0, 0.0)
    for j in range(D.shape[0] - 1, -1, -1):
        z, o = axis(frames, j), origin(frames, j)
        rotate_tensor(frames[j], bodies.tensors[j], own)
        for a in range(3):
            for b in range(3):
                composite[a, b] += own[a, b]
        at = add(o, apply(frames[j], row(bodies.centers, j)))
        mass, center = join(mass, center, composite, bodies.masses[j], at)
        moment = (0.0, 0.0, 0.0)
        if bodies.types[j] == 0:
            force = scale(mass, cross(z, subtract(center, o)))
            moment = apply(composite, z)
        else:
            force = scale(mass, z)
        for i in range(j, -1, -1):
            z, o = axis(frames, i), origin(frames, i)
            if bodies.types[i] == 0:
                D[i, j] = dot(z, add(moment, cross(subtract(center, o), force)))
            else:
                D[i, j] = dot(z, force)
            D[j, i] = D[i, j]


@kernel
def mass_matrix_batch_kernel(bodies: Bodies, q: Array, D: Array) -> None:
    """Write D(q) of a batch q (m, n) into D (m, n, n)."""
    frames, tensors = np.empty((q.shape[1], 4, 4)), np.empty((2, 3, 3))
    for k in range(q.shape[0]):
        forward_kernel(bodies.types, bodies.offsets, q[k], frames)
        mass_matrix_kernel(bodies, frames, tensors, D[k])


def mass_matrix(chain: Chain, q: ArrayLike) -> Array:
    """Mass matrix D(q) = sum_i m_i J_vi^T J_vi + J_wi^T R_i I_i R_i^T J_wi, without the motors.

    Composite rigid body algorithm ("Efficient dynamic computer simulation of robotic
    mechanisms").

    Args:
        chain: The robot.
        q: One configuration (n,) or a batch (..., n) [rad or m].

    Returns:
        Symmetric, shape (..., n, n) [kg m^2, kg m or kg].

    Raises:
        InvalidRobotState: Wrong length or not finite.
        MissingInertia: Some joint carries nothing that has an inertia.
    """
    q = chain.configuration(q)
    flat = q.reshape(-1, chain.n)
    D = np.empty((flat.shape[0], chain.n, chain.n))
    mass_matrix_batch_kernel(bodies(chain), flat, D)
    return D.reshape(*q.shape[:-1], chain.n, chain.n)


def augmented_mass_matrix(chain: Chain, q: ArrayLike) -> Array:
    """M(q) = D(q) + J with J = diag(motor inertia reflected at the joints), shape (..., n, n).

    Raises:
        InvalidRobotState: Wrong length or not finite.
        MissingInertia: Some joint carries nothing that has an inertia.
    """
    return mass_matrix(chain, q) + np.diag(chain.motor_inertia)
