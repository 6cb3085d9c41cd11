"""Formulas of a state x1 ... xn: read by a whitelist, evaluated and written.

A formula is parsed as Python is, and every node of its tree must be one of those that are known:
nothing is ever evaluated as code. Numbers are exact, so that terms which cancel are gone.
"""

import ast
import operator
from collections.abc import Callable
from typing import Any, NoReturn, TypeAlias

import numpy as np
import sympy

from kinematics.arrays import Array
from kinematics.errors import InvalidOption

#: A sympy expression; sympy has no types.
Formula: TypeAlias = Any

#: Largest product of nested powers of a formula: (x1**4)**8 has 32.
MAX_DEGREE = 32
#: Largest exponent.
MAX_EXPONENT = 16
#: Brackets within brackets, at most.
MAX_DEPTH = 60
#: Numbers are between 1 over this and this, or 0.
MAX_NUMBER = 1e30
_FUNCTIONS: dict[str, tuple[Callable[[Formula], Formula], Callable[[Any], Any]]] = {
    name: (getattr(sympy, name), getattr(np, name))
    for name in ("sin", "cos", "tan", "exp", "log", "sqrt", "tanh")
}
_UFUNCS = dict(_FUNCTIONS.values())
_SIGNS: dict[type[ast.AST], Callable[..., Formula]] = {
    ast.Add: operator.add, ast.Sub: operator.sub, ast.Mult: operator.mul, ast.Div: operator.truediv,
    ast.Pow: operator.pow, ast.UAdd: operator.pos, ast.USub: operator.neg,
}  # fmt: skip


def symbols(n: int) -> tuple[Formula, ...]:
    """The symbols x1 ... xn."""
    return tuple(sympy.Symbol(f"x{i}") for i in range(1, n + 1))


def read_formula(name: str, text: str, n: int) -> Formula:
    """The formula that a text says.

    Args:
        name: Name of the formula in messages.
        text: Sums, products, quotients, powers and known functions of numbers and x1 ... xn.
        n: Number of states.

    Raises:
        InvalidOption: The text is no such formula; the message has the place of the fault.
    """
    return _Reader(name, text, {str(x): x for x in symbols(n)}).read_all()


