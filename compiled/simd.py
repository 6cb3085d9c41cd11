"""Eight numbers as one value of compiled code: arithmetic of eight SIMD lanes.

numba compiles an arithmetic kernel once for numbers and once for vectors, with equal bits in every
lane. Where numbers would branch, ``choose`` takes one of two values in each lane.
"""

import math
import operator
from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.datamodel import PrimitiveModel
from numba.extending import intrinsic, lower_builtin, overload, register_model, type_callable
from numpy.typing import NDArray

Array = NDArray[np.float64]
#: To a type checker a vector is a number, and a condition in each lane one condition.
Lanes = float
Conditions = bool

#: Lanes of a value: two vectors of four, which hides the time that an operation takes.
LANES = 8
#: Revision of the machine code of the functions below: count it up with every change.
_REVISION = 4

_F = TypeVar("_F", bound=Callable[..., Any])
VECTOR = ir.VectorType(ir.DoubleType(), LANES)
_BITS = ir.VectorType(ir.IntType(1), LANES)
#: Arrays of numbers are aligned to a number, not to a vector.
ALIGNMENT = 8
_NUMBERS = types.Array(types.float64, 1, "C")


class _VectorType(types.Type):
    def __init__(self) -> None:
        super().__init__(name=f"vector{LANES}r{_REVISION}")


class _ConditionsType(types.Type):
    def __init__(self) -> None:
        super().__init__(name=f"conditions{LANES}r{_REVISION}")


_vector, _conditions = _VectorType(), _ConditionsType()
TYPES = {"vector": _vector, "conditions": _conditions}  #: by names for lists of kernels


@register_model(_VectorType)
class _VectorModel(PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, VECTOR)


@register_model(_ConditionsType)
class _ConditionsModel(PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, _BITS)


def _mixed(kinds: tuple[Any, ...]) -> bool:
    """Whether some are vectors and the rest are numbers."""
    return _vector in kinds and all(k == _vector or isinstance(k, types.Number) for k in kinds)


def _widened(context: Any, builder: Any, kind: Any, value: Any) -> Any:
    """A number in all lanes, a vector as it is."""
    if kind == _vector:
        return value
    number = context.cast(builder, value, kind, types.float64)
    nothing = ir.Constant(VECTOR, ir.Undefined)
    first = builder.insert_element(nothing, number, ir.Constant(ir.IntType(32), 0))
    everywhere = ir.Constant(ir.VectorType(ir.IntType(32), LANES), [0] * LANES)
    return builder.shuffle_vector(first, nothing, everywhere)


