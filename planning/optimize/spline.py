"""Clamped B-splines of normalised time: control points to polynomial pieces, exactly.

q(t) = sum_i P_i N_i(t / T) with the basis functions N_i of degree p over knots
0 = ... = 0 < u_1 < ... < 1 = ... = 1. A derivative is a B-spline again, whose control points

    P'_i = p (P_(i+1) - P_i) / (u_(i+p+1) - u_(i+1))

enclose its values: bounds on them hold at every instant.
Source: "The NURBS book", chapters 2 and 3.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy

from kinematics.arrays import Array, Indices
from kinematics.errors import InvalidOption
from kinematics.trajectory.trajectory import Trajectory


@dataclass(frozen=True)
class SplineSpace:
    """All splines of one degree over the same inner knots.

    Args:
        degree: p >= 1.
        breaks: Places at which the polynomial pieces meet, 0 = b_0 < ... < b_m = 1.

    Raises:
        InvalidOption: The degree is below 1, or the breaks do not ascend from 0 to 1.
    """

    degree: int
    breaks: tuple[float, ...]

    def __post_init__(self) -> None:
        ascending = bool((np.diff(self.breaks) > 0.0).all())
        if self.degree < 1 or len(self.breaks) < 2 or not ascending:
            raise InvalidOption("a spline needs a degree of at least 1 and ascending breaks")
        if self.breaks[0] != 0.0 or self.breaks[-1] != 1.0:
            raise InvalidOption("the breaks of a spline of normalised time go from 0 to 1")

    @classmethod
    def uniform(cls, degree: int, count: int) -> "SplineSpace":
        """The space with ``count`` control points and breaks at equal distances."""
        return cls(degree, tuple(float(b) for b in np.linspace(0.0, 1.0, count - degree + 1)))

    @property
    def pieces(self) -> int:
        """Number of polynomial pieces m."""
        return len(self.breaks) - 1

    @property
    def count(self) -> int:
        """Number of control points, m + p."""
        return self.pieces + self.degree

    @cached_property
    def knots(self) -> Array:
        """The breaks with the ends p + 1 times each."""
        ends = np.ones(self.degree)
        return np.concatenate([0.0 * ends, self.breaks, ends])

    @cached_property
    def powers(self) -> Array:
        """Coefficients of (u - b_k)^j in the i-th of the basis functions that live on piece k.

        Shape (m, p + 1, p + 1), indices k, i, j.
        """
        p = self.degree
        units = np.eye(self.count)
        every = [scipy.interpolate.PPoly.from_spline((self.knots, unit, p)).c for unit in units]
        c = np.stack(every)[:, ::-1]
        return np.ascontiguousarray([c[k : k + p + 1, :, p + k] for k in range(self.pieces)])

    def basis(self, places: Array, derivative: int = 0) -> tuple[Indices, Array]:
        """The basis functions at places u (K,) in [0, 1].

        Returns:
            The number of the first function that is not zero, shape (K,), and the values of p + 1
            functions from that one on, or of their derivatives with respect to u, (K, p + 1).
        """
        piece = np.searchsorted(self.breaks, places, side="right") - 1
        piece = np.clip(piece, 0, self.pieces - 1)
        u = (places - np.asarray(self.breaks)[piece])[:, None]
        c = self.powers[piece]
        for _ in range(derivative):
            c = c[:, :, 1:] * np.arange(1.0, c.shape[2])
        values = np.zeros(c.shape[:2])
        for j in range(c.shape[2] - 1, -1, -1):
            values = values * u + c[:, :, j]
        return piece, values

    def matrix(self, places: Array, derivative: int = 0) -> Array:
        """Matrix (K, N) that maps control points to values."""
        first, values = self.basis(places, derivative)
        rows = np.zeros((len(places), self.count))
        columns = first[:, None] + np.arange(self.degree + 1)
        np.put_along_axis(rows, columns, values, axis=1)
        return rows

    @cached_property
    def differences(self) -> tuple[Array, ...]:
        """Matrices from control points to those of derivative 1, 2, ... p: (N - r, N) each."""
        t, found = self.knots, [np.eye(self.count)]
        for r in range(1, self.degree + 1):
            d = self.degree - r + 1
            spans = t[r + d : r + d + self.count - r] - t[r : r + self.count - r]
            found.append(d / spans[:, None] * np.diff(found[-1], axis=0))
        return tuple(found[1:])

    @cached_property
    def gram(self) -> tuple[Array, ...]:
        """Integrals over [0, 1] of products of derivatives r = 0 ... p of basis functions."""
        nodes, weights = np.polynomial.legendre.leggauss(self.degree + 1)
        starts, lengths = np.asarray(self.breaks[:-1]), np.diff(self.breaks)
        places = (starts[:, None] + 0.5 * lengths[:, None] * (nodes + 1.0)).ravel()
        shares = (0.5 * lengths[:, None] * weights).ravel()
        rows = (self.matrix(places, r) for r in range(self.degree + 1))
        return tuple(B.T @ (shares[:, None] * B) for B in rows)

    def trajectory(self, joint_names: Sequence[str], points: Array, duration: float) -> Trajectory:
        """The spline as a motion, the very same polynomials.

        Args:
            joint_names: n names.
            points: Control points, shape (N, n).
            duration: T [s].
        """
        p = self.degree
        local = np.stack([points[i : i + self.pieces] for i in range(p + 1)], axis=1)
        coefficients = np.einsum("kin,kij->knj", local, self.powers)
        coefficients /= duration ** np.arange(p + 1.0)
        breaks = np.asarray(self.breaks) * duration
        return Trajectory(tuple(joint_names), breaks, coefficients)
