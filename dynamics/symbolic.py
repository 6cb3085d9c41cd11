"""The equations of motion as CasADi expressions: the twin that an optimiser differentiates.

D and U are written down as the notes define them, link by link from the partial Jacobians of the
centres of mass, and C by the Christoffel symbols of D's derivatives; the kernels reach the same
values by recursions. A test holds the two equal.
"""

from typing import NamedTuple

import casadi
from numpy.typing import ArrayLike

from dynamics.model.body import COULOMB, SMOOTH_SPEED, Bodies, bodies
from kinematics.caches.bounded_cache import bounded_cache
from kinematics.model.chain import Chain
from kinematics.symbolic import Expression, symbolic_frames


class Equations(NamedTuple):
    """The terms of M q_ddot + C q_dot + B q_dot + G = tau as expressions.

    Args:
        mass_matrix: D(q), n x n, without the motors.
        coriolis_matrix: C(q, q_dot) of the Christoffel symbols, n x n.
        gravity: G(q), n x 1.
        kinetic: Kinetic energy with the motors' part [J].
        potential: Potential energy U(q) [J].
        torque: tau, n x 1.
    """

    mass_matrix: Expression
    coriolis_matrix: Expression
    gravity: Expression
    kinetic: Expression
    potential: Expression
    torque: Expression


def symbolic_mass_matrix(chain: Chain, q: Expression) -> Expression:
    """D(q) = sum_i m_i J_vi^T J_vi + J_wi^T R_i I_i R_i^T J_wi, n x n.

    Raises:
        MissingInertia: No link that a joint carries has an inertia.
        InvalidRobotState: q has not one entry for each joint.
    """
    packed, frames = bodies(chain), symbolic_frames(chain, q)
    D = type(q)(chain.n, chain.n)
    for i in range(chain.n):
        Jv, Jw = _partial_jacobians(packed, frames, i)
        R = frames[i][:3, :3]
        about = casadi.mtimes([R, casadi.DM(packed.tensors[i]), R.T])
        D += packed.masses[i] * casadi.mtimes(Jv.T, Jv) + casadi.mtimes([Jw.T, about, Jw])
    return D


def symbolic_potential(chain: Chain, q: Expression, gravity: ArrayLike | None = None) -> Expression:
    """Potential energy U(q) = -sum_i m_i g . r_i(q) [J].

    Raises:
        MissingInertia: No link that a joint carries has an inertia.
        InvalidRobotState: q has not one entry for each joint.
        InvalidOption: Gravity is not three finite numbers.
    """
    packed, frames = bodies(chain, gravity), symbolic_frames(chain, q)
    g = casadi.DM(packed.gravity)
    return -sum(
        packed.masses[i] * casadi.dot(g, _center(packed, frames, i)) for i in range(chain.n)
    )


def symbolic_equations(
    chain: Chain,
    q: Expression,
    qd: Expression,
    qdd: Expression,
    gravity: ArrayLike | None = None,
) -> Equations:
    """All terms of the equations of motion, for symbols q, q_dot and any expression q_ddot.

    c_ijk = (d_kj,i + d_ki,j - d_ij,k) / 2 and C_kj = sum_i c_ijk q_dot_i; G = grad U.

    Args:
        chain: The robot.
        q: Symbols (they are differentiated by), n x 1.
        qd: n x 1.
        qdd: n x 1.
        gravity: (3,) [m/s^2] in the base frame; the robot's own where none is given.

    Raises:
        MissingInertia: No link that a joint carries has an inertia.
        InvalidRobotState: q has not one entry for each joint.
        InvalidOption: Gravity is not three finite numbers.
    """
    n = chain.n
    D, U = symbolic_mass_matrix(chain, q), symbolic_potential(chain, q, gravity)
    partial = [casadi.reshape(casadi.jacobian(casadi.vec(D), q[i]), n, n) for i in range(n)]
    C = type(q)(n, n)
    for k in range(n):
        for j in range(n):
            C[k, j] = 0.5 * sum(
                (partial[i][k, j] + partial[j][k, i] - partial[k][i, j]) * qd[i] for i in range(n)
            )
    G = casadi.gradient(U, q)
    M = D + casadi.diag(casadi.DM(chain.motor_inertia))
    friction = casadi.DM(chain.viscous_friction) * qd
    if chain.coulomb_friction.any():
        friction += casadi.DM(chain.coulomb_friction) * casadi.tanh(qd / SMOOTH_SPEED)
    torque = casadi.mtimes(M, qdd) + casadi.mtimes(C, qd) + friction + G
    return Equations(D, C, G, 0.5 * casadi.bilin(M, qd, qd), U, torque)


