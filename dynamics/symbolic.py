"""The equations of motion as CasADi expressions: the twin that an optimiser differentiates.

A Newton-Euler recursion like that of the kernels; a test holds the two equal.
"""

import casadi
from numpy.typing import ArrayLike

from dynamics.model.body import COULOMB, SMOOTH_SPEED, Bodies, bodies
from kinematics.model.chain import Chain
from kinematics.symbolic import Expression, symbolic_frames


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
        R = frames[i][:3, :3]
        arm = casadi.mtimes(R, casadi.DM(packed.centers[i]))
        f = packed.masses[i] * (a + _relative(rate, spin, arm))
        about = casadi.DM(packed.tensors[i])
        w, dw = casadi.mtimes(R.T, spin), casadi.mtimes(R.T, rate)
        euler = casadi.mtimes(about, dw) + casadi.cross(w, casadi.mtimes(about, w))
        forces.append((f, casadi.mtimes(R, euler) + casadi.cross(arm, f)))
        arms.append(o - last)
        last = o
    return _torques(packed, frames, forces, arms, qd, qdd)


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
