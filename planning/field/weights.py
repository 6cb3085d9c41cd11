"""Weights and distances of a potential, and checks of numbers among its options."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from kinematics.arrays import Array
from kinematics.caches.bounded_cache import bounded_cache
from kinematics.errors import InvalidOption


def positive(name: str, value: object) -> None:
    """Check that an option is a finite number above 0.

    Raises:
        InvalidOption: It is not.
    """
    if isinstance(value, bool) or not (
        isinstance(value, int | float) and math.isfinite(value) and value > 0
    ):
        raise InvalidOption(f"{name} must be a positive number, not {value!r}")


def whole(name: str, value: object, least: int, most: int) -> None:
    """Check that an option is a whole number from ``least`` to ``most``.

    Raises:
        InvalidOption: It is not.
    """
    if isinstance(value, bool) or not isinstance(value, int) or not least <= value <= most:
        raise InvalidOption(f"{name} must be a whole number from {least} to {most}, not {value!r}")


def share(name: str, value: object) -> None:
    """Check that an option is a number from 0 to less than 1.

    Raises:
        InvalidOption: It is not.
    """
    if isinstance(value, bool) or not (isinstance(value, int | float) and 0.0 <= value < 1.0):
        raise InvalidOption(f"{name} must be a number from 0 to less than 1, not {value!r}")


#: Beyond this a weight's force could leave what float64 holds to some digits.
MAX_WEIGHT = 1e9


@dataclass(frozen=True, slots=True, eq=False)
class FieldWeights:
    """Weights of the forces on control points, and the distances that they depend on.

    Args:
        attractive_weights: c_i, pull towards the goal [N/m]: one for all points, or one each.
        attractive_cap: d, distance beyond which the pull no longer grows [m].
        repulsive_weights: eta_i, push away from obstacles [N m^3]: one for all points, or one each.
        influence_distance: rho_0, distance within which an obstacle is felt [m].
        least_distance: Nearer than this, and inside, an obstacle pushes as it does here [m].

    Raises:
        InvalidOption: A value is not a positive number (weights may be 0), or least_distance is not
            below influence_distance.
    """

    attractive_weights: float | Sequence[float] = 1.0
    attractive_cap: float = 0.2
    repulsive_weights: float | Sequence[float] = 2e-4
    influence_distance: float = 0.1
    least_distance: float = 1e-3

    def __post_init__(self) -> None:
        for name in ("attractive_cap", "influence_distance", "least_distance"):
            positive(name, getattr(self, name))
        for name in ("attractive_weights", "repulsive_weights"):
            _weights(name, getattr(self, name), None)
        if self.least_distance >= self.influence_distance:
            raise InvalidOption(
                f"least_distance is {self.least_distance:g} m, not below the influence_distance "
                f"{self.influence_distance:g} m",
                hint="Lower least_distance, or let obstacles be felt from farther away.",
            )

    def with_share(self, share: float) -> "FieldWeights":
        """Return these with a share of the weights that are one number for all points."""
        if share == 1.0:
            return self
        names = ("attractive_weights", "repulsive_weights")
        weights = {name: getattr(self, name) for name in names}
        numbers = {k: share * v for k, v in weights.items() if not isinstance(v, Sequence)}
        return replace(self, **numbers)

    def each(self, m: int) -> tuple[Array, Array]:
        """c_i and eta_i of m control points, both (m,).

        Raises:
            InvalidOption: Weights are given for another number of points.
        """
        # Copies that can be written to, as kernels were compiled for.
        attractive, repulsive = _each(self, m)
        return attractive.copy(), repulsive.copy()


@bounded_cache(maxsize=64)
def _each(weights: FieldWeights, m: int) -> tuple[Array, Array]:
    return (
        _weights("attractive_weights", weights.attractive_weights, m),
        _weights("repulsive_weights", weights.repulsive_weights, m),
    )


def _weights(name: str, value: object, m: int | None) -> Array:
    try:
        array = np.array(value, dtype=np.float64)
    except (TypeError, ValueError):
        array = np.array(np.nan)
    # Only the values' own types tell True from 1.
    bare = [value] if not isinstance(value, Sequence) or isinstance(value, str) else list(value)
    fits = array.ndim <= 1 and array.size > 0
    numbers = not any(isinstance(item, bool | str) for item in bare)
    if not (fits and numbers and (array >= 0.0).all() and (array <= MAX_WEIGHT).all()):
        raise InvalidOption(
            f"{name} must be a number from 0 to {MAX_WEIGHT:g}, or one for each control point"
        )
    if m is None:
        return array
    if array.ndim == 1 and len(array) != m:
        raise InvalidOption(
            f"{name} has {len(array)} value(s), there are {m} control points",
            hint="Give one number for all of them, or one for each, base to tip.",
            control_points=m,
        )
    return np.array(np.broadcast_to(array, m))
