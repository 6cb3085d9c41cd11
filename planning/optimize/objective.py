"""Objective of an optimisation: its value and its convex quadratic model.

    time          T
    jerk          integral of |q'''|^2 dt = T^-5 integral of |d3q/du3|^2 du
    energy        integral of |tau|^2 dt
    path_length   integral of |dq/du| du
    soft        integral of sum_i w_i max(r_i, 0)^2 / 2 dt, r the residuals of soft constraints

Sums of squares are modelled with the products of first derivatives as Hessian (Gauss-Newton). The
length, which is no sum of squares, lies below sum_k w_k (|x_k|^2 / |x_k'| + |x_k'|) / 2 with
x = dq/du, which touches it at the current x'.
"""

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse

from dynamics.inverse import inverse_dynamics
from kinematics.arrays import Array
from kinematics.model.chain import Chain
from kinematics.trajectory.trajectory import Trajectory
from planning.constraints.constraint_set import ConstraintSet
from planning.optimize.iterate import Iterate
from planning.optimize.linearization import local_matrix, torques
from planning.optimize.task import Task
from planning.values.limits import JERK_JUMP
from planning.values.optimize_options import Objective

#: Its stubs know no stacks of sparse and dense matrices.
sparse: Any = scipy.sparse

#: Places in each piece at which integrals without a closed form are summed up.
_NODES = 4


class Model(NamedTuple):
    """1/2 z' H z + g' z in the unknowns z = (control points, T, s)."""

    H: Any
    g: Array


def value(
    trajectory: Trajectory,
    weights: Mapping[Objective, float],
    loaded_chain: Chain,
    soft: ConstraintSet | None = None,
) -> float:
    """The objective of a motion, infinite where its jerk counts and is not bounded.

    Args:
        trajectory: The motion.
        weights: Weights by objective.
        loaded_chain: The robot with what it carries.
        soft: Soft constraints.
    """
    total = sum(w * _VALUES[name](trajectory, loaded_chain) for name, w in weights.items())
    return total if soft is None else total + _soft_value(trajectory, soft)


def model(task: Task, weights: Mapping[Objective, float], iterate: Iterate) -> Model:
    """The quadratic model of the objective at an iterate."""
    size = iterate.points.size + 2
    H, g = _smoothness_weights(task, weights, iterate), np.zeros(size)
    for name, w in weights.items():
        own = _MODELS[name](task, iterate)
        H, g = H + w * own.H, g + w * own.g
    if task.soft is not None:
        own = _soft_model(task.soft, iterate)
        H, g = H + own.H, g + own.g
    return Model(H, g)


def _smoothness_weights(task: Task, weights: Mapping[Objective, float], iterate: Iterate) -> Any:
    N, n = iterate.points.shape
    shares = sparse.diags(1.0 / task.bounds["acceleration"] ** 2)
    gram = sparse.csr_matrix(iterate.space.gram[2] * iterate.duration**-3)
    # Weight of the squared shares of the acceleration limits, so that of many fastest motions a
    # smooth one is chosen: it may cost as much of the time.
    weight = 2.0 * 3e-4 * weights.get("time", 0.0)
    # Nearest to the last iterate of all that are equally good.
    near = sparse.identity(N * n + 2) * 1e-7
    return near + sparse.block_diag([weight * sparse.kron(gram, shares), np.zeros((2, 2))])


# ------------------------------------------------------------------------------------- time


def _time_value(trajectory: Trajectory, _loaded_chain: Chain) -> float:
    return trajectory.duration


def _time_model(_task: Task, iterate: Iterate) -> Model:
    size = iterate.points.size + 2
    g = np.zeros(size)
    g[-2] = 1.0
    return Model(sparse.csr_matrix((size, size)), g)


# ------------------------------------------------------------------------------------- jerk


def _jerk_value(trajectory: Trajectory, _loaded_chain: Chain) -> float:
    if trajectory.continuity().acceleration > JERK_JUMP:
        return np.inf
    times, weights = _gauss(trajectory.breaks, max(trajectory.degree, 1))
    return float(weights @ np.square(trajectory.sample(times, 3)).sum(axis=1))


def _jerk_model(_task: Task, iterate: Iterate) -> Model:
    P, T = iterate.points, iterate.duration
    G, n = iterate.space.gram[3], P.shape[1]
    pulled = G @ P
    total = float((P * pulled).sum())
    column = -5.0 * T**-6 * pulled.ravel()
    H = sparse.bmat(
        [
            [2.0 * T**-5 * sparse.kron(sparse.csr_matrix(G), sparse.identity(n)), column[:, None]],
            [column[None, :], np.array([[12.5 * total * T**-7]])],
        ]
    )
    H = sparse.block_diag([H, np.zeros((1, 1))], format="csr")
    gradient = np.append(2.0 * T**-5 * pulled.ravel(), [-5.0 * total * T**-6, 0.0])
    return _about(H, gradient, iterate)


