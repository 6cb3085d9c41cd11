"""Arguments that a kernel may write to: reading kernels are compiled once for all arrays.

To numba an array that can't be written is of another type than one that can, and a kernel is
compiled again for each mixture. One that provably leaves an argument alone needs no such type.
"""

import inspect
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numba import types
from numba.core import cgutils, ir
from numba.core.datamodel import default_manager
from numba.core.datamodel.models import PointerModel, PrimitiveModel
from numba.extending import lower_cast

#: Functions that leave arrays alone, by the first part of their module's name.
_READING_MODULES = frozenset({"math", "builtins", "cmath", "operator"})
_READING_NUMPY = frozenset(
    {
        "abs", "all", "any", "append", "arange", "arctan2", "argmax", "argmin", "argsort",
        "array", "asarray", "ascontiguousarray", "concatenate", "cos", "cross", "cumsum",
        "diag", "dot", "empty", "empty_like", "exp", "eye", "floor", "full", "full_like",
        "isfinite", "isnan", "linspace", "max", "maximum", "mean", "min", "minimum", "nonzero",
        "norm", "ones", "ones_like", "outer", "prod", "searchsorted", "sin", "sort", "sqrt",
        "stack", "sum", "tan", "trace", "transpose", "where", "zeros", "zeros_like",
    }
)  # fmt: skip
#: Those whose arrays are always new ones.
_FRESH = frozenset(
    {"arange", "empty", "empty_like", "eye", "full", "full_like", "linspace", "ones"}
)
_FRESH |= {"ones_like", "zeros", "zeros_like"}
_FRESH_METHODS = frozenset({"astype", "copy", "flatten"})
_READING_METHODS = frozenset(
    {
        "all", "any", "argmax", "argmin", "astype", "copy", "dot", "flatten", "max", "mean",
        "min", "nonzero", "ravel", "reshape", "sum", "transpose",
    }
)  # fmt: skip
_VIEWING = frozenset(
    {
        "cast", "exhaust_iter", "getattr", "getitem", "getiter", "iternext", "pair_first",
        "pair_second", "static_getitem", "typed_getitem",
    }
)  # fmt: skip
_MAKING = frozenset(
    {
        "arrayexpr", "binop", "null", "unary", "undef",
    }
)  # fmt: skip


def writable(kind: Any) -> Any:
    """A type with every array in it one that can be written."""
    if isinstance(kind, types.Array):
        return kind.copy(readonly=False)
    if isinstance(kind, types.BaseTuple) and len(kind):
        return types.BaseTuple.from_types(
            [writable(one) for one in kind], getattr(kind, "instance_class", None)
        )
    if isinstance(kind, types.Optional):
        return types.Optional(writable(kind.type))
    return kind


@lower_cast(types.BaseNamedTuple, types.BaseNamedTuple)  # type: ignore[untyped-decorator]
def _recast(context: Any, builder: Any, given: Any, wanted: Any, value: Any) -> Any:
    """A tuple with read-only arrays as one with others; numba casts nameless tuples only."""
    items = cgutils.unpack_tuple(builder, value, len(given))
    cast = [context.cast(builder, *one) for one in zip(items, given, wanted, strict=True)]
    return context.make_tuple(builder, wanted, cast)


def holds_arrays(kind: Any) -> bool:
    """Whether a value of a type may lead to an array; in doubt, yes."""
    if isinstance(kind, types.BaseTuple):
        return any(map(holds_arrays, kind))
    if isinstance(kind, types.Optional):
        return holds_arrays(kind.type)
    plain = types.Number | types.Boolean | types.NoneType | types.UnicodeType | types.Literal
    nothing = types.Omitted | types.Function | types.Dispatcher | types.Module | types.SliceType
    if isinstance(kind, plain | nothing | types.RangeType | types.RangeIteratorType):
        return False
    model = default_manager[kind]  # such as that of a vector: one value and no address
    return not isinstance(model, PrimitiveModel) or isinstance(model, PointerModel)


class Use(NamedTuple):
    """Use of a kernel's arguments, by their numbers; a superset of the true one.

    Attributes:
        written: arguments with arrays that it may write to.
        given: arguments with arrays that may be in what it gives back.
    """

    written: frozenset[int]
    given: frozenset[int]


def use(func_ir: Any, typemap: Any, calltypes: Any) -> Use:
    """Use that a function makes of its arguments, from numba's typed code."""
    return _Aliases(func_ir, typemap, calltypes).use()


