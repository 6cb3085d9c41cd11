"""The rate of the compiled laws' Lyapunov functions along the motion of the closed loop.

With M_dot = C + C^T the rates are closed forms in the acceleration: those of r^T M r / 2 and of
q_dot^T M q_dot / 2 are

    r^T (M r_dot + C r)    and    q_dot^T (M q_ddot + C q_dot).

Nothing is assumed of the controller's model, of saturation or of disturbances: where the
assumptions of a proof hold, the rate is the proof's.
"""

from compiled.kernel import kernel
from dynamics.kernels.recursion import reference_inverse_kernel
from kinematics.arrays import Array
from tracking.controllers.control_law import Kind, Law, Space, quadratic, set_errors


@kernel(allocates=False)
def lyapunov_rate_kernel(
    law: Law, space: Space, state: Array, reference: Array, estimate: Array, rate: Array
) -> float:
    """V_dot of the law, with the true robot's mass matrix and parameters.

    Args:
        law: The law.
        space: Scratch.
        state: q and q_dot, shape (2, n).
        reference: The reference and its two derivatives, shape (3, n).
        estimate: Theta_hat, shape (b,).
        rate: Time derivative of [q; q_dot; estimate], shape (2 n + b,).
    """
    n = state.shape[1]
    set_errors(law, space, state[0], state[1], reference)
    e, e_rate, r = space.vectors[0], space.vectors[1], space.vectors[2]
    bend, qdd = space.vectors[3], rate[n : 2 * n]
    for i in range(n):
        bend[i] = reference[2, i] - qdd[i]
    V_dot = 0.0
    if law.kind == Kind.INDEPENDENT_JOINT:
        for i in range(n):
            V_dot += law.inertia[i] * e_rate[i] * bend[i]
        return V_dot + quadratic(law.Kp, e, e_rate)
    if law.kind == Kind.COMPUTED_TORQUE:
        for i in range(n):
            kp, kd = law.Kp[i, i], law.Kd[i, i]
            V_dot += e_rate[i] * bend[i] + (kp + 0.5 * kd**2) * e[i] * e_rate[i]
            V_dot += 0.5 * kd * (e_rate[i] ** 2 + e[i] * bend[i])
        return V_dot
    if law.kind == Kind.PD_GRAVITY:
        V_dot = kinetic_rate(law, space, state, state[1], qdd)
        return V_dot + quadratic(law.Kp, e, e_rate)
    for i in range(n):
        bend[i] += law.Lambda[i] * e_rate[i]
    V_dot = kinetic_rate(law, space, state, r, bend)
    for i in range(n):
        bend[i] = law.Lambda[i] * e[i]
    V_dot += 2.0 * quadratic(law.Kd, bend, e_rate)
    if law.kind == Kind.ADAPTIVE:
        for j in range(estimate.shape[0]):
            for k in range(estimate.shape[0]):
                V_dot += law.Gamma_inverse[j, k] * (estimate[j] - law.truth[j]) * rate[2 * n + k]
    return V_dot


@kernel(allocates=False)
def kinetic_rate(law: Law, space: Space, state: Array, r: Array, r_rate: Array) -> float:
    """The rate r^T (M r_dot + C r) of r^T M r / 2, for the true robot; r and r_rate are (n,)."""
    n = state.shape[1]
    whole, rest = space.vectors[4], space.vectors[5]
    for i in range(n):
        space.motion[i, 0], space.motion[i, 1] = state[0, i], state[1, i]
        space.motion[i, 2], space.motion[i, 3] = 0.0, 0.0
    reference_inverse_kernel(law.robot, space.motion, space.work, rest)
    for i in range(n):
        space.motion[i, 2], space.motion[i, 3] = r[i], r_rate[i]
    reference_inverse_kernel(law.robot, space.motion, space.work, whole)
    total = 0.0
    for i in range(n):
        # Gravity and friction, which do not depend on r, drop out.
        total += r[i] * (whole[i] - rest[i])
    return total
