"""Signatures of kernels as text that a person can read and numba's types can be made from again.

The text of a type is numba's own notation: `float64[:, ::1]` is a contiguous array of two
dimensions, `const(float64[::1])` one that can't be written, `(int64, float64)` a tuple and
`package.module.Name(...)` a named tuple with the types of its fields.
"""

import ast
import pkgutil
from collections.abc import Mapping, Sequence
from typing import Any

from numba import types

from compiled.simd import TYPES

_VECTORS = {kind: name for name, kind in TYPES.items()}


def type_text(kind: Any, names: Mapping[Any, str] | None = None) -> str:
    """The text of a type.

    Args:
        kind: numba's type.
        names: shorter names of types, used inside of other types and by themselves.

    Raises:
        ValueError: the type has no notation here, and so can't be made from text again.
    """
    names = {} if names is None else names
    if kind in names:
        return names[kind]
    if kind in _VECTORS:
        return _VECTORS[kind]
    if isinstance(kind, types.Array):
        return _array_text(kind)
    if isinstance(kind, types.BaseNamedTuple):
        made = kind.instance_class
        fields = ", ".join(type_text(one, names) for one in kind.types)
        return f"{made.__module__}.{made.__qualname__}({fields})"
    if isinstance(kind, types.BaseTuple):
        items = [type_text(one, names) for one in kind]
        return f"({', '.join(items)}{',' if len(items) == 1 else ''})"
    if isinstance(kind, types.Optional):
        return f"optional({type_text(kind.type, names)})"
    if getattr(types, str(kind), None) == kind:
        return str(kind)
    raise ValueError(f"no text for the type {kind}")


def type_of_text(text: str, names: Mapping[str, Any] | None = None) -> Any:
    """The type that a text stands for.

    Args:
        text: as `type_text` writes it.
        names: types by their shorter names.

    Raises:
        ValueError: the text is none of a type, or names what is not there.
    """
    try:
        return _type(ast.parse(text, mode="eval").body, names or {})
    except (SyntaxError, AttributeError, ImportError) as error:
        raise ValueError(f"unknown type {text!r}: {error}") from None


def named_tuples(kinds: Sequence[Any]) -> list[Any]:
    """The types of named tuples among types and inside of them, those inside first."""
    found: dict[Any, None] = {}
    for kind in kinds:
        if isinstance(kind, types.BaseTuple):
            found.update(dict.fromkeys(named_tuples(list(kind))))
            if isinstance(kind, types.BaseNamedTuple):
                found[kind] = None
    return list(found)


def _array_text(kind: Any) -> str:
    plain = kind.copy(readonly=False)
    if kind.ndim == 0 or plain != types.Array(kind.dtype, kind.ndim, kind.layout):
        raise ValueError(f"no text for the type {kind}")
    slices = [":"] * kind.ndim
    if kind.layout != "A":
        slices[-1 if kind.layout == "C" else 0] = "::1"
    text = f"{kind.dtype}[{', '.join(slices)}]"
    return text if kind == plain else f"const({text})"


def _type(node: ast.expr, names: Mapping[str, Any]) -> Any:
    if isinstance(node, ast.Name):
        return {**TYPES, **names}.get(node.id) or getattr(types, node.id)
    if isinstance(node, ast.Tuple):
        return types.BaseTuple.from_types([_type(one, names) for one in node.elts])
    if isinstance(node, ast.Subscript):
        return _array(node, names)
    if isinstance(node, ast.Call):
        inside = [_type(one, names) for one in node.args]
        called = ast.unparse(node.func)
        if called == "const":
            return inside[0].copy(readonly=True)
        if called == "optional":
            return types.Optional(inside[0])
        of = pkgutil.resolve_name(called)
        if len(of._fields) != len(inside):
            raise ValueError(f"{called} has {len(of._fields)} fields, not {len(inside)}")
        return types.BaseTuple.from_types(inside, of)
    raise ValueError(f"unknown type {ast.unparse(node)!r}")


def _array(node: ast.Subscript, names: Mapping[str, Any]) -> Any:
    slices = node.slice.elts if isinstance(node.slice, ast.Tuple) else [node.slice]
    contiguous = [isinstance(one, ast.Slice) and one.step is not None for one in slices]
    layout = "C" if contiguous[-1] else "F" if contiguous[0] else "A"
    return types.Array(_type(node.value, names), len(slices), layout)
