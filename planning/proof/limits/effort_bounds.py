"""Bounds of joint torques and of the tip's velocity over intervals of time.

The Newton-Euler recursion (dynamics.inverse has its equations) on jets: values and slopes in the
middle of the interval, and bounds of second derivatives all over it. Written apart from
``dynamics.enclosure``, by which planners slow motions down.
"""

import numpy as np

from compiled.kernel import kernel
from dynamics.model.body import Bodies
from kinematics.arrays import Array
from planning.proof.limits.jet import (
    Jet,
    JetVector,
    add,
    constant_vector,
    cross,
    cross_constant,
    multiply,
    plus,
    scale,
    sine_cosine,
    weighted_sum,
)
from planning.proof.motion_bounds import (
    ACCELERATION,
    JOINT_COLUMNS,
    RATE,
    ROUNDING,
    VALUE,
    enclose,
)

#: Numbers of a jet: value, slope, bound of the second derivative, rounding.
JET = 4

# Columns of an interval.
#: The trajectory's piece.
PIECE = 0
#: Its middle in the piece's own time [s].
MIDDLE = 1
#: Half its length [s].
HALF = 2


@kernel
def effort_bounds_kernel(
    bodies: Bodies,
    tip: Array,
    derivatives: Array,
    intervals: Array,
    torques: Array,
    velocities: Array,
) -> None:
    """Write jets of the torques and of the tip's velocity, in the last joint's axes.

    Args:
        bodies: The robot.
        tip: The tip's place in the last joint's frame, shape (3,) [m].
        derivatives: Coefficients of position, velocity and acceleration, shape (3, m, n, k).
        intervals: Columns PIECE to HALF, shape (c, 3).
        torques: Filled, shape (c, n, JET) [N m or N].
        velocities: Filled, shape (c, 3, JET) [m/s].
    """
    n, k = derivatives.shape[2], derivatives.shape[3]
    joints, shift = np.empty((n, JOINT_COLUMNS)), np.empty((2, k))
    motions, wrenches = np.empty((3, n, JET)), np.empty((2, n, 3, JET))
    for c in range(intervals.shape[0]):
        piece, middle, half = int(intervals[c, PIECE]), intervals[c, MIDDLE], intervals[c, HALF]
        for order in range(3):
            enclose(derivatives[order, piece], middle, half, shift, joints)
            for j in range(n):
                motions[order, j, 0], motions[order, j, 1] = joints[j, VALUE], joints[j, RATE]
                motions[order, j, 2] = joints[j, ACCELERATION]
                motions[order, j, 3] = joints[j, ROUNDING]
        velocity = _outward(bodies, motions, half, wrenches)
        w, v = velocity
        _store(velocities[c], plus(v, cross_constant(w, tip[0], tip[1], tip[2])))
        _inward(bodies, motions, half, wrenches, torques[c])


@kernel
def _outward(
    bodies: Bodies, motions: Array, h: float, wrenches: Array
) -> tuple[JetVector, JetVector]:
    """Write force and moment (2, n, 3, JET) that each body takes; last angular and linear velocity.

    Body by body from the base, all in the axes of the body's own joint.
    """
    zero = constant_vector(0.0, 0.0, 0.0)
    w, dw, v = zero, zero, zero
    g = bodies.gravity
    a = constant_vector(-g[0], -g[1], -g[2])
    for i in range(motions.shape[1]):
        A = bodies.offsets[i]
        q, rate, rise = _load(motions[0, i]), _load(motions[1, i]), _load(motions[2, i])
        revolute = bodies.types[i] == 0
        s, c, arm = _joint(A, q, revolute, h)
        swing = cross(w, arm, h)
        a = plus(a, plus(cross(dw, arm, h), cross(w, swing, h)))
        v = _to_joint(A, s, c, plus(v, swing), h)
        a, w, dw = (
            _to_joint(A, s, c, a, h),
            _to_joint(A, s, c, w, h),
            _to_joint(A, s, c, dw, h),
        )
        if revolute:
            # The rate of w seen from the body: w x z rate = (w_y, -w_x, 0) rate.
            dw = plus(dw, (multiply(w[1], rate, h), scale(-1.0, multiply(w[0], rate, h)), rise))
            w = (w[0], w[1], add(w[2], rate))
        else:
            coriolis = (
                scale(2.0, multiply(w[1], rate, h)),
                scale(-2.0, multiply(w[0], rate, h)),
                rise,
            )
            a = plus(a, coriolis)
            v = (v[0], v[1], add(v[2], rate))
        b, m, tensor = bodies.centers[i], bodies.masses[i], bodies.tensors[i]
        turn = cross(w, cross_constant(w, b[0], b[1], b[2]), h)
        center = plus(a, plus(cross_constant(dw, b[0], b[1], b[2]), turn))
        force = (scale(m, center[0]), scale(m, center[1]), scale(m, center[2]))
        spin = cross(w, _tensor(tensor, w), h)
        moment = plus(plus(_tensor(tensor, dw), spin), cross_constant(force, -b[0], -b[1], -b[2]))
        _store(wrenches[0, i], force)
        _store(wrenches[1, i], moment)
    return w, v


