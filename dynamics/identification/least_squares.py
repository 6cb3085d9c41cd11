"""Weighted least squares of torques, with the noise of each joint found on the way."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from kinematics.arrays import Array
from kinematics.errors import InvalidOption

#: Weights are found anew from residuals so often.
_ROUNDS = 3
#: Instants for each joint from which correlations between joints are counted too.
_CORRELATED = 20
#: Rows of a part of a QR decomposition.
_PART = 1024
#: Noise is counted as at least this part of the torques: exact data have none.
_LEAST_NOISE = 1e-9


class Weighted(NamedTuple):
    """Equations whose noise has unit variance, as the triangle of a QR decomposition.

    Args:
        R: Shape (p, p).
        z: Shape (p,), with R x = z in the sense of least squares.
        noise: Covariance of the torques' noise, shape (n, n).
        inflation: Factor of variances, at least 1, of noise that is alike from instant to instant.
    """

    R: Array
    z: Array
    noise: Array
    inflation: float


class Solution(NamedTuple):
    """Least-squares values of combinations.

    Args:
        values: Shape (b,).
        covariance: Shape (b, b).
        condition: Condition number of the equations, their columns scaled to length 1.
    """

    values: Array
    covariance: Array
    condition: float


def weigh(Y: Sequence[Array], tau: Sequence[Array]) -> Weighted:
    """Equations Y x = tau of some logs, weighted by the noise that their residuals show.

    Args:
        Y: Regressor of each log, shape (m, n, p), of independent columns.
        tau: Torques of each log, shape (m, n) [N m or N].

    Raises:
        InvalidOption: There are not more equations than unknowns.
    """
    m, n, p = sum(len(rows) for rows in tau), tau[0].shape[1], Y[0].shape[2]
    if m * n <= p:
        raise InvalidOption(
            f"{m} instants of {n} joints are {m * n} equations for {p} parameters",
            hint="Give longer logs, or ask for fewer parameters.",
        )
    least = _LEAST_NOISE * max(float(np.abs(rows).max(initial=1e-6)) for rows in tau)
    noise = np.eye(n)
    for _ in range(_ROUNDS):
        R, z = _triangle(Y, tau, noise)
        lengths = np.linalg.norm(R, axis=0)
        scale = np.where(lengths > 0.0, lengths, 1.0)
        x = np.linalg.lstsq(R / scale, z, rcond=1e-10)[0] / scale
        rest = [t - y @ x for y, t in zip(Y, tau, strict=True)]
        noise = _noise(np.concatenate(rest), p, least)
    return Weighted(*_triangle(Y, tau, noise), noise, _inflation(rest))


def _triangle(Y: Sequence[Array], tau: Sequence[Array], noise: Array) -> tuple[Array, Array]:
    """The triangle of all equations, log by log: one log's are as large as may be copied."""
    p = Y[0].shape[2]
    root, triangle = np.linalg.inv(np.linalg.cholesky(noise)), np.zeros((0, p + 1))
    for y, t in zip(Y, tau, strict=True):
        white = (root @ np.concatenate([y, t[..., None]], axis=-1)).reshape(-1, p + 1)
        triangle = _reduced(np.concatenate([triangle, white]))
    return triangle[:p, :p], triangle[:p, p]


def _reduced(rows: Array) -> Array:
    """The triangle of a QR decomposition, part by part: parts stay in the processor's caches."""
    whole = len(rows) // _PART * _PART
    parts = rows[:whole].reshape(-1, _PART, rows.shape[1])
    triangles = np.asarray(np.linalg.qr(parts, mode="r")).reshape(-1, rows.shape[1])
    return np.asarray(np.linalg.qr(np.concatenate([triangles, rows[whole:]]), mode="r"))


def _noise(rest: Array, p: int, least: float) -> Array:
    m, n = rest.shape
    degrees = max(m - p / n, 1.0)
    if m >= _CORRELATED * n:
        covariance = rest.T @ rest / degrees
    elif m > 2 * p / n:
        covariance = np.diag((rest**2).sum(axis=0) / degrees)
    else:
        covariance = np.eye(n) * (rest**2).sum() / (n * m - p)
    return np.asarray(covariance + least**2 * np.eye(n))


def _inflation(rests: Sequence[Array]) -> float:
    """How many times fewer independent residuals there are than residuals, from their lag 1."""
    longest = [rest for rest in rests if len(rest) >= _CORRELATED]
    if not longest:
        return 1.0
    square = sum((rest**2).sum(axis=0) for rest in longest)
    product = sum((rest[1:] * rest[:-1]).sum(axis=0) for rest in longest)
    alike = np.clip(product / np.maximum(square, 1e-300), 0.0, 0.99).mean()
    return float((1.0 + alike) / (1.0 - alike))


def solve(weighted: Weighted, columns: Sequence[int]) -> Solution:
    """Least-squares values of some columns, the others counted with them."""
    R = weighted.R[:, list(columns)]
    lengths = np.linalg.norm(R, axis=0)
    U, singular, Vt = np.linalg.svd(R / lengths, full_matrices=False)
    inverse = (Vt.T / singular) / lengths[:, None]
    values = inverse @ (U.T @ weighted.z)
    covariance = weighted.inflation * inverse @ inverse.T
    return Solution(values, covariance, float(singular[0] / singular[-1]))
