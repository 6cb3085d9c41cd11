"""A geometric path as a value: joint positions as piecewise polynomials of a path parameter."""

from dataclasses import dataclass, field
from math import comb

import numpy as np
from numpy.typing import ArrayLike

from kinematics.arrays import Array, frozen
from kinematics.errors import InvalidOption, InvalidTrajectory
from kinematics.trajectory.polynomial import sample_kernel, shift_kernel

# Directions that differ by less are the same direction: a corner this flat changes no velocity by
# more than the ninth digit, and legs of a micrometre still have their direction to ten digits.
SAME_DIRECTION = 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class JointPath:
    """q_j(s) = sum_k c_ijk u^k, u = s - s_i within [0, l_i]: the shape of a motion without time.

    Where the tangent dq/ds jumps from one piece to the next the path has a sharp corner, which can
    only be passed at rest.

    Args:
        coefficients: Coefficients in ascending powers of u, shape (p, n, k), k >= 2.
        lengths: Lengths of the pieces in the path parameter s, shape (p,), all positive.

    Also known: ``n``, the number of joints; ``breaks``, the path parameters at which pieces begin,
    and the end, shape (p + 1,).

    Raises:
        InvalidTrajectory: Shapes do not fit, values are not finite, or a length is not positive.
    """

    coefficients: Array
    lengths: Array
    n: int = field(init=False, repr=False)
    breaks: Array = field(init=False, repr=False)

    def __post_init__(self) -> None:
        for name in ("coefficients", "lengths"):
            object.__setattr__(self, name, frozen(getattr(self, name)))
        c, lengths = self.coefficients, self.lengths
        if c.ndim != 3 or c.shape[0] < 1 or c.shape[1] < 1 or c.shape[2] < 2:
            raise InvalidTrajectory(
                f"path coefficients of shape {c.shape} describe no path",
                hint="Give coefficients[piece][joint][power], at least the powers 0 and 1.",
            )
        if lengths.shape != c.shape[:1] or not (np.isfinite(lengths) & (lengths > 0.0)).all():
            raise InvalidTrajectory(
                "each piece of a path needs one positive length",
                hint=f"Give {c.shape[0]} positive numbers.",
            )
        if not np.isfinite(c).all():
            raise InvalidTrajectory("the coefficients of a path are not all finite")
        breaks = np.concatenate([[0.0], np.cumsum(lengths)])
        breaks.setflags(write=False)
        object.__setattr__(self, "n", c.shape[1])
        object.__setattr__(self, "breaks", breaks)

    @property
    def length(self) -> float:
        """Length in the path parameter s."""
        return float(self.breaks[-1])

    @property
    def corners(self) -> tuple[int, ...]:
        """Indices of the pieces that begin with a jump of the tangent: sharp corners."""
        c, u = self.coefficients, self.lengths[:, None]
        leaving = np.zeros(c.shape[:2])
        for k in range(c.shape[2] - 1, 0, -1):
            leaving = leaving * u + k * c[:, :, k]
        entering = c[:, :, 1]
        jumps = np.linalg.norm(entering[1:] - leaving[:-1], axis=1)
        scale = np.maximum(
            np.linalg.norm(entering[1:], axis=1), np.linalg.norm(leaving[:-1], axis=1)
        )
        return tuple(int(i) + 1 for i in np.flatnonzero(jumps > SAME_DIRECTION * scale))

    def reverse(self) -> "JointPath":
        """Path backwards: q(l - u) on each piece, the last piece first."""
        coefficients, lengths = self.coefficients[::-1], self.lengths[::-1]
        power = coefficients.shape[2]
        turned = np.zeros_like(coefficients)
        for k in range(power):
            for j in range(k, power):
                factor = comb(j, k) * (-1.0) ** k * lengths ** (j - k)
                turned[:, :, k] += factor[:, None] * coefficients[:, :, j]
        return JointPath(turned, lengths)

    def cut(self, places: Array) -> list["JointPath"]:
        """Parts of the path between its start, places within it (k,), ascending, and its end."""
        breaks, parts = self.breaks, []
        ends = np.concatenate([[0.0], places, breaks[-1:]])
        firsts = np.searchsorted(breaks, ends[:-1], side="right") - 1
        for begin, end, i in zip(ends[:-1], ends[1:], firsts, strict=True):
            k = int(np.searchsorted(breaks, end))
            lengths, pieces = self.lengths[i:k].copy(), self.coefficients[i:k].copy()
            lengths[-1] = end - breaks[k - 1]
            if begin > breaks[i]:
                lengths[0] -= begin - breaks[i]
                for row in pieces[0]:
                    shift_kernel(row.copy(), begin - breaks[i], row)
            parts.append(JointPath(pieces, lengths))
        return parts

    def sample(self, places: ArrayLike, derivative: int = 0) -> Array:
        """q, or a derivative with respect to s, at given places s (p,), shape (len(places), n).

        Raises:
            InvalidOption: A place is not on the path, or the derivative is negative.
        """
        s = np.atleast_1d(np.asarray(places, dtype=np.float64))
        breaks = self.breaks
        if derivative < 0 or not ((s >= 0.0) & (s <= breaks[-1])).all():
            raise InvalidOption(
                "a place to sample at is not on the path",
                hint=f"Give places from 0 to {breaks[-1]!r} and a derivative of 0, 1, 2, ...",
            )
        values = np.empty((len(s), self.n))
        sample_kernel(breaks, self.coefficients, s, derivative, values)
        return values


def piece_values(coefficients: Array, places: Array, derivative: int) -> Array:
    """A derivative of polynomial pieces, each at one place.

    Args:
        coefficients: Ascending powers of the piece's own parameter, shape (N, n, k).
        places: Places in the pieces' own parameters, shape (N,).
        derivative: 0 for the value itself, 1, 2, ...

    Returns:
        Shape (N, n).
    """
    c = coefficients
    for _ in range(derivative):
        c = c[:, :, 1:] * np.arange(1.0, c.shape[2])
    value = np.zeros(c.shape[:2])
    for k in range(c.shape[2] - 1, -1, -1):
        value = value * places[:, None] + c[:, :, k]
    return value
