"""Limit ratios of piecewise polynomials by numpy alone: eigenvalues of companion matrices."""

import numpy as np

from kinematics.arrays import Array
from kinematics.trajectory.trajectory import Trajectory

#: Looked at besides the stationary points, in case an eigenvalue is off.
_PLACES = np.linspace(0.0, 1.0, 33)


def worst_ratio(trajectory: Trajectory, limits: Array, order: int) -> float:
    """The largest |derivative| over its limit, at all stationary points and ends of pieces.

    It shares nothing with the kernels that the trajectory's own extrema come from.
    """
    c = trajectory.coefficients
    if c.shape[2] <= order:
        return 0.0
    h = np.diff(trajectory.breaks)[:, None, None]
    c = c * h ** np.arange(c.shape[2])
    for _ in range(order):
        c = c[:, :, 1:] * np.arange(1, c.shape[2]) / h
    c = c.reshape(-1, c.shape[2])
    limit = np.broadcast_to(limits, (trajectory.pieces, trajectory.n)).ravel()
    worst = float((np.maximum(np.abs(c[:, 0]), np.abs(c.sum(axis=1))) / limit).max())
    # Where not even the sum of all moduli exceeds what is known there is nothing to be found.
    left = np.abs(c).sum(axis=1) / limit > worst
    c, limit = c[left], limit[left]
    if not len(c):
        return worst
    places = np.tile(_PLACES, (len(c), 1))
    if c.shape[1] > 2:
        roots = _unit_roots(c[:, 1:] * np.arange(1, c.shape[1]))
        places = np.concatenate([places, roots], axis=1)
    values = np.zeros_like(places)
    for k in range(c.shape[1] - 1, -1, -1):
        values = values * places + c[:, k : k + 1]
    return max(worst, float((np.abs(values) / limit[:, None]).max()))


def _unit_roots(p: Array) -> Array:
    """Real parts of the roots of polynomials p (m, k), clipped to [0, 1].

    With u = 1 / mu - 1 the roots in [0, 1] have mu in [1/2, 1], and the polynomial in mu has the
    leading coefficient p(-1): vanishing high powers of u, as on straight pieces, do no harm.
    """
    q = p / np.maximum(np.abs(p).max(axis=1, keepdims=True), 1e-300)
    degree = q.shape[1] - 1
    for sweep in range(degree):
        for k in range(degree - 1, sweep - 1, -1):
            q[:, k] -= q[:, k + 1]
    usable = q[:, 0] != 0.0
    companion = np.zeros((len(q), degree, degree))
    companion[:, np.arange(1, degree), np.arange(degree - 1)] = 1.0
    companion[usable, 0, :] = -q[usable, 1:] / q[usable, :1]
    with np.errstate(all="ignore"):
        places = np.real(1.0 / np.linalg.eigvals(companion)) - 1.0
    return np.clip(np.nan_to_num(places), 0.0, 1.0)