def symbolic_inverse_dynamics(
    chain: Chain,
    q: Expression,
    qd: Expression,
    qdd: Expression,
    gravity: ArrayLike | None = None,
) -> Expression:
    """Torques tau, n x 1, by a Newton-Euler recursion: far fewer operations than all terms take.

    Args:
        chain: The robot.
        q: SX or MX, n x 1.
        qd: n x 1.
        qdd: n x 1.
        gravity: (3,) [m/s^2] in the base frame; the robot's own where none is given.

    Raises:
        MissingInertia: No link that a joint carries has an inertia.
        InvalidRobotState: q has not one entry for each joint.
        InvalidOption: Gravity is not three finite numbers.
    """
    packed, frames = bodies(chain, gravity), symbolic_frames(chain, q)
    spin = rate = last = casadi.DM.zeros(3, 1)
    a = -casadi.DM(packed.gravity)
    forces, arms = [], []
    for i in range(chain.n):
        z, o = frames[i][:3, 2], frames[i][:3, 3]
        a = a + _relative(rate, spin, o - last)
        if packed.types[i] == 0:
            rate = rate + qdd[i] * z + qd[i] * casadi.cross(spin, z)
            spin = spin + qd[i] * z
        else:
            a = a + qdd[i] * z + 2.0 * qd[i] * casadi.cross(spin, z)
        R, arm = frames[i][:3, :3], _center(packed, frames, i) - o
        f = packed.masses[i] * (a + _relative(rate, spin, arm))
        about = casadi.DM(packed.tensors[i])
        w, dw = casadi.mtimes(R.T, spin), casadi.mtimes(R.T, rate)
        euler = casadi.mtimes(about, dw) + casadi.cross(w, casadi.mtimes(about, w))
        forces.append((f, casadi.mtimes(R, euler) + casadi.cross(arm, f)))
        arms.append(o - last)
        last = o
    return _torques(packed, frames, forces, arms, qd, qdd)


@bounded_cache(maxsize=64)
def equations_function(chain: Chain) -> Expression:
    """CasADi function (q, q_dot, q_ddot) -> (D, C, G, T, U, tau) of a robot.

    Raises:
        MissingInertia: No link that a joint carries has an inertia.
    """
    q, qd, qdd = (casadi.SX.sym(name, chain.n) for name in ("q", "qd", "qdd"))
    terms = symbolic_equations(chain, q, qd, qdd)
    return casadi.Function(
        "equations", [q, qd, qdd], list(terms), ["q", "qd", "qdd"], ["D", "C", "G", "T", "U", "tau"]
    )


@bounded_cache(maxsize=64)
def inverse_function(chain: Chain) -> Expression:
    """CasADi function (q, q_dot, q_ddot) -> tau of a robot, by the recursion.

    Raises:
        MissingInertia: No link that a joint carries has an inertia.
    """
    q, qd, qdd = (casadi.SX.sym(name, chain.n) for name in ("q", "qd", "qdd"))
    torque = symbolic_inverse_dynamics(chain, q, qd, qdd)
    return casadi.Function("inverse", [q, qd, qdd], [torque], ["q", "qd", "qdd"], ["tau"])


def _center(packed: Bodies, frames: list[Expression], i: int) -> Expression:
    return casadi.mtimes(frames[i][:3, :3], casadi.DM(packed.centers[i])) + frames[i][:3, 3]


def _partial_jacobians(
    packed: Bodies, frames: list[Expression], i: int
) -> tuple[Expression, Expression]:
    """J_v and J_w of body i: column j is z_j x (r_i - o_j); z_j, or z_j; 0 if it slides."""
    r, zero = _center(packed, frames, i), casadi.DM.zeros(3, 1)
    Jv, Jw = [], []
    for j in range(len(frames)):
        z = frames[j][:3, 2]
        if j > i:
            Jv.append(zero)
            Jw.append(zero)
        elif packed.types[j] == 0:
            Jv.append(casadi.cross(z, r - frames[j][:3, 3]))
            Jw.append(z)
        else:
            Jv.append(z)
            Jw.append(zero)
    return casadi.horzcat(*Jv), casadi.horzcat(*Jw)


def _relative(rate: Expression, spin: Expression, arm: Expression) -> Expression:
    return casadi.cross(rate, arm) + casadi.cross(spin, casadi.cross(spin, arm))


def _torques(
    packed: Bodies,
    frames: list[Expression],
    forces: list[tuple[Expression, Expression]],
    arms: list[Expression],
    qd: Expression,
    qdd: Expression,
) -> Expression:
    force = moment = casadi.DM.zeros(3, 1)
    torque = []
    for i in range(len(frames) - 1, -1, -1):
        force, moment = force + forces[i][0], moment + forces[i][1]
        z = frames[i][:3, 2]
        along = casadi.dot(z, moment if packed.types[i] == 0 else force)
        along += packed.motor_inertia[i] * qdd[i] + packed.viscous_friction[i] * qd[i]
        if packed.rows[i, COULOMB] != 0.0:
            along += float(packed.rows[i, COULOMB]) * casadi.tanh(qd[i] / SMOOTH_SPEED)
        torque.append(along)
        moment = moment + casadi.cross(arms[i], force)
    return casadi.vertcat(*torque[::-1])
