"""Formulas: trigonometric polynomials as nested sums of named products, and their text.

Angles of parallel axes add: their cosines are c_12 = cos(q_1 + q_2), and products of cosines of
different axes stay products.
"""

import math
from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from typing import NamedTuple

from dynamics.equations.polynomial import Polynomial, TooManyTerms
from dynamics.equations.table import SymbolicTable

#: Coefficients are exact integers over powers of two; what is below is zero.
_ZERO = 1e-12
#: Products of cosines and sines that the terms of one formula expand to, before they cancel. The
#: poses of the Panda take 90,000; ten times that takes a minute for a whole pose.
MAX_PRODUCTS = 200_000


class Function(Enum):
    """A trigonometric function of a sum of angles."""

    COS = "c"
    SIN = "s"


class Angle(NamedTuple):
    """A cosine or sine of a sum of multiples of angles.

    Args:
        function: Cosine or sine.
        multiples: Angle and whole multiple, in the order of the joints; the first is positive.
    """

    function: Function
    multiples: tuple[tuple[str, int], ...]


#: A factor of a product: a symbol or a trigonometric function.
Factor = str | Angle
#: Factors with their powers.
Powers = tuple[tuple[Factor, int], ...]


@dataclass(frozen=True, slots=True)
class Product:
    """A product of a number, powers of factors and perhaps a sum.

    Args:
        coefficient: The number.
        powers: Each factor with its power.
        rest: The sum; None where there is none.
    """

    coefficient: float
    powers: Powers
    rest: "Sum | None" = None


@dataclass(frozen=True, slots=True)
class Sum:
    """A sum of products; empty for zero."""

    products: tuple[Product, ...]


class Collect(Enum):
    """The factors that a formula is put in order by."""

    ANGLES = "angles"
    MASSES = "masses"


def formula(table: SymbolicTable, value: Polynomial, collect: Collect) -> Sum:
    """A polynomial as a nested sum.

    Args:
        table: The robot, which knows the angles that add.
        value: The polynomial.
        collect: The factors that are taken out of sums.

    Raises:
        TooManyTerms: The formula would be too long to be read.
    """
    return sum_of_terms(real_terms(table, value), collect)


def factored(table: SymbolicTable, value: Polynomial) -> Sum:
    """A polynomial as a product: sines and cosines of single joints that divide it come first.

    Args:
        table: The robot, which knows the angles that add.
        value: The polynomial.

    Raises:
        TooManyTerms: The formula would be too long to be read.
    """
    if not value:
        return Sum(())
    powers: Counter[Factor] = Counter()
    plain = [q for q in table.joints if q in table.variables.angles]
    for name, function in [(q, f) for q in plain if not _is_offset(table, q) for f in Function]:
        while part := table.variables.divide(value, name, by_sine=function is Function.SIN):
            value = part
            powers[Angle(function, ((name, 1),))] += 1
    rest = formula(table, value, Collect.ANGLES)
    return Sum((_product(1.0, tuple(powers.items()), rest),)) if powers else rest


def _is_offset(table: SymbolicTable, joint: str) -> bool:
    """Whether a joint's angle enters with a constant one added."""
    return joint.replace("q", "theta") in table.variables.names


def numeric_value(value: Sum, numbers: Mapping[str, float]) -> float:
    """The value of a formula.

    Args:
        value: The formula.
        numbers: The values of its symbols.
    """
    total = 0.0
    for product in value.products:
        number = product.coefficient
        for factor, power in product.powers:
            number *= _factor_value(factor, numbers) ** power
        if product.rest is not None:
            number *= numeric_value(product.rest, numbers)
        total += number
    return total


def _factor_value(factor: Factor, numbers: Mapping[str, float]) -> float:
    if isinstance(factor, str):
        return numbers[factor]
    angle = sum(multiple * numbers[name] for name, multiple in factor.multiples)
    return math.cos(angle) if factor.function is Function.COS else math.sin(angle)


# -------------------------------------------------------------------- real terms, shortest first


