"""Torques and the tool's speed along a motion, and how they change with it.

CasADi writes down the Newton-Euler recursion and differentiates it once for each robot; the
function is kept and called through buffers.
"""

from dataclasses import dataclass
from typing import Any

import casadi
import numpy as np

from dynamics.symbolic import symbolic_inverse_dynamics
from kinematics.arrays import Array
from kinematics.caches.bounded_cache import bounded_cache
from kinematics.model.chain import Chain
from kinematics.symbolic import symbolic_jacobian
from planning.optimize.iterate import Iterate


@dataclass(frozen=True, slots=True, eq=False)
class Response:
    """Values at places along a motion, and their derivatives (m values, K places, n joints).

    Args:
        values: Shape (K, m).
        gradients: Gradients with respect to q, dq/du, d2q/du2, shape (K, m, n) each.
        in_time: Derivatives with respect to the duration, shape (K, m).
    """

    values: Array
    gradients: tuple[Array, Array, Array]
    in_time: Array


def torques(chain: Chain, iterate: Iterate, places: Array) -> Response:
    """Joint torques [N m or N], m = n.

    Raises:
        MissingInertia: No link that a joint carries has an inertia.
    """
    return _response(_torque_function(chain), chain.n, iterate, places)


def tool_speed(chain: Chain, iterate: Iterate, places: Array) -> Response:
    """The speed of the tip's origin [m/s], m = 1."""
    return _response(_speed_function(chain), 1, iterate, places)


def _response(function: Any, m: int, iterate: Iterate, places: Array) -> Response:
    q, q1, q2 = (iterate.sample(places, order) for order in range(3))
    T, (K, n) = iterate.duration, q.shape
    states = np.concatenate([q, q1 / T, q2 / T**2], axis=1)
    state, value, slope = np.empty(3 * n), np.empty(m), np.empty((3 * n, m))
    buffer, run = function.buffer()
    buffer.set_arg(0, state.data)
    buffer.set_res(0, value.data)
    buffer.set_res(1, slope.reshape(-1).data)
    values, slopes = np.empty((K, m)), np.empty((K, 3 * n, m))
    for k in range(K):
        state[:] = states[k]
        run()
        values[k], slopes[k] = value, slope
    J = slopes.transpose(0, 2, 1)
    by_velocity, by_acceleration = J[:, :, n : 2 * n], J[:, :, 2 * n :]
    in_time = -np.einsum("kmn,kn->km", by_velocity, q1) / T**2
    in_time -= 2.0 * np.einsum("kmn,kn->km", by_acceleration, q2) / T**3
    return Response(values, (J[:, :, :n], by_velocity / T, by_acceleration / T**2), in_time)


@bounded_cache(maxsize=16)
def _torque_function(chain: Chain) -> Any:
    z = casadi.SX.sym("z", 3 * chain.n)
    q, qd, qdd = casadi.vertsplit(z, chain.n)
    return _function(z, symbolic_inverse_dynamics(chain, q, qd, qdd))


@bounded_cache(maxsize=16)
def _speed_function(chain: Chain) -> Any:
    z = casadi.SX.sym("z", 3 * chain.n)
    q, qd, _ = casadi.vertsplit(z, chain.n)
    v = casadi.mtimes(symbolic_jacobian(chain, q)[:3, :], qd)
    # Keeps the tool's speed differentiable where it stands still [m^2/s^2].
    return _function(z, casadi.sqrt(casadi.dot(v, v) + 1e-9))


def _function(z: Any, value: Any) -> Any:
    slope = casadi.densify(casadi.jacobian(value, z))
    return casadi.Function("response", [z], [casadi.densify(value), slope])
