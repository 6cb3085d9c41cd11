"""Gains: positive numbers or symmetric positive definite matrices, checked before use."""

import numpy as np
from numpy.typing import ArrayLike

from kinematics.arrays import Array, frozen, numbers
from kinematics.errors import InvalidOption
from kinematics.model.chain import Chain

#: A matrix that came through text is symmetric to about this part of its largest entry.
SYMMETRY_TOLERANCE = 1e-9


def gain_vector(chain: Chain, name: str, value: ArrayLike) -> Array:
    """One positive gain for each joint, shape (n,), from one number for all or n of them.

    Raises:
        InvalidOption: Wrong number of gains, or one is not positive and finite.
    """
    return frozen(_positive(chain, name, numbers(value, f"the gain {name}")))


def gain_matrix(chain: Chain, name: str, value: ArrayLike) -> Array:
    """A symmetric positive definite matrix, (n, n), from one number, n of them or the matrix.

    Raises:
        InvalidOption: Wrong shape, not finite, not symmetric or not positive definite.
    """
    K = numbers(value, f"the gain {name}")
    if K.shape != (chain.n, chain.n):
        return frozen(np.diag(_positive(chain, name, K)))
    return _definite(name, K)


def adaptation_gain(count: int, value: ArrayLike) -> Array:
    """A symmetric positive definite matrix for so many parameters, from one number, or each's.

    Raises:
        InvalidOption: Wrong shape, not finite, not symmetric or not positive definite.
    """
    Gamma = numbers(value, "the gain Gamma")
    if Gamma.shape == (count, count):
        return _definite("Gamma", Gamma)
    if Gamma.shape not in {(), (count,)} or (Gamma <= 0.0).any():
        raise InvalidOption(
            f"the gain Gamma has shape {Gamma.shape} or is not positive; "
            f"{count} parameters are estimated",
            hint=f"Give one positive number, {count} of them, or a {count} x {count} matrix.",
        )
    return frozen(np.diag(np.broadcast_to(Gamma, (count,))))


def filtered_gains(chain: Chain, Lambda: ArrayLike, K: ArrayLike) -> tuple[Array, Array]:
    """Lambda (n,) and K (n, n) of the filtered error r = q_tilde_dot + Lambda q_tilde.

    Raises:
        InvalidOption: A gain has the wrong shape, or is not (symmetric) positive (definite).
    """
    return gain_vector(chain, "Lambda", Lambda), gain_matrix(chain, "K", K)


def commute(Lambda: Array, K: Array) -> bool:
    """Whether Lambda (n,) and K (n, n) commute: Lambda K is symmetric, as the proof needs it."""
    return is_symmetric(Lambda[:, None] * K)


def placed_gains(
    chain: Chain, natural_frequency: ArrayLike, damping: ArrayLike = 1.0
) -> tuple[Array, Array]:
    """Gains k_p = w^2 and k_d = 2 zeta w, both (n,), that give e'' + k_d e' + k_p e = 0 its poles.

    Those are -w (zeta +- sqrt(zeta^2 - 1)): two real ones for zeta > 1, a double one for 1.

    Args:
        chain: The robot.
        natural_frequency: w, one number or shape (n,) [rad/s].
        damping: zeta, one number or shape (n,).

    Raises:
        InvalidOption: A value is not positive, or their number is wrong.
    """
    w = gain_vector(chain, "natural_frequency", natural_frequency)
    zeta = gain_vector(chain, "damping", damping)
    return frozen(w**2), frozen(2.0 * zeta * w)


def _definite(name: str, K: Array) -> Array:
    if not is_symmetric(K):
        raise InvalidOption(
            f"the gain matrix {name} is not symmetric",
            hint="Give a symmetric positive definite matrix, or one number a joint.",
        )
    smallest = float(np.linalg.eigvalsh(K)[0])
    if smallest <= 0.0:
        raise InvalidOption(
            f"the gain matrix {name} is not positive definite: "
            f"its smallest eigenvalue is {smallest:.6g}",
            hint="Give a symmetric positive definite matrix, or one number a joint.",
        )
    return frozen(0.5 * (K + K.T))


def is_symmetric(K: Array) -> bool:
    """Whether a matrix equals its transpose, to rounding."""
    return bool(np.abs(K - K.T).max() <= SYMMETRY_TOLERANCE * np.abs(K).max())


def _positive(chain: Chain, name: str, values: Array) -> Array:
    if values.shape not in {(), (chain.n,)}:
        raise InvalidOption(
            f"the gain {name} has shape {values.shape}, robot {chain.name!r} has {chain.n} joints",
            hint=f"Give one number for all joints or {chain.n}, "
            f"in the order {', '.join(chain.joint_names)}.",
        )
    gains = np.broadcast_to(values, (chain.n,))
    if (gains <= 0.0).any():
        joint = chain.joint_names[int(np.argmin(gains))]
        raise InvalidOption(
            f"the gain {name} is {gains.min():.6g} at joint {joint!r}",
            hint="Gains must be positive.",
            joint=joint,
        )
    return gains