def real_terms(table: SymbolicTable, value: Polynomial, *, pair: bool = True) -> list[Product]:
    """A polynomial as a sum of products of symbols, cosines and sines.

    Args:
        table: The robot, which knows the angles that add.
        value: The polynomial.
        pair: Write cos u + cos v as a product where that is shorter. Without it the products are
            linearly independent functions.

    Raises:
        TooManyTerms: The formula would be too long to be read.
    """
    count = 0
    sums: dict[tuple[Powers, tuple[Angle, ...]], float]
    sums = defaultdict(float)
    for key, coefficient in value.terms.items():
        exponents = table.variables.exponents(key)
        symbols, groups = _split(table, exponents)
        count += 2 ** len(groups)
        if count > MAX_PRODUCTS:
            raise TooManyTerms
        for angles, factor in _tensor(groups):
            sums[symbols, angles] += (coefficient * factor).real
    by_symbols: dict[Powers, dict[tuple[Angle, ...], float]]
    by_symbols = defaultdict(dict)
    for (symbols, angles), number in sums.items():
        if abs(number) > _ZERO:
            by_symbols[symbols][angles] = number
    terms = []
    for symbols, parts in by_symbols.items():
        for angles, number in (_pair(parts) if pair else parts).items():
            terms.append(Product(number, (*symbols, *Counter(angles).items())))
    return terms


def _split(table: SymbolicTable, exponents: Sequence[int]) -> tuple[Powers, list[dict[str, int]]]:
    """Powers of the symbols of a term, and the multiples of angles in each group."""
    symbols: list[tuple[Factor, int]] = []
    groups: dict[str, dict[str, int]] = {}
    for name, power in zip(table.variables.names, exponents, strict=True):
        if not power:
            continue
        if name in table.variables.angles:
            groups.setdefault(_group(table, name), {})[name] = power
        else:
            symbols.append((name, power))
    return tuple(symbols), [groups[name] for name in sorted(groups)]


def _group(table: SymbolicTable, angle: str) -> str:
    kind, _, number = angle.partition("_")
    if kind in ("q", "theta"):
        return f"{table.groups[int(number) - 1]:03d}"
    return f"{int(number):03d} {kind}"


def _tensor(groups: Sequence[dict[str, int]]) -> list[tuple[tuple[Angle, ...], complex]]:
    """exp(i sum of angles) as a sum of products of one cosine or sine for each group."""
    products: list[tuple[tuple[Angle, ...], complex]] = [((), 1.0 + 0.0j)]
    for multiples in groups:
        ordered = tuple(multiples.items())
        sign = 1 if ordered[0][1] > 0 else -1
        positive = tuple((name, sign * power) for name, power in ordered)
        cos, sin = Angle(Function.COS, positive), Angle(Function.SIN, positive)
        products = [
            ((*angles, function), value * factor)
            for angles, value in products
            for function, factor in ((cos, 1.0 + 0.0j), (sin, sign * 1.0j))
        ]
    return products


def _pair(parts: dict[tuple[Angle, ...], float]) -> dict[tuple[Angle, ...], float]:
    """Two terms that differ in one angle as one product, where that makes all terms one.

    1/2 + cos(2 q)/2 is cos(q)^2, and cos(q_3) + cos(2 q_2 + q_3) is 2 cos(q_2) cos(q_2 + q_3).
    """
    if len(parts) != 2:
        return parts
    (first, number), (second, number_2) = parts.items()
    common = tuple(angle for angle in first if angle in second)
    u, v = (tuple(a for a in angles if a not in common) for angles in (first, second))
    if abs(abs(number) - abs(number_2)) > _ZERO or len(u) > 1 or len(v) > 1:
        return parts
    if not u and not v:
        return parts
    same = number * number_2 > 0.0
    product = _sum_to_product(u, v, same)
    if product is None:
        return parts
    angles, factor = product
    return {tuple(sorted((*common, *angles), key=_rank)): number * factor}


