"""Shorter ways through numba's compiler; the tests of builds hold that they change no byte."""

import operator
from collections.abc import Callable

import llvmlite.binding as llvm
import numpy as np
import pytest
from llvmlite import ir
from numba import types
from numba.core import compiler, errors
from numba.core.registry import cpu_target
from numba.extending import overload

from compiled.kernel import kernel
from compiled.shortcuts import forget, take_shortcuts
from kinematics.arrays import Array

take_shortcuts()


def module_of_names() -> ir.Module:
    """A function whose names, flags and metadata are all that text can hold."""
    module = ir.Module("module")
    kind = ir.FunctionType(ir.DoubleType(), [ir.DoubleType()] * 2)
    function = ir.Function(module, kind, "function")
    builder = ir.IRBuilder(function.append_basic_block('a "quoted" \\ name'))
    first, second = function.args
    total = builder.fadd(first, second, name='x"\\y', flags=("contract", "nnan"))
    total.set_metadata("note", module.add_metadata([ir.MetaDataString(module, "text")]))
    builder.ret(builder.fmul(total, ir.Constant(ir.DoubleType(), 2.0)))
    return module


def test_text_is_read_by_llvm_with_names_flags_and_metadata() -> None:
    text = str(module_of_names())
    assert '%"x\\22\\5cy" = fadd contract nnan double %".1", %".2", !note !0' in text
    parsed = llvm.parse_assembly(text)
    parsed.verify()
    block = next(iter(parsed.get_function("function").blocks))
    assert [one.opcode for one in block.instructions] == ["fadd", "fmul", "ret"]
    assert next(iter(block.instructions)).name == 'x"\\y'


def test_a_module_that_is_forgotten_holds_no_instructions() -> None:
    module = module_of_names()
    blocks = list(module.functions[0].blocks)
    forget(module)
    assert not module.functions[0].blocks
    assert not blocks[0].instructions


@pytest.mark.parametrize(
    ("kinds", "answer"),
    [
        ((types.int64, types.float64), types.float64),
        ((types.int64, types.int64), types.int64),
        ((types.float64[::1], types.int64), types.float64[::1]),
    ],
)
def test_a_call_is_resolved_once_for_types(kinds: tuple[types.Type], answer: types.Type) -> None:
    context = cpu_target.typing_context
    context.refresh()
    add = context.resolve_value_type(operator.add)
    first = add.get_call_type(context, kinds, {})
    assert first.return_type == answer
    assert add.get_call_type(context, kinds, {}) is first


def test_a_call_that_is_none_is_refused_each_time() -> None:
    context = cpu_target.typing_context
    context.refresh()
    add = context.resolve_value_type(operator.add)
    for _ in range(2):
        with pytest.raises(errors.TypingError):
            add.get_call_type(context, (types.none, types.float64), {})


def test_variables_at_entries_are_worked_out_when_asked_for() -> None:
    def branch(x: float) -> float:
        y = 2.0 * x
        if y > 1.0:
            return y
        return -y

    function = compiler.run_frontend(branch)
    assert not function.block_entry_vars
    alive = [function.get_block_entry_vars(block) for _, block in sorted(function.blocks.items())]
    assert len(alive) == 3
    assert not alive[0]
    assert all("y" in one for one in alive[1:])


def test_declarations_that_are_made_later_are_found() -> None:
    def twice(x: float) -> float:
        return 2.0 * x

    context = cpu_target.target_context
    context.refresh()
    with pytest.raises(ValueError, match="Cannot determine Numba type"):
        context.typing_context.resolve_value_type(twice)

    @overload(twice, strict=False)  # type: ignore[untyped-decorator]
    def _declared(x: types.Type) -> Callable[[float], float]:
        return lambda x: x + x

    context.refresh()
    found = context.typing_context.resolve_value_type(twice)
    signature = found.get_call_type(context.typing_context, (types.float64,), {})
    assert signature.return_type == types.float64


@kernel
def put(values: Array, rows: Array) -> None:
    """Assign rows to the first ones of values."""
    values[:2] = rows


@pytest.mark.usefixtures("_nothing_kept")
def test_a_slice_takes_arrays_of_its_shape_and_of_fewer_dimensions_only() -> None:
    values = np.zeros((3, 2))
    put(values, np.array([[1.0, 2.0], [3.0, 4.0]]))
    np.testing.assert_array_equal(values, [[1.0, 2.0], [3.0, 4.0], [0.0, 0.0]])
    put(values, np.array([5.0, 6.0]))
    np.testing.assert_array_equal(values, [[5.0, 6.0], [5.0, 6.0], [0.0, 0.0]])
    for wrong in (np.ones((3, 2)), np.ones(3)):
        with pytest.raises(ValueError, match="assigned to a slice of another shape"):
            put(values, wrong)
    np.testing.assert_array_equal(values, [[5.0, 6.0], [5.0, 6.0], [0.0, 0.0]])