@kernel(allocates=False)
def _inward(bodies: Bodies, motions: Array, h: float, wrenches: Array, torques: Array) -> None:
    """Sum the bodies' forces and moments from the tip into torques (n, JET)."""
    force, moment = constant_vector(0.0, 0.0, 0.0), constant_vector(0.0, 0.0, 0.0)
    for i in range(motions.shape[1] - 1, -1, -1):
        force, moment = plus(force, _vector(wrenches[0, i])), plus(moment, _vector(wrenches[1, i]))
        q, rate, rise = _load(motions[0, i]), _load(motions[1, i]), _load(motions[2, i])
        revolute = bodies.types[i] == 0
        torque = moment[2] if revolute else force[2]
        torque = add(torque, scale(bodies.motor_inertia[i], rise))
        torque = add(torque, scale(bodies.viscous_friction[i], rate))
        torques[i, 0], torques[i, 1], torques[i, 2], torques[i, 3] = torque
        s, c, arm = _joint(bodies.offsets[i], q, revolute, h)
        force, moment = (
            _out_of(bodies.offsets[i], s, c, force, h),
            _out_of(bodies.offsets[i], s, c, moment, h),
        )
        moment = plus(moment, cross(arm, force, h))


@kernel
def _joint(A: Array, q: Jet, revolute: bool, h: float) -> tuple[Jet, Jet, JetVector]:
    """Sine and cosine of a joint's turn, and its frame's origin in the frame before it."""
    arm = constant_vector(A[0, 3], A[1, 3], A[2, 3])
    if revolute:
        s, c = sine_cosine(q, h)
        return s, c, arm
    slide = (scale(A[0, 2], q), scale(A[1, 2], q), scale(A[2, 2], q))
    return (0.0, 0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0), plus(arm, slide)


@kernel(allocates=False)
def _to_joint(A: Array, s: Jet, c: Jet, v: JetVector, h: float) -> JetVector:
    """A vector of the frame before a joint in the joint's own: Rz(q)^T R_A^T v."""
    x = weighted_sum(A[0, 0], A[1, 0], A[2, 0], v)
    y = weighted_sum(A[0, 1], A[1, 1], A[2, 1], v)
    z = weighted_sum(A[0, 2], A[1, 2], A[2, 2], v)
    return (
        add(multiply(c, x, h), multiply(s, y, h)),
        add(multiply(c, y, h), scale(-1.0, multiply(s, x, h))),
        z,
    )


@kernel(allocates=False)
def _out_of(A: Array, s: Jet, c: Jet, v: JetVector, h: float) -> JetVector:
    """A vector of a joint's frame in the frame before it: R_A Rz(q) v."""
    x = add(multiply(c, v[0], h), scale(-1.0, multiply(s, v[1], h)))
    y = add(multiply(s, v[0], h), multiply(c, v[1], h))
    turned = (x, y, v[2])
    return (
        weighted_sum(A[0, 0], A[0, 1], A[0, 2], turned),
        weighted_sum(A[1, 0], A[1, 1], A[1, 2], turned),
        weighted_sum(A[2, 0], A[2, 1], A[2, 2], turned),
    )


@kernel
def _tensor(tensor: Array, w: JetVector) -> JetVector:
    """The product of a tensor (3, 3) and a vector."""
    return (
        weighted_sum(tensor[0, 0], tensor[0, 1], tensor[0, 2], w),
        weighted_sum(tensor[1, 0], tensor[1, 1], tensor[1, 2], w),
        weighted_sum(tensor[2, 0], tensor[2, 1], tensor[2, 2], w),
    )


@kernel
def _load(values: Array) -> Jet:
    return values[0], values[1], values[2], values[3]


@kernel
def _vector(values: Array) -> JetVector:
    return _load(values[0]), _load(values[1]), _load(values[2])


@kernel
def _store(out: Array, v: JetVector) -> None:
    for k in range(JET):
        out[0, k], out[1, k], out[2, k] = v[0][k], v[1][k], v[2][k]
