"""The parameters nearest to measurements that some rigid bodies have.

Ten parameters are those of a body with positive density where the pseudo-inertia, the matrix of its
second, first and zeroth moments (4, 4), is positive definite. Among them those are sought that fit
best, and of those that fit alike the ones nearest to the bodies believed in, by the entropic
divergence of pseudo-inertias ("Geometric robot dynamic identification: a convex programming
approach").
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinematics.arrays import Array
from kinematics.model.chain import Inertia

#: Parameters of a body: m, m c and the inertia about the frame's origin.
PARAMETERS = 10
#: Rows and columns of the pseudo-inertia that xx, xy, yy, xz, yz, zz stand in.
_PLACES = ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2))
#: Weight of the divergence in units of the squared noise: a twofold change of a body that nothing
#: else decides weighs as much as a tenth of a standard error.
_WEIGHT = 1e-2
#: Factor from one weight to the next on the way to it; at first the bodies believed in count as
#: much as all measurements.
_FALL = 0.1
_MOST_STEPS = 60
#: Newton's decrement at which a weight is done with.
_DONE = 1e-9
#: Added to the scaled Hessian, whose diagonal is 1: bodies next to none make it singular.
_SINGULAR = 1e-12
#: Share of the largest second moment that the others of a body believed in have at least.
_FLATTEST = 1e-3


def _basis() -> Array:
    """Pseudo-inertias of the ten parameters, shape (10, 4, 4)."""
    basis = np.zeros((PARAMETERS, 4, 4))
    basis[0, 3, 3] = 1.0
    for i in range(3):
        basis[1 + i, i, 3] = basis[1 + i, 3, i] = 1.0
    for k, (i, j) in enumerate(_PLACES):
        if i == j:
            basis[4 + k, :3, :3] = 0.5 * np.eye(3)
        basis[4 + k, i, j] -= 1.0
        basis[4 + k, j, i] = basis[4 + k, i, j]
    return basis


BASIS = _basis()


def pseudo_inertia(parameters: Array) -> Array:
    """The pseudo-inertias (..., 4, 4) of ten parameters each (..., 10)."""
    return np.asarray(np.einsum("...k,kij->...ij", parameters, BASIS))


def moments(P: Array) -> Array:
    """The ten parameters (..., 10) of pseudo-inertias (..., 4, 4)."""
    second = P[..., :3, :3]
    trace = np.trace(second, axis1=-2, axis2=-1)
    about = trace[..., None, None] * np.eye(3) - second
    six = [about[..., i, j] for i, j in _PLACES]
    return np.stack([P[..., 3, 3], *(P[..., i, 3] for i in range(3)), *six], axis=-1)


def body_of(parameters: Array) -> Inertia:
    """The body that ten parameters (10,) are of, in their frame."""
    P = pseudo_inertia(parameters)
    mass = float(P[3, 3])
    center = P[:3, 3] / mass
    second = P[:3, :3] - mass * np.outer(center, center)
    return Inertia(mass, center, np.trace(second) * np.eye(3) - second)


def believed_body(parameters: Array, mass: float, length: float) -> Array:
    """Parameters near those given (10,) of a body with positive density, shape (10,).

    Args:
        parameters: Parameters of the description; zeros where it has none.
        mass: Mass of a body of which nothing is known [kg].
        length: Its size, and the least one of others relative to it [m].
    """
    P = pseudo_inertia(parameters)
    if P[3, 3] < _FLATTEST * mass:
        return moments(np.diag([0.1 * mass * length**2] * 3 + [mass]))
    center = P[:3, 3] / P[3, 3]
    values, axes = np.linalg.eigh(P[:3, :3] - P[3, 3] * np.outer(center, center))
    least = max(_FLATTEST * values[-1], P[3, 3] * (0.02 * length) ** 2)
    second = (axes * np.maximum(values, least)) @ axes.T
    P[:3, :3] = second + P[3, 3] * np.outer(center, center)
    return moments(P)


class Measured(NamedTuple):
    """Measurements R x = z with unit noise, and what is believed.

    Args:
        R: Shape (r, p).
        z: Shape (r,).
        believed: Parameters believed in, shape (p,): ten for each body, then others.
        bodies: Number of bodies.
        positive: Which of the others are positive, shape (p - 10 bodies,).
    """

    R: Array
    z: Array
    believed: Array
    bodies: int
    positive: NDArray[np.bool_]


def fit_bodies(measured: Measured) -> Array:
    """Parameters (p,) of bodies with positive densities that fit measurements best."""
    x = measured.believed.copy()
    weight = float(np.sum((measured.R @ x - measured.z) ** 2)) + _WEIGHT
    while weight > _WEIGHT:
        weight = max(_FALL * weight, _WEIGHT)
        for _ in range(_MOST_STEPS):
            cost, gradient, hessian = _model(measured, x, weight)
            scale = 1.0 / np.sqrt(np.diag(hessian))
            scaled = hessian * np.outer(scale, scale) + _SINGULAR * np.eye(len(x))
            step = -scale * np.linalg.solve(scaled, scale * gradient)
            decrement = -float(gradient @ step)
            length = 1.0
            while _cost(measured, x + length * step, weight) > cost - 0.1 * length * decrement:
                length *= 0.5
                if length < 1e-10:
                    break
            if length >= 1e-10:
                x = x + length * step
            if decrement < _DONE or length < 1e-10:
                break
    return x


def _parts(measured: Measured, x: Array) -> tuple[Array, Array, Array]:
    """Pseudo-inertias, the others that are positive, and those that need not be."""
    split = PARAMETERS * measured.bodies
    others = x[split:]
    P = pseudo_inertia(x[:split].reshape(-1, PARAMETERS))
    return P, others[measured.positive], others[~measured.positive]


def _cost(measured: Measured, x: Array, weight: float) -> float:
    P, positive, free = _parts(measured, x)
    if (positive <= 0.0).any() or (np.linalg.eigvalsh(P)[:, 0] <= 1e-15 * P[:, 3, 3]).any():
        return np.inf
    P0, positive0, free0 = _parts(measured, measured.believed)
    near = np.einsum("bij,bji->", np.linalg.inv(P0), P) - np.linalg.slogdet(P)[1].sum()
    near += np.sum(positive / positive0 - np.log(positive)) + 0.5 * np.sum((free / free0) ** 2)
    rest = measured.R @ x - measured.z
    return float(0.5 * rest @ rest + weight * near)


def _model(measured: Measured, x: Array, weight: float) -> tuple[float, Array, Array]:
    """Cost, gradient and Hessian at x."""
    P, positive, free = _parts(measured, x)
    P0, positive0, free0 = _parts(measured, measured.believed)
    gradient = measured.R.T @ (measured.R @ x - measured.z)
    hessian = measured.R.T @ measured.R
    # Of P = L L^T the second derivatives are products of L^-1 E_k L^-T: no rounding makes them
    # indefinite.
    roots = np.linalg.inv(np.linalg.cholesky(P))
    turned = np.einsum("bij,kjl,bml->bkim", roots, BASIS, roots)
    slope = np.einsum("bij,kji->bk", np.linalg.inv(P0), BASIS) - np.einsum("bkii->bk", turned)
    curve = np.einsum("bkil,bmil->bkm", turned, turned)
    for i in range(measured.bodies):
        own = slice(PARAMETERS * i, PARAMETERS * (i + 1))
        gradient[own] += weight * slope[i]
        hessian[own, own] += weight * curve[i]
    split = PARAMETERS * measured.bodies
    at = split + np.flatnonzero(measured.positive)
    gradient[at] += weight * (1.0 / positive0 - 1.0 / positive)
    hessian[at, at] += weight / positive**2
    at = split + np.flatnonzero(~measured.positive)
    gradient[at] += weight * free / free0**2
    hessian[at, at] += weight / free0**2
    return _cost(measured, x, weight), gradient, hessian