def _both(function: Any, answer: Any, emit: Callable[[Any, Any, Any], Any]) -> None:
    """Let numba know a function of two vectors, or of one and a number."""

    @type_callable(function)  # type: ignore[untyped-decorator]
    def typed(context: Any) -> Any:
        return lambda a, b: answer if _mixed((a, b)) else None

    def lowered(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        a, b = (
            _widened(context, builder, *pair) for pair in zip(signature.args, values, strict=True)
        )
        return emit(builder, a, b)

    for kinds in ((_vector, _vector), (_vector, types.Number), (types.Number, _vector)):
        lower_builtin(function, *kinds)(lowered)


def _one(function: Any, emit: Callable[[Any, Any], Any]) -> None:
    """Let numba know a function of one vector."""

    @type_callable(function)  # type: ignore[untyped-decorator]
    def typed(context: Any) -> Any:
        return lambda a: _vector if a == _vector else None

    def lowered(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        return emit(builder, values[0])

    lower_builtin(function, _vector)(lowered)


def _library(name: str) -> Callable[[Any, Any], Any]:
    """A function that LLVM has for vectors."""

    def emit(builder: Any, value: Any) -> Any:
        kind = ir.FunctionType(VECTOR, [VECTOR])
        return builder.call(
            cgutils.get_or_insert_function(builder.module, kind, f"llvm.{name}.v{LANES}f64"),
            [value],
        )

    return emit


def _compared(symbol: str) -> Callable[[Any, Any, Any], Any]:
    return lambda builder, a, b: builder.fcmp_ordered(symbol, a, b)


def _extreme(symbol: str) -> Callable[[Any, Any, Any], Any]:
    return lambda builder, a, b: builder.select(builder.fcmp_ordered(symbol, b, a), b, a)


def _instruction(name: str) -> Callable[[Any, Any, Any], Any]:
    return lambda builder, a, b: getattr(builder, name)(a, b)


def _teach() -> None:
    """Register for vectors the operations that numba has for numbers."""
    for function, name in (
        (operator.add, "fadd"), (operator.sub, "fsub"), (operator.mul, "fmul"),
        (operator.truediv, "fdiv"), (operator.iadd, "fadd"), (operator.isub, "fsub"),
        (operator.imul, "fmul"),
    ):  # fmt: skip
        _both(function, _vector, _instruction(name))
    for function, symbol in (
        (operator.lt, "<"), (operator.le, "<="), (operator.gt, ">"), (operator.ge, ">="),
    ):  # fmt: skip
        _both(function, _conditions, _compared(symbol))
    # As Python's do, so that not even NaN or -0 tells a lane from a number.
    _both(max, _vector, _extreme(">"))
    _both(min, _vector, _extreme("<"))
    _one(operator.neg, lambda builder, value: builder.fneg(value))
    _one(math.sqrt, _library("sqrt"))
    _one(abs, _library("fabs"))
    for function, name in ((operator.and_, "and_"), (operator.or_, "or_")):
        _logical(function, name)


def _logical(function: Any, name: str) -> None:
    @type_callable(function)  # type: ignore[untyped-decorator]
    def typed(context: Any) -> Any:
        return lambda a, b: _conditions if a == b == _conditions else None

    def lowered(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        return getattr(builder, name)(*values)

    lower_builtin(function, _conditions, _conditions)(lowered)


_teach()


# ---------------------------------------------------------------------------------- functions


def revised(function: _F) -> _F:
    """Name the revision of what a function compiles to, for the stamp of machine code on disk."""
    function.revision = _REVISION  # type: ignore[attr-defined]
    return function


@revised
def load(array: Array, at: int) -> Lanes:
    """The eight numbers of a contiguous array (k,) from ``at`` on."""
    return array[at : at + LANES].copy()  # type: ignore[return-value]


@revised
def store(array: Array, at: int, value: Lanes) -> None:
    """Write a vector into a contiguous array (k,) from ``at`` on."""
    array[at : at + LANES] = value


store.writes = True  # type: ignore[attr-defined]


@revised
def fill(value: float) -> Lanes:
    """A number in all lanes."""
    return np.full(LANES, value)  # type: ignore[return-value]


@revised
def choose(where: Conditions, a: Lanes, b: Lanes) -> Lanes:
    """``a`` in lanes where a condition holds, ``b`` in the others; for numbers and vectors."""
    return np.where(where, a, b)  # type: ignore[return-value]


@revised
def anywhere(where: Conditions) -> bool:
    """Whether a condition holds in some lane; for conditions of numbers too."""
    return bool(np.any(where))


@revised
def floor(value: Lanes) -> Lanes:
    """The largest whole numbers that are not above; for numbers and vectors."""
    return np.floor(value)  # type: ignore[no-any-return]


@revised
def first(array: Array) -> Lanes:
    """The numbers of an array (k,) with 1 to 8 of them, the last one again in lanes beyond."""
    return array[np.minimum(np.arange(LANES), len(array) - 1)]  # type: ignore[return-value]


@revised
def lane(value: Lanes, number: int) -> float:
    """The number in one lane."""
    return float(value[number])  # type: ignore[index]


@revised
def bits(where: Conditions) -> int:
    """The lanes where a condition holds, as bits of a number."""
    return int(np.packbits(where, bitorder="little")[0])


@revised
def on_stack(count: int) -> Array:
    """Room for a constant count of numbers, shape (count,), until the kernel that asks returns.

    It costs nothing, and a kernel that makes no other arrays may be one that does not allocate.
    """
    return np.empty(count)


def vector_pointer(context: Any, builder: Any, kind: Any, array: Any, at: Any) -> Any:
    """A pointer to the vector that begins at an index, which nothing checks."""
    data = context.make_array(kind)(context, builder, array).data
    return builder.bitcast(builder.gep(data, [at]), VECTOR.as_pointer())


@intrinsic  # type: ignore[untyped-decorator]
def _load(context: Any, array: Any, at: Any) -> Any:
    def emit(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        value = builder.load(vector_pointer(context, builder, signature.args[0], *values))
        value.align = ALIGNMENT
        return value

    return _vector(array, types.intp), emit


@intrinsic  # type: ignore[untyped-decorator]
def _store(context: Any, array: Any, at: Any, value: Any) -> Any:
    def emit(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        place = vector_pointer(context, builder, signature.args[0], values[0], values[1])
        widened = _widened(context, builder, signature.args[2], values[2])
        builder.store(widened, place).align = ALIGNMENT
        return context.get_dummy_value()

    return types.void(array, types.intp, value), emit


@intrinsic  # type: ignore[untyped-decorator]
def _fill(context: Any, value: Any) -> Any:
    def emit(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        return _widened(context, builder, signature.args[0], values[0])

    return _vector(value), emit


@intrinsic  # type: ignore[untyped-decorator]
def _choose(context: Any, where: Any, a: Any, b: Any) -> Any:
    def emit(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        pair = zip(signature.args[1:], values[1:], strict=True)
        return builder.select(values[0], *(_widened(context, builder, *one) for one in pair))

    return _vector(where, a, b), emit


@intrinsic  # type: ignore[untyped-decorator]
def _bits(context: Any, where: Any) -> Any:
    def emit(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        byte = builder.bitcast(values[0], ir.IntType(LANES))
        return builder.zext(byte, ir.IntType(64))

    return types.int64(where), emit


@intrinsic  # type: ignore[untyped-decorator]
def _floor(context: Any, value: Any) -> Any:
    def emit(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        return _library("floor")(builder, values[0])

    return _vector(value), emit


@intrinsic  # type: ignore[untyped-decorator]
def _first(context: Any, array: Any) -> Any:
    def emit(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        given = context.make_array(signature.args[0])(context, builder, values[0])
        last = builder.sub(cgutils.unpack_tuple(builder, given.shape)[0], _whole(1))
        vector = ir.Constant(VECTOR, ir.Undefined)
        for number in range(LANES):
            inside = builder.icmp_signed("<", _whole(number), last)
            at = builder.select(inside, _whole(number), last)
            value = builder.load(builder.gep(given.data, [at]))
            vector = builder.insert_element(vector, value, ir.Constant(ir.IntType(32), number))
        return vector

    return _vector(array), emit


def _whole(number: int) -> Any:
    return ir.Constant(ir.IntType(64), number)


@intrinsic  # type: ignore[untyped-decorator]
def _lane(context: Any, value: Any, number: Any) -> Any:
    def emit(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        return builder.extract_element(*values)

    return types.float64(value, types.int64), emit


# By type and not by overload, which must not answer an array where nothing allocates.
@type_callable(on_stack)  # type: ignore[untyped-decorator]
def _on_stack_typed(context: Any) -> Any:
    return lambda count: _NUMBERS if isinstance(count, types.IntegerLiteral) else None


@lower_builtin(on_stack, types.IntegerLiteral)  # type: ignore[untyped-decorator]
def _on_stack_compiled(context: Any, builder: Any, signature: Any, values: Any) -> Any:
    array = context.make_array(_NUMBERS)(context, builder)
    eight, count = _whole(8), _whole(signature.args[0].literal_value)
    room = cgutils.alloca_once(builder, ir.DoubleType(), size=count)
    room.align = 8 * LANES  # so that no vector lies in two cache lines
    parts = {"shape": (count,), "strides": (eight,), "itemsize": eight, "meminfo": None}
    context.populate_array(array, data=room, **parts)
    return array._getvalue()


@overload(floor, strict=False)  # type: ignore[untyped-decorator]
def _floor_compiled(value: Any) -> Any:
    if value == _vector:
        return lambda value: _floor(value)
    return lambda value: np.floor(value)


@overload(first, strict=False)  # type: ignore[untyped-decorator]
def _first_compiled(array: Any) -> Any:
    return lambda array: _first(array)


@overload(lane, strict=False)  # type: ignore[untyped-decorator]
def _lane_compiled(value: Any, number: Any) -> Any:
    return lambda value, number: _lane(value, number)


@overload(load, strict=False)  # type: ignore[untyped-decorator]
def _load_compiled(array: Any, at: Any) -> Any:
    return lambda array, at: _load(array, at)


@overload(store, strict=False)  # type: ignore[untyped-decorator]
def _store_compiled(array: Any, at: Any, value: Any) -> Any:
    return lambda array, at, value: _store(array, at, value)


@overload(fill, strict=False)  # type: ignore[untyped-decorator]
def _fill_compiled(value: Any) -> Any:
    return lambda value: _fill(value)


@overload(choose, strict=False)  # type: ignore[untyped-decorator]
def _choose_compiled(where: Any, a: Any, b: Any) -> Any:
    if where == _conditions:
        return lambda where, a, b: _choose(where, a, b)
    return lambda where, a, b: a if where else b


@overload(anywhere, strict=False)  # type: ignore[untyped-decorator]
def _anywhere_compiled(where: Any) -> Any:
    if where == _conditions:
        return lambda where: _bits(where) != 0
    return lambda where: where


@overload(bits, strict=False)  # type: ignore[untyped-decorator]
def _bits_compiled(where: Any) -> Any:
    return lambda where: _bits(where)
