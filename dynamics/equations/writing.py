"""Formulas written as LaTeX or as plain text that Python can evaluate."""

from dataclasses import dataclass, field
from enum import Enum

from dynamics.equations.formula import Angle, Factor, Function, Product, Sum

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
