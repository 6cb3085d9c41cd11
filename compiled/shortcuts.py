"""Shorter ways through numba's compiler that end at the same machine code.

Half of the time that kernels take to compile is numba's own Python. What is left out here is worked
out by numba again and again with one result, or never read. None of it changes a byte of what is
kept, but for the text of one error; a test compiles with and without and compares. Numba's
functions are replaced for the whole process, so each one does all that numba's did, for anybody
else's functions too.
"""

from functools import cache
from typing import Any

from llvmlite import ir as text
from numba import types
from numba.core import analysis, base, postproc, transforms, typing
from numba.core.types.functions import BaseFunction
from numba.extending import intrinsic
from numba.np import arrayobj

#: Types of arguments that say by themselves what a function of them answers.
_PLAIN = (
    types.Number,
    types.Boolean,
    types.Array,
    types.BaseTuple,
    types.NoneType,
    types.SliceType,
)


@cache
def take_shortcuts() -> None:
    """Have numba take the shorter ways from now on in this process."""
    _compute_variables_at_entries_when_read()
    _resolve_calls_once()
    _write_text_faster()
    _refresh_for_news(base.BaseContext)
    _refresh_for_news(typing.BaseContext)
    _refuse_shapes_briefly()


class _AtEntries(dict[Any, Any]):
    """The variables that are alive where each block of a function begins, once one is asked for."""

    def __init__(self, function: Any) -> None:
        super().__init__()
        self._function = function

    def __missing__(self, block: Any) -> Any:
        blocks, lifetime = self._function.blocks, self._function.variable_lifetime
        alive = analysis.compute_live_variables(
            lifetime.cfg, blocks, lifetime.usedefs.defmap, lifetime.deadmaps.combined
        )
        self.update({one: alive[offset] for offset, one in blocks.items()})
        return super().__getitem__(block)


def _compute_variables_at_entries_when_read() -> None:
    """Numba does so after each of a dozen passes; only generators and Python objects need it."""
    whole = postproc.PostProcessor.run

    def run(self: Any, emit_dels: bool = False, extend_lifetimes: bool = False) -> None:
        function = self.func_ir
        if function.is_generator:
            whole(self, emit_dels, extend_lifetimes)
            return
        function.blocks = transforms.canonicalize_cfg(function.blocks)
        function.variable_lifetime = postproc.VariableLifetime(function.blocks)
        function.block_entry_vars = _AtEntries(function)
        function.generator_info = None
        if emit_dels:
            self._insert_var_dels(extend_lifetimes=extend_lifetimes)

    postproc.PostProcessor.run = run


def _resolve_calls_once() -> None:
    """Remember the signatures of operators and built-in functions for types of arguments.

    To find that of a sum of two numbers, numba goes through a dozen candidates, writes for each one
    that fails why it does, and forgets the answer. Functions that numba compiles for a call
    (overloads) are left to it: which one is taken hangs on more than types.
    """
    find = BaseFunction.get_call_type
    known: dict[int, tuple[Any, dict[Any, Any]]] = {}

    def get_call_type(self: Any, context: Any, args: Any, kws: Any) -> Any:
        if kws or not all(isinstance(kind, _PLAIN) for kind in args):
            return find(self, context, args, kws)
        # By identity, which the function, being held, does not share with a later one.
        _, answers = known.get(id(self)) or known.setdefault(id(self), (self, {}))
        key = (context, *args)
        signature = answers.get(key)
        if signature is None:
            signature = find(self, context, args, kws)
            if self.get_impl_key(signature) is self.typing_key:
                answers[key] = signature
        return signature

    BaseFunction.get_call_type = get_call_type  # type: ignore[method-assign]


def _write_text_faster() -> None:
    """The text that LLVM reads, from fewer intermediate texts."""

    def reference(self: Any) -> str:
        name = self._name
        if "\\" in name or '"' in name:
            name = name.replace("\\", "\\5c").replace('"', "\\22")
        return f'{self.name_prefix}"{name}"'

    def describe(self: Any, parts: list[str]) -> None:
        operands = ", ".join([one.get_reference() for one in self.operands])
        name = " ".join([self.opname, *self.flags]) if self.flags else self.opname
        metadata = self._stringify_metadata(leading_comma=True) if self.metadata else ""
        parts.append(f"{name} {self.type} {operands}{metadata}\n")

    text.NamedValue._get_reference = reference
    text.Instruction.descr = describe


def _refresh_for_news(kind: Any) -> None:
    """Look through numba's lists of declarations only when one of them has grown.

    Numba does so for each operation that it has no code for yet, and for each function.
    """
    whole = kind.refresh
    known: dict[int, tuple[Any, int]] = {}

    def refresh(self: Any) -> None:
        # Held, and so by identity; copies of a context share it.
        registries = self._registries
        # Before the lists are read, as reading may make them grow.
        length = _length(self)
        if known.get(id(registries)) != (registries, length):
            whole(self)
            known[id(registries)] = (registries, length)

    kind.refresh = refresh


def _length(context: Any) -> int:
    """How many declarations there are in all lists that a context knows of."""
    own = sum(
        len(getattr(registry, name))
        for registry, loader in context._registries.items()
        for name in loader.registry_items
    )
    typing_context = getattr(context, "typing_context", None)
    return own if typing_context is None else own + _length(typing_context)


def _refuse_shapes_briefly() -> None:
    """Raise an error without shapes where an array is assigned to a slice of another shape.

    To say them, numba compiles lists and texts into every kernel that assigns to a slice, which
    is more than many of these do.
    """

    @intrinsic  # type: ignore[untyped-decorator]
    def refuse(typing_context: Any, source: Any, target: Any) -> Any:  # noqa: ARG001
        def write(context: Any, builder: Any, signature: Any, args: Any) -> Any:  # noqa: ARG001
            message = "an array is assigned to a slice of another shape"
            context.call_conv.return_user_exc(builder, ValueError, (message,))
            return context.get_dummy_value()

        return types.none(source, target), write

    arrayobj.raise_with_shape_context = refuse


def forget(module: Any) -> None:
    """Take a module apart whose text was written.

    Its instructions hold each other in circles, a hundred thousand in a large kernel, which would
    wait for the garbage collector and make up three quarters of its work.
    """
    for function in module.functions:
        for block in function.blocks:
            block.instructions.clear()
            block.terminator = None
        function.blocks.clear()
