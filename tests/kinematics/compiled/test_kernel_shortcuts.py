"""Shorter ways through numba's compiler; the tests of builds hold that they change no byte."""

import operator

import llvmlite.binding as llvm
import pytest
from llvmlite import ir
from numba import types
from numba.core import compiler, errors
from numba.core.registry import cpu_target

from kinematics.compiled.kernel_shortcuts import forget, take_shortcuts

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
