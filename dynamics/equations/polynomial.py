"""Trigonometric polynomials: exact sums of products of symbols, cosines and sines of angles.

An angle q enters as z = exp(i q), so that cos q = (z + 1/z) / 2 and sin q = (z - 1/z) / 2i. A
polynomial in the symbols and in z, 1/z has one form only: identities such as sin^2 + cos^2 = 1 and
the addition theorems hold by themselves. Its coefficients are integers over powers of two, which
floating-point numbers hold exactly.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

#: Bits for the exponent of one variable: exponents between -511 and 511.
_BITS = 10
_BASE = 1 << _BITS
_HALF = _BASE // 2
#: More terms than this are no readable formula.
MAX_TERMS = 20_000
#: Products of terms that one product of polynomials takes. Those of arms of six joints with a
#: spherical wrist take 6,000; a hundred times that takes minutes for the whole arm.
MAX_PRODUCTS = 50_000

#: An array of polynomials; numpy's sums and products call theirs.
Polynomials = NDArray[np.object_]


class TooManyTerms(Exception):
    """A formula has more terms than a reader can use."""


@dataclass(frozen=True, slots=True, eq=False)
class Polynomial:
    """A trigonometric polynomial.

    Args:
        terms: Coefficient of each product of powers. A key is sum_i e_i 2^(10 i) of the exponents
            e_i of the variables, so that keys add where products multiply.
    """

    terms: Mapping[int, complex]

    def __add__(self, other: "Polynomial | int") -> "Polynomial":
        total = dict(self.terms)
        for key, value in _terms(other).items():
            total[key] = total.get(key, 0.0) + value
        return _clean(total)

    __radd__ = __add__

    def __neg__(self) -> "Polynomial":
        return Polynomial({key: -value for key, value in self.terms.items()})

    def __sub__(self, other: "Polynomial | int") -> "Polynomial":
        return self + (-other)

    def __mul__(self, other: "Polynomial | float") -> "Polynomial":
        total: dict[int, complex] = {}
        factors = _terms(other)
        if len(self.terms) * len(factors) > MAX_PRODUCTS:
            raise TooManyTerms
        for key, value in self.terms.items():
            for key_2, value_2 in factors.items():
                at = key + key_2
                total[at] = total.get(at, 0.0) + value * value_2
        return _clean(total)

    __rmul__ = __mul__

    def __bool__(self) -> bool:
        return bool(self.terms)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Polynomial) and dict(self.terms) == dict(other.terms)

    __hash__ = None  # type: ignore[assignment]


def constant(value: complex) -> Polynomial:
    """The polynomial of a number."""
    return Polynomial(MappingProxyType({0: complex(value)} if value else {}))


def _terms(value: "Polynomial | complex") -> Mapping[int, complex]:
    return value.terms if isinstance(value, Polynomial) else constant(value).terms


def _clean(terms: Mapping[int, complex]) -> Polynomial:
    """A polynomial without its vanished terms.

    Raises:
        TooManyTerms: There are more than ``MAX_TERMS``.
    """
    left = {key: value for key, value in terms.items() if value}
    if len(left) > MAX_TERMS:
        raise TooManyTerms
    return Polynomial(MappingProxyType(left))


@dataclass(frozen=True, slots=True)
class Variables:
    """The variables of polynomials: symbols and angles, by name.

    Args:
        names: Names of the variables, all different; the position of each is its number.
        angles: Names of those that are angles and enter as exp(i angle).
    """

    names: tuple[str, ...]
    angles: frozenset[str]

    def symbol(self, name: str) -> Polynomial:
        """The polynomial of a symbol that is no angle."""
        return Polynomial(MappingProxyType({self._key(name): 1.0 + 0.0j}))

    def rotation(self, name: str, quarter_turns: int = 0) -> tuple[Polynomial, Polynomial]:
        """Cosine and sine of an angle and a number of quarter turns added to it."""
        key, turned = self._key(name), 1j**quarter_turns
        forward, back = 0.5 * turned, 0.5 * turned.conjugate()
        return (
            Polynomial(MappingProxyType({key: forward, -key: back})),
            Polynomial(MappingProxyType({key: forward / 1j, -key: -back / 1j})),
        )

    def derivative(self, value: Polynomial, name: str) -> Polynomial:
        """The partial derivative of a polynomial by a symbol or an angle.

        Args:
            value: The polynomial.
            name: The symbol or the angle.
        """
        number, step = self.names.index(name), self._key(name)
        total: dict[int, complex] = {}
        for key, coefficient in value.terms.items():
            power = self.exponents(key)[number]
            if name in self.angles:
                total[key] = 1j * power * coefficient
            elif power:
                total[key - step] = power * coefficient
        return _clean(total)

    def divide(self, value: Polynomial, name: str, *, by_sine: bool) -> Polynomial | None:
        """A polynomial divided by the sine or cosine of an angle; None where that leaves a rest.

        Args:
            value: The polynomial.
            name: Name of the angle.
            by_sine: By the sine; by the cosine otherwise.
        """
        step, place = self._key(name), self.names.index(name)
        sign, size = (-1.0, 2.0j) if by_sine else (1.0, 2.0)
        left, quotient = dict(value.terms), {}
        # From the highest power of z = exp(i angle) down: z + 1/z divides it, or z - 1/z.
        lowest = min((self.exponents(key)[place] for key in left), default=0)
        for key in sorted(left, key=lambda key: -self.exponents(key)[place]):
            at = key
            while self.exponents(at)[place] > lowest + 1 and (term := left.pop(at, 0.0)):
                quotient[at - step] = size * term
                at -= 2 * step
                left[at] = left.get(at, 0.0) - sign * term
        return None if any(left.values()) else Polynomial(quotient)

    def exponents(self, key: int) -> tuple[int, ...]:
        """Exponents of all variables in the key of a term."""
        powers = []
        for _ in self.names:
            power = (key + _HALF) % _BASE - _HALF
            powers.append(power)
            key = (key - power) >> _BITS
        return tuple(powers)

    def key(self, exponents: Sequence[int]) -> int:
        """The key of a term, from the exponents of all variables."""
        return sum(power << (_BITS * i) for i, power in enumerate(exponents))

    def _key(self, name: str) -> int:
        return 1 << (_BITS * self.names.index(name))


def matrix(rows: Iterable[Iterable["Polynomial | float"]]) -> Polynomials:
    """A matrix of polynomials from rows of polynomials and numbers."""
    values: list[list[Any]] = [
        [item if isinstance(item, Polynomial) else constant(item) for item in row] for row in rows
    ]
    array = np.empty((len(values), len(values[0])), dtype=np.object_)
    array[:] = values
    return array


def determinant(M: Polynomials) -> Polynomial:
    """The determinant of a small matrix, by its first column."""
    if not len(M):
        return constant(1.0)
    total, minors = constant(0.0), M[:, 1:]
    for i, entry in enumerate(M[:, 0]):
        if entry:
            total = total + entry * determinant(np.delete(minors, i, axis=0)) * (-1.0) ** i
    return total