# ----------------------------------------------------------------------------------- energy


def _energy_value(trajectory: Trajectory, loaded_chain: Chain) -> float:
    times, weights = _gauss(trajectory.breaks, _NODES)
    states = (trajectory.sample(times, order) for order in range(3))
    return float(weights @ np.square(inverse_dynamics(loaded_chain, *states)).sum(axis=1))


def _energy_model(task: Task, iterate: Iterate) -> Model:
    T, n = iterate.duration, iterate.points.shape[1]
    assert task.loaded_chain is not None
    places, weights = _gauss(np.asarray(iterate.space.breaks), _NODES)
    found = torques(task.loaded_chain, iterate, places)
    # Residuals sqrt(T w) tau, one row a joint and place.
    root = np.repeat(np.sqrt(T * weights), n)
    rows = [root[:, None] * gradient.reshape(-1, n) for gradient in found.gradients]
    tau = found.values.ravel()
    in_time = root * (found.in_time.ravel() + 0.5 * tau / T)
    A = local_matrix(iterate, np.repeat(places, n), rows, in_time)
    return _about(2.0 * (A.T @ A), 2.0 * (A.T @ (root * tau)), iterate)


# ------------------------------------------------------------------------------ path length


def _length_value(trajectory: Trajectory, _loaded_chain: Chain) -> float:
    times, weights = _gauss(trajectory.breaks, 2 * _NODES)
    return float(weights @ np.linalg.norm(trajectory.sample(times, 1), axis=1))


def _length_model(_task: Task, iterate: Iterate) -> Model:
    places, weights = _gauss(np.asarray(iterate.space.breaks), _NODES)
    B, n = iterate.space.matrix(places, 1), iterate.points.shape[1]
    # A speed [rad] below which a motion counts as standing still in its path's length.
    speeds = np.maximum(np.linalg.norm(B @ iterate.points, axis=1), 1e-3)
    G = B.T @ ((weights / speeds)[:, None] * B)
    # The quadratic is of P itself: its gradient at 0 vanishes.
    H = sparse.kron(sparse.csr_matrix(G), sparse.identity(n))
    H = sparse.block_diag([H, np.zeros((2, 2))], format="csr")
    return Model(H, np.zeros(iterate.points.size + 2))


# ----------------------------------------------------------------------------------- soft


def _soft_value(trajectory: Trajectory, soft: ConstraintSet) -> float:
    times, weights = _gauss(trajectory.breaks, _NODES)
    violated = np.maximum(soft.residuals(trajectory.sample(times)), 0.0)
    return 0.5 * float(weights @ (violated**2 @ soft.weights))


def _soft_model(soft: ConstraintSet, iterate: Iterate) -> Model:
    T = iterate.duration
    places, weights = _gauss(np.asarray(iterate.space.breaks), _NODES)
    residuals, J = soft.evaluate(iterate.sample(places))
    k, i = np.nonzero(residuals > 0.0)
    # Residuals sqrt(T w w_i) r_i, those that are violated.
    root = np.sqrt(T * weights[k] * soft.weights[i])
    r = root * residuals[k, i]
    A = local_matrix(iterate, places[k], [root[:, None] * J[k, i]], 0.5 * r / T)
    return _about(A.T @ A, A.T @ r, iterate)


# ---------------------------------------------------------------------------------- integrals


def _about(H: Any, gradient: Array, iterate: Iterate) -> Model:
    """A model whose gradient is known at the iterate, as one whose gradient is known at 0."""
    z = np.append(iterate.points.ravel(), [iterate.duration, 0.0])
    return Model(H, gradient - H @ z)


def _gauss(breaks: Array, count: int) -> tuple[Array, Array]:
    """Places and weights of a Gauss-Legendre rule with ``count`` places in each piece."""
    nodes, weights = np.polynomial.legendre.leggauss(count)
    half = 0.5 * np.diff(breaks)[:, None]
    places = breaks[:-1, None] + half * (nodes + 1.0)
    return places.ravel(), (half * weights).ravel()


_VALUES: Mapping[Objective, Callable[[Trajectory, Chain], float]] = MappingProxyType(
    {
        "time": _time_value,
        "jerk": _jerk_value,
        "energy": _energy_value,
        "path_length": _length_value,
    }
)
_MODELS: Mapping[Objective, Callable[[Task, Iterate], Model]] = MappingProxyType(
    {
        "time": _time_model,
        "jerk": _jerk_model,
        "energy": _energy_model,
        "path_length": _length_model,
    }
)