class _Aliases:
    """Arguments that each variable may lead to."""

    def __init__(self, func_ir: Any, typemap: Any, calltypes: Any) -> None:
        self._statements = [one for block in func_ir.blocks.values() for one in block.body]
        self._typemap, self._calltypes = typemap, calltypes
        self._roots: dict[str, set[int]] = {}
        self._items: dict[str, list[Any]] = {}
        self._written: set[int] = set()
        self._given: set[int] = set()

    def use(self) -> Use:
        before = -1
        while before != self._size():
            before = self._size()
            for statement in self._statements:
                self._follow(statement)
        return Use(frozenset(self._written), frozenset(self._given))

    def _size(self) -> int:
        return len(self._written) + len(self._given) + sum(map(len, self._roots.values()))

    def _of(self, variables: Any) -> set[int]:
        names = (one.name for one in variables if isinstance(one, ir.Var))
        return set().union(*(self._roots.get(name, ()) for name in names))

    def _follow(self, statement: Any) -> None:
        if isinstance(statement, ir.Assign):
            self._note_items(statement.target.name, statement.value)
            if holds_arrays(self._typemap[statement.target.name]):
                self._roots.setdefault(statement.target.name, set()).update(
                    self._behind(statement.value)
                )
            elif isinstance(statement.value, ir.Expr):
                self._behind(statement.value)
        elif isinstance(statement, ir.Return):
            self._given |= self._of([statement.value])
        elif isinstance(statement, ir.SetItem | ir.StaticSetItem | ir.SetAttr | ir.DelItem):
            self._written |= self._of([statement.target])
            self._hold(statement)

    def _note_items(self, target: str, value: Any) -> None:
        # Only of intermediate values, which are set once: `a, b = x.a, y.b` mixes nothing up.
        if target.startswith("$") and isinstance(value, ir.Expr):
            if value.op == "build_tuple":
                self._items[target] = list(value.items)
            elif value.op == "exhaust_iter" and value.value.name in self._items:
                self._items[target] = self._items[value.value.name]

    def _hold(self, statement: Any) -> None:
        # What is put into an array is copied; a list holds it.
        target, value = statement.target.name, getattr(statement, "value", None)
        if not isinstance(self._typemap[target], types.Array):
            self._roots.setdefault(target, set()).update(self._of([value]))

    def _behind(self, value: Any) -> set[int]:
        """The arguments that a value may lead to; notes what computing it may write."""
        if isinstance(value, ir.Arg):
            return {value.index}
        if isinstance(value, ir.Var):
            return self._of([value])
        if not isinstance(value, ir.Expr):
            return set()
        if value.op in _MAKING:
            return set()
        if value.op == "static_getitem" and isinstance(value.index, int):
            items = self._items.get(value.value.name)
            return self._of([value.value] if items is None else [items[value.index]])
        if value.op in _VIEWING:
            return self._of([value.value])
        if value.op == "call":
            return self._called(value)
        roots = self._of(value.list_vars())
        if value.op not in ("phi", "build_tuple"):
            self._written |= roots
        return roots

    def _called(self, call: Any) -> set[int]:
        kind = self._typemap[call.func.name]
        given = [*call.args, *(one for _, one in call.kws)]
        reached = self._of([*given, *([call.vararg] if call.vararg else [])])
        if isinstance(kind, types.BoundFunction):
            reached |= self._of([call.func])
        if not call.vararg and isinstance(kind, types.Dispatcher):
            known = _reading_function(kind.dispatcher, self._calltypes[call].args)
            self._written |= self._of(_handed(kind.dispatcher, call, known.written))
            return self._of(_handed(kind.dispatcher, call, known.given))
        if not _only_reads(kind, len(given)):
            self._written |= reached
        return set() if _of_numpy(kind, _FRESH) or _method(kind) in _FRESH_METHODS else reached


def _reading_function(kernel: Any, kinds: Any) -> Use:
    every = frozenset(range(len(kinds)))
    return kernel.use(kinds) if hasattr(kernel, "use") else Use(every, every)


def _handed(kernel: Any, call: Any, numbers: frozenset[int]) -> Iterator[Any]:
    """The arguments of a call that have these numbers."""
    names = list(inspect.signature(kernel.py_func).parameters)
    yield from (one for number, one in enumerate(call.args) if number in numbers)
    yield from (one for name, one in call.kws if names.index(name) in numbers)


def _of_numpy(kind: Any, names: frozenset[str]) -> bool:
    key = getattr(kind, "typing_key", None)
    module, name = getattr(key, "__module__", None) or "", getattr(key, "__name__", "")
    return module.split(".")[0] == "numpy" and name in names


def _method(kind: Any) -> str:
    bound = isinstance(kind, types.BoundFunction)
    return str(kind.typing_key).rsplit(".", 1)[-1] if bound else ""


def _only_reads(kind: Any, given: int) -> bool:
    if isinstance(kind, types.BoundFunction):
        return _method(kind) in _READING_METHODS
    if isinstance(kind, types.NamedTupleClass | types.NumberClass):
        return True
    key = getattr(kind, "typing_key", None)
    if isinstance(key, np.ufunc):
        return given <= key.nin
    if hasattr(key, "revision"):  # of compiled.simd
        return not getattr(key, "writes", False)
    module = getattr(key, "__module__", None) or ""
    return module.split(".")[0] in _READING_MODULES or _of_numpy(kind, _READING_NUMPY)