class _Reader:
    """Reads one formula.

    Args:
        name: Name of the formula in messages.
        text: The formula.
        known: Symbols by their names.
    """

    def __init__(self, name: str, text: str, known: dict[str, Formula]) -> None:
        self._name, self._text, self._known = name, text.strip(), known
        self._skipped = len(text) - len(text.lstrip())

    def read_all(self) -> Formula:
        place = next((i for i, c in enumerate(self._text) if not c.isascii()), None)
        if place is not None:
            self._refuse(place, f"{self._text[place]!r} is no sign of a formula")
        try:
            tree = ast.parse(self._text, mode="eval")
        except SyntaxError as error:
            self._refuse((error.offset or 1) - 1, "this is no formula")
        except (ValueError, RecursionError, MemoryError):
            self._refuse(0, "this is no formula")
        return self._read(tree.body, 0)[0]

    def _read(self, node: ast.expr, depth: int) -> tuple[Formula, float]:
        """The formula of a node, and its degree."""
        if depth > MAX_DEPTH:
            self._refuse(node.col_offset, f"this is nested more than {MAX_DEPTH} deep")
        value, degree = self._node(node, depth + 1)
        if degree > MAX_DEGREE:
            self._refuse(node.col_offset, f"this has powers of powers beyond {MAX_DEGREE}")
        if not value.free_symbols:
            with np.errstate(all="ignore"):
                number = values(value, np.zeros(0))
            if not np.abs(number) <= MAX_NUMBER:
                self._refuse(node.col_offset, f"this is no real number up to {MAX_NUMBER:g}")
        return value, degree

    def _node(self, node: ast.expr, depth: int) -> tuple[Formula, float]:  # noqa: RET503
        match node:
            case ast.Constant(value=int() | float() as number) if not isinstance(number, bool):
                if number and not 1.0 / MAX_NUMBER <= abs(number) <= MAX_NUMBER:
                    self._refuse(node.col_offset, "this number is too large or too small")
                return sympy.Rational(str(number)), 1.0
            case ast.Name(id=name) if name in self._known:
                return self._known[name], 1.0
            case ast.Name(id=name):
                self._refuse(node.col_offset, f"{name!r} is no name of a formula")
            case ast.UnaryOp(op=sign, operand=inner) if type(sign) in _SIGNS:
                value, degree = self._read(inner, depth)
                return _SIGNS[type(sign)](value), degree
            case ast.BinOp(left=left, op=sign, right=right) if type(sign) in _SIGNS:
                return self._pair(sign, self._read(left, depth), self._read(right, depth), right)
            case ast.Call(func=ast.Name(id=name), args=[inner], keywords=[]) if name in _FUNCTIONS:
                value, degree = self._read(inner, depth)
                return _FUNCTIONS[name][0](value), degree
            case ast.Call(func=ast.Name(id=name)):
                self._refuse(node.col_offset, f"{name!r} is no function of one argument")
            case ast.BinOp(left=left, right=right):
                sign_text = self._text[left.end_col_offset : right.col_offset].strip(" ()")
                place = self._text.find(sign_text, left.end_col_offset)
                self._refuse(place, f"{sign_text!r} is no sign of a formula")
            case _:
                written = ast.get_source_segment(self._text, node) or ""
                self._refuse(node.col_offset, f"{written[:20]!r} is no part of a formula")

    def _pair(
        self,
        sign: ast.operator,
        left: tuple[Formula, float],
        right: tuple[Formula, float],
        node: ast.expr,
    ) -> tuple[Formula, float]:
        (a, first), (b, second) = left, right
        if isinstance(sign, ast.Pow):
            if not (b.is_Rational and abs(b) <= MAX_EXPONENT):
                self._refuse(node.col_offset, f"an exponent is a number up to {MAX_EXPONENT}")
            degree = first * max(1.0, abs(float(b)))
        else:
            is_sum = isinstance(sign, ast.Add | ast.Sub)
            degree = max(first, second) if is_sum else first + second
        if degree > MAX_DEGREE:
            self._refuse(node.col_offset, f"powers and products go beyond {MAX_DEGREE} here")
        return _SIGNS[type(sign)](a, b), degree

    def _refuse(self, place: int, fault: str) -> NoReturn:
        at = place + self._skipped + 1
        raise InvalidOption(
            f"{self._name}: {fault} (character {at})",
            hint=f"A formula is made of numbers, {', '.join(self._known)}, + - * / ** ( ) and "
            f"{', '.join(_FUNCTIONS)}.",
            character=at,
        )


def is_known(formula: Formula) -> bool:
    """Whether a formula has only functions that can be read, evaluated and written."""
    functions = {f.func for f in formula.atoms(sympy.Function)}
    return functions <= set(_UFUNCS) and not formula.has(sympy.I, sympy.Derivative)


def values(formula: Formula, x: Array) -> Any:
    """Values of a formula at states, shape (..., n); not finite where it has none.

    Args:
        formula: The formula.
        x: States, shape (..., n).
    """
    if formula.is_Symbol:
        return x[..., int(formula.name[1:]) - 1]
    if not formula.args:
        return np.float64(formula) if formula.is_extended_real else np.nan
    parts = [values(part, x) for part in formula.args]
    if formula.is_Add or formula.is_Mul:
        join = np.add if formula.is_Add else np.multiply
        total = parts[0]
        for part in parts[1:]:
            total = join(total, part)
        return total
    if formula.is_Pow:
        return np.power(np.asarray(parts[0], dtype=np.float64), parts[1])
    function = _UFUNCS.get(formula.func)
    return np.nan if function is None else function(parts[0])


def write(formula: Formula) -> str:
    """A formula as text; numbers are decimal but for halves."""
    written = {number: sympy.Float(number) for number in formula.atoms(sympy.Rational)
               if number.q > 2}  # fmt: skip
    return str(sympy.sstr(formula.xreplace(written), full_prec=False))