def _sum_to_product(
    u: tuple[Angle, ...], v: tuple[Angle, ...], same: bool
) -> tuple[tuple[Angle, Angle], float] | None:
    """f(u) + f(v), or f(u) - f(v), as a product; None where half of u + v is no whole angle."""
    kinds = {angle.function for angle in (*u, *v)}
    if len(kinds) != 1 or (kinds == {Function.SIN} and not (u and v)):
        return None
    plus, minus = _half_sum(u, v, 1), _half_sum(u, v, -1)
    if plus is None or minus is None or not plus or not minus:
        return None
    cos, sin = Function.COS, Function.SIN
    if kinds == {cos}:
        pair = ((cos, plus), (cos, minus)) if same else ((sin, plus), (sin, minus))
        factor = 2.0 if same else -2.0
    else:
        pair = ((sin, plus), (cos, minus)) if same else ((cos, plus), (sin, minus))
        factor = 2.0
    angles = []
    for function, multiples in pair:
        sign = 1 if multiples[0][1] > 0 else -1
        angles.append(Angle(function, tuple((name, sign * m) for name, m in multiples)))
        if function is sin:
            factor *= sign
    return (angles[0], angles[1]), factor


def _half_sum(
    u: tuple[Angle, ...], v: tuple[Angle, ...], sign: int
) -> tuple[tuple[str, int], ...] | None:
    total: dict[str, int] = defaultdict(int)
    for angles, factor in ((u, 1), (v, sign)):
        for angle in angles:
            for name, multiple in angle.multiples:
                total[name] += factor * multiple
    if any(multiple % 2 for multiple in total.values()):
        return None
    return tuple((name, m // 2) for name, m in sorted(total.items()) if m)


# ----------------------------------------------------------------------------------- nesting


def sum_of_terms(terms: Sequence[Product], collect: Collect) -> Sum:
    """Products as a nested sum, common factors and then the collected ones taken out.

    Args:
        terms: Products of numbers and powers.
        collect: Factors that the sum is put in order by.
    """
    if not terms:
        return Sum(())
    coefficient, common = _common(terms)
    if len(terms) > 1 and (common or coefficient != 1.0):
        rest = sum_of_terms([_divide(term, coefficient, common) for term in terms], collect)
        return Sum((_product(coefficient, common, rest),))
    factor = _most_frequent(terms, collect)
    if factor is None:
        return _sum([Product(t.coefficient, _order(t.powers)) for t in terms], collect)
    with_it = [term for term in terms if factor in dict(term.powers)]
    without = [term for term in terms if factor not in dict(term.powers)]
    return _sum(
        [*sum_of_terms(with_it, collect).products, *_flat(sum_of_terms(without, collect))], collect
    )


def _flat(value: Sum) -> tuple[Product, ...]:
    """The products of a sum; those in the brackets where it is a sum with a sign before it."""
    if len(value.products) == 1:
        (only,) = value.products
        if not only.powers and only.rest is not None and abs(only.coefficient) == 1.0:
            inner = only.rest.products
            return tuple(Product(only.coefficient * p.coefficient, p.powers, p.rest) for p in inner)
    return value.products


def _common(terms: Sequence[Product]) -> tuple[float, Powers]:
    """Number and powers that all terms have in common."""
    powers = dict(terms[0].powers)
    for term in terms[1:]:
        others = dict(term.powers)
        powers = {f: min(power, others[f]) for f, power in powers.items() if f in others}
    sizes = {abs(term.coefficient) for term in terms}
    size = sizes.pop() if len(sizes) == 1 else 1.0
    sign = -1.0 if all(term.coefficient < 0.0 for term in terms) else 1.0
    return sign * size, tuple(powers.items())


def _divide(term: Product, coefficient: float, common: Powers) -> Product:
    taken = dict(common)
    left = tuple((f, p - taken.get(f, 0)) for f, p in term.powers if p != taken.get(f, 0))
    return Product(term.coefficient / coefficient, left)


def _product(coefficient: float, powers: Powers, rest: Sum) -> Product:
    """A product with a sum, in which a sum of one product is multiplied out."""
    if len(rest.products) != 1:
        return Product(coefficient, _order(powers), rest)
    (only,) = rest.products
    total = Counter(dict(powers))
    total.update(dict(only.powers))
    return Product(coefficient * only.coefficient, _order(total.items()), only.rest)


def _most_frequent(terms: Sequence[Product], collect: Collect) -> Factor | None:
    """The factor to take out first: of the first joint, and in the most terms."""
    counts = Counter(f for term in terms for f, _ in term.powers if _is_collected(f, collect))
    several = [factor for factor, count in counts.items() if count > 1]
    return min(several, key=lambda f: (_rank(f)[:2], -counts[f], _rank(f)), default=None)


def _is_collected(factor: Factor, collect: Collect) -> bool:
    if collect is Collect.ANGLES:
        return isinstance(factor, Angle)
    return isinstance(factor, str) and factor.startswith("m_")


# ----------------------------------------------------------------------------------- ordering

#: Symbols of a product in the order in which textbooks write them.
_KINDS = ("m", "I", "J", "B", "F", "l", "a", "d", "x", "y", "z", "b", "t", "g")
#: Ranks of other symbols, of angles, and of joint variables and their derivatives.
_OTHER_RANK = 40
_ANGLE_RANK = 50
_JOINT_RANK = 60

_Rank = tuple[int, int, str]


def _rank(factor: Factor) -> _Rank:
    if isinstance(factor, Angle):
        first = int(factor.multiples[0][0].partition("_")[2])
        text = f"{len(factor.multiples)}{factor.multiples}{factor.function.value}"
        return (_ANGLE_RANK, first, text)
    kind = factor.partition("_")[0]
    number = int("".join(c for c in factor if c.isdigit()) or 0)
    if kind in ("q", "qd", "qdd"):
        return (_JOINT_RANK + len(kind), number, factor)
    return (_KINDS.index(kind) if kind in _KINDS else _OTHER_RANK, number, factor)


def _order(powers: Iterable[tuple[Factor, int]]) -> Powers:
    return tuple(sorted(powers, key=lambda item: _rank(item[0])))


def _sum(products: Iterable[Product], collect: Collect) -> Sum:
    """A sum in the order of its masses, or of its angles."""

    def rank(product: Product) -> tuple[list[_Rank], list[_Rank]]:
        ranks = [_rank(factor) for factor, _ in product.powers]
        if collect is Collect.MASSES:
            return ranks, []
        angles = [r for r in ranks if r[0] == _ANGLE_RANK]
        return angles, [r for r in ranks if r[0] != _ANGLE_RANK]

    return Sum(tuple(sorted(products, key=rank)))


_LATEX_NAMES = {"qd": r"\dot{q}", "qdd": r"\ddot{q}", "theta": r"\theta", "alpha": r"\alpha",
                "beta": r"\beta"}  # fmt: skip
_LATEX_FUNCTIONS = {Function.COS: r"\cos", Function.SIN: r"\sin"}
_TEXT_FUNCTIONS = {Function.COS: "cos", Function.SIN: "sin"}


class Notation(Enum):
    """The form that formulas are written in."""

    LATEX = "latex"
    TEXT = "text"


@dataclass(slots=True)
class Writer:
    """Writes formulas, and remembers which abbreviations of angles they use.

    Args:
        notation: The form.
        offsets: Constant angle that is added to a joint's, by the joint's symbol.
        symbols: The symbols that it has written so far.
    """

    notation: Notation
    offsets: dict[str, str] = field(default_factory=dict)
    symbols: set[str] = field(default_factory=set)
    _used: dict[str, Angle] = field(default_factory=dict)

    def write(self, value: Sum) -> str:
        """A sum of products; 0 where it is empty."""
        text = ""
        for product in value.products:
            term = self._product(product)
            if term.startswith("-"):
                text += f" - {term[1:]}" if text else term
            else:
                text += f" + {term}" if text else term
        return text or "0"

    def symbol(self, name: str) -> str:
        """A symbol such as ``l_c2`` or ``qd_1`` as it is written."""
        self.symbols.add(name)
        if self.notation is Notation.TEXT:
            return name
        head, _, tail = name.partition("_")
        head = _LATEX_NAMES.get(head, head)
        return f"{head}_{{{tail}}}" if tail else head

    def tanh(self, argument: str) -> str:
        """The hyperbolic tangent of a written argument."""
        if self.notation is Notation.TEXT:
            return f"tanh({argument})"
        return rf"\tanh\left({argument}\right)"

    def abbreviations(self) -> list[tuple[str, str]]:
        """Abbreviations written so far, each with the function it stands for."""
        return [
            (self._angle(angle), self._definition(angle)) for _, angle in sorted(self._used.items())
        ]

    def _product(self, product: Product) -> str:
        factors = [self._power(factor, power) for factor, power in product.powers]
        if product.rest is not None:
            factors.append(self._bracket(product.rest))
        size = _number(abs(product.coefficient), self.notation)
        if size != "1" or not factors:
            factors.insert(0, size)
        sign = "-" if product.coefficient < 0.0 else ""
        return sign + (" * " if self.notation is Notation.TEXT else " ").join(factors)

    def _bracket(self, value: Sum) -> str:
        inner = self.write(value)
        return f"({inner})" if self.notation is Notation.TEXT else rf"\left({inner}\right)"

    def _power(self, factor: Factor, power: int) -> str:
        name = self._angle(factor) if isinstance(factor, Angle) else self.symbol(factor)
        if power == 1:
            return name
        return f"{name}**{power}" if self.notation is Notation.TEXT else f"{name}^{{{power}}}"

    def _angle(self, angle: Angle) -> str:
        indices = self._indices(angle)
        name = f"{angle.function.value}_{indices}"
        self._used[name] = angle
        if self.notation is Notation.TEXT:
            return name.replace("-", "m")
        for word in ("alpha", "beta", "theta"):
            indices = indices.replace(word, rf"\{word} ")
        return f"{angle.function.value}_{{{indices}}}"

    def _indices(self, angle: Angle) -> str:
        """Numbers of the joints whose angles are added, 12 for q_1 + q_2 and 22 for 2 q_2."""
        parts = []
        named = dict(angle.multiples)
        plain = all(int(name.partition("_")[2]) < 10 for name in named)
        for name, multiple in angle.multiples:
            if self._is_offset(name, multiple, named):
                continue
            kind, _, number = name.partition("_")
            label = number if kind == "q" else f"{kind}{number}"
            parts += [("-" if multiple < 0 else "") + label] * abs(multiple)
        all_joints = all(name.startswith("q_") or name in self.offsets.values() for name in named)
        return ("" if plain and all_joints else "_").join(parts)

    def _is_offset(self, name: str, multiple: int, named: dict[str, int]) -> bool:
        """Whether an angle is the offset of a joint that is there as often."""
        joints = [joint for joint, offset in self.offsets.items() if offset == name]
        return bool(joints) and named.get(joints[0]) == multiple

    def _definition(self, angle: Angle) -> str:
        total = ""
        for name, multiple in angle.multiples:
            size = "" if abs(multiple) == 1 else f"{abs(multiple)}"
            if size and self.notation is Notation.TEXT:
                size += "*"
            sign = "-" if multiple < 0 else "+" if total else ""
            gap = " " if total else ""
            total += f"{gap}{sign}{gap}{size}{self.symbol(name)}"
        if self.notation is Notation.TEXT:
            return f"{_TEXT_FUNCTIONS[angle.function]}({total})"
        return rf"{_LATEX_FUNCTIONS[angle.function]}\left({total}\right)"


def _number(value: float, notation: Notation) -> str:
    """A whole number, a fraction with a power of two below, or a decimal number."""
    if value == int(value):
        return str(int(value))
    for below in (2, 4, 8, 16, 32, 64):
        above = value * below
        if above == int(above):
            if notation is Notation.TEXT:
                return f"{int(above)}/{below}"
            return rf"\frac{{{int(above)}}}{{{below}}}"
    return repr(value)
