"""Transposition of eight vectors: numbers of eight configurations from memory into lanes and back.

An array of m configurations holds the numbers of each side by side; a vector holds one number of
each of eight configurations. Copied number by number, a batch of Jacobians would spend a third of
its time between the two, and the vectors that LLVM makes of such a loop depend on the processor.
"""

from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic, overload

from compiled.arrays import Array
from compiled.kernel import kernel
from compiled.simd import (
    ALIGNMENT,
    LANES,
    TYPES,
    VECTOR,
    Lanes,
    load,
    revised,
    store,
    vector_pointer,
)

Eight = tuple[Lanes, Lanes, Lanes, Lanes, Lanes, Lanes, Lanes, Lanes]
#: Least length of rows of which one may be read to eight numbers without passing the end of all.
_SHORTEST_ROW = 4
#: Size of a number [bytes].
_NUMBER_SIZE = 8
_INDEX = ir.IntType(32)
_vector: Any = TYPES["vector"]
_EIGHT = types.UniTuple(_vector, LANES)


@revised
def transpose(rows: Eight) -> Eight:
    """Columns of eight vectors: lane i of vector k becomes lane k of vector i."""
    return tuple(np.transpose(rows))


@revised
def load_few(array: Array, at: int, count: int) -> Lanes:
    """The ``count`` <= 8 numbers of a contiguous array (k,) from ``at`` on; 0 in lanes beyond."""
    few = np.zeros(LANES)
    few[:count] = array[at : at + count]
    return few  # type: ignore[return-value]


@kernel
def aligned_kernel(count: int) -> Array:
    """Room for ``count`` numbers that begins at a cache line, so that no vector lies in two.

    Arrays begin at half a line every second time, which made a process a quarter slower by chance.
    """
    room = np.empty(count + LANES)
    skip = (-(room.ctypes.data // _NUMBER_SIZE)) % LANES
    return room[skip : skip + count]


@kernel(allocates=False)
def gather_kernel(q: Array, lanes: Array) -> None:
    """Lay contiguous q (LANES, n) out by joints, into lanes (n * LANES,)."""
    n = q.shape[1]
    numbers = q.reshape(q.size)
    if n < _SHORTEST_ROW:
        for lane in range(LANES):
            for j in range(n):
                lanes[j * LANES + lane] = q[lane, j]
    elif n < LANES:
        # Rows are read with the first numbers of the next one, of which nothing is written.
        c0, c1, c2, c3, c4, c5, c6, _ = transpose((
            load(numbers, 0), load(numbers, n), load(numbers, 2 * n), load(numbers, 3 * n),
            load(numbers, 4 * n), load(numbers, 5 * n), load(numbers, 6 * n),
            load_few(numbers, 7 * n, n),
        ))  # fmt: skip
        store_rows_kernel(lanes, 0, LANES, (c0, c1, c2, c3))
        if n > 4:
            store(lanes, 4 * LANES, c4)
        if n > 5:
            store(lanes, 5 * LANES, c5)
        if n > 6:
            store(lanes, 6 * LANES, c6)
    else:
        for block in range(0, n, LANES):
            # The last block overlaps the one before it.
            at = min(block, n - LANES)
            columns = transpose(load_rows_kernel(numbers, at, n))
            store_rows_kernel(lanes, at * LANES, LANES, columns)


@kernel(allocates=False)
def scatter_kernel(lanes: Array, rows: Array) -> None:
    """Write vectors (k * LANES,) into rows (LANES * k,): what lane i of each holds into row i."""
    count = lanes.shape[0] // LANES
    if count < LANES:
        for lane in range(LANES):
            for k in range(count):
                rows[lane * count + k] = lanes[k * LANES + lane]
        return
    for block in range(0, count, LANES):
        at = min(block, count - LANES)
        columns = transpose(load_rows_kernel(lanes, at * LANES, LANES))
        store_rows_kernel(rows, at, count, columns)


@kernel(inline="code")
def load_rows_kernel(array: Array, at: int, stride: int) -> Eight:
    """Eight vectors of a contiguous array (k,), ``stride`` numbers apart."""
    return (
        load(array, at), load(array, at + stride),
        load(array, at + 2 * stride), load(array, at + 3 * stride),
        load(array, at + 4 * stride), load(array, at + 5 * stride),
        load(array, at + 6 * stride), load(array, at + 7 * stride),
    )  # fmt: skip


@kernel(inline="code")
def store_rows_kernel(array: Array, at: int, stride: int, rows: tuple[Lanes, ...]) -> None:
    """Write vectors into a contiguous array (k,), ``stride`` numbers apart."""
    for row in rows:
        store(array, at, row)
        at += stride


def _exchanged(builder: Any, vectors: list[Any], width: int) -> list[Any]:
    """One stage of the transposition: vectors ``width`` apart exchange blocks of ``width`` lanes.

    Stages of widths 1, 2 and 4 are the whole of it. Width 1 stays within 16 bytes and width 2
    within 32, which is what shuffles of one instruction do; width 4 costs nothing where a vector
    is two registers.
    """
    out = list(vectors)
    low = [lane if lane & width == 0 else LANES + lane - width for lane in range(LANES)]
    high = [lane + width if lane & width == 0 else LANES + lane for lane in range(LANES)]
    for k in (one for one in range(LANES) if one & width == 0):
        a, b = vectors[k], vectors[k + width]
        out[k] = builder.shuffle_vector(a, b, _lanes_of(low))
        out[k + width] = builder.shuffle_vector(a, b, _lanes_of(high))
    return out


def _lanes_of(numbers: list[int]) -> Any:
    return ir.Constant(ir.VectorType(_INDEX, LANES), numbers)


@intrinsic  # type: ignore[untyped-decorator]
def _transpose(context: Any, rows: Any) -> Any:
    def emit(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        vectors = cgutils.unpack_tuple(builder, values[0])
        for width in (1, 2, 4):
            vectors = _exchanged(builder, vectors, width)
        return context.make_tuple(builder, signature.return_type, vectors)

    return _EIGHT(_EIGHT), emit


@intrinsic  # type: ignore[untyped-decorator]
def _load_few(context: Any, array: Any, at: Any, count: Any) -> Any:
    mask = ir.VectorType(ir.IntType(1), LANES)
    wide = ir.VectorType(ir.IntType(64), LANES)

    def emit(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        place = vector_pointer(context, builder, signature.args[0], values[0], values[1])
        first = builder.insert_element(
            ir.Constant(wide, ir.Undefined), values[2], ir.Constant(_INDEX, 0)
        )
        counts = builder.shuffle_vector(first, first, _lanes_of([0] * LANES))
        inside = builder.icmp_signed("<", ir.Constant(wide, list(range(LANES))), counts)
        kind = ir.FunctionType(VECTOR, [place.type, _INDEX, mask, VECTOR])
        masked = cgutils.get_or_insert_function(
            builder.module, kind, f"llvm.masked.load.v{LANES}f64.p0"
        )
        nothing = ir.Constant(VECTOR, [0.0] * LANES)
        return builder.call(masked, [place, ir.Constant(_INDEX, ALIGNMENT), inside, nothing])

    return _vector(array, types.intp, types.intp), emit


@overload(transpose, strict=False)  # type: ignore[untyped-decorator]
def _transpose_compiled(rows: Any) -> Any:
    return lambda rows: _transpose(rows)


@overload(load_few, strict=False)  # type: ignore[untyped-decorator]
def _load_few_compiled(array: Any, at: Any, count: Any) -> Any:
    return lambda array, at, count: _load_few(array, at, count)
