"""Machine code as numba's compiler hands it on: made in parts, linked, and called or copied."""

import contextlib
import itertools
from collections.abc import Iterable, Iterator
from functools import cache
from typing import Any

import llvmlite.binding as llvm
from numba.core.codegen import JITCodeLibrary
from numba.core.runtime import rtsys

#: Globals through which compiled functions reach Python objects.
_ENVIRONMENT = "_ZN08NumbaEnv"
_RUNTIME = "NRT_"
_UNRESOLVED = ".numba.unresolved$"


class Part(JITCodeLibrary):
    """Code that is linked into kernels and never runs by itself, so that none is emitted for it."""

    def finalize(self) -> None:
        """Link and optimise the parts of this library."""
        self._raise_if_finalized()
        _link(self)
        self._optimize_final_module()
        self._finalize_dynamic_globals()
        self._finalized = True

    def _optimize_functions(self, ll_module: Any) -> None:
        # As numba does, but for functions that have no body here: passes are set up for each one.
        ll_module.data_layout = self._codegen._data_layout
        for function in ll_module.functions:
            if not function.is_declaration:
                passes, builder = self._codegen._function_pass_manager()
                passes.run(function, builder)

    def get_pointer_to_function(self, name: str) -> int:  # noqa: ARG002  numba's signature
        """No address: nothing calls a part from outside."""
        self._ensure_finalized()
        return 0

    @property
    def codegen(self) -> Any:
        """Numba's generator, which can't be asked to set globals that are not loaded."""
        return _Unloaded(self._codegen)


class _Unloaded:
    """A code generator that knows of no loaded environments."""

    def __init__(self, codegen: Any) -> None:
        self._codegen = codegen

    def __getattr__(self, name: str) -> Any:
        return getattr(self._codegen, name)

    def set_env(self, name: str, environment: Any) -> None:
        """No operation: kernels set the environments of what they contain."""


class Whole(Part):
    """The code of one kernel with all that is copied into it."""

    def finalize(self) -> None:
        """Link, optimise and check; the code is not loaded by this."""
        self._raise_if_finalized()
        _link(self)
        for one in self._final_module.global_variables:
            # Numba's "common" ones stay even if nothing refers to them.
            if one.name.startswith(_ENVIRONMENT):
                one.linkage = "linkonce_odr"
        self._optimize_final_module()
        self._final_module.verify()
        self._finalize_dynamic_globals()
        self._finalized = True

    def machine_code(self) -> bytes:
        """The code as an object file."""
        self._ensure_finalized()
        return bytes(self._codegen._tm.emit_object(self._final_module))

    def bitcode(self) -> bytes:
        """The code in a form that can be copied into other kernels."""
        return bytes(self._get_module_for_linking().as_bitcode())

    def larger_than(self, limit: int, symbol: str) -> bool:
        """Whether all functions have more instructions together than that, and than arguments.

        A tuple of arrays is handed over number by number, which can cost more than what is done
        with them.
        """
        limit += sum(1 for _ in self._final_module.get_function(symbol).arguments)
        every = (
            instruction
            for function in self._final_module.functions
            for block in function.blocks
            for instruction in block.instructions
        )
        return sum(1 for _ in itertools.islice(every, limit + 1)) > limit

    def called(self) -> list[str]:
        """Names of functions that it calls and does not contain."""
        return [one.name for one in self._final_module.functions if one.is_declaration]

    def environments(self) -> list[str]:
        """Names of the environments that it reads."""
        names = [one.name for one in self._final_module.global_variables]
        return [name for name in names if name.startswith(_ENVIRONMENT)]

    def recurses(self) -> bool:
        """Whether two kernels call each other, in which case numba leaves an address open."""
        names = (one.name for one in self._final_module.global_variables)
        return any(name.startswith(_UNRESOLVED) for name in names)


class Door(Whole):
    """The code that Python calls: it takes objects apart and calls, which little makes faster.

    A small kernel that is copied into its door is optimised with it, as in any caller, and takes
    only the arguments that it reads: nobody else calls this copy. A shape and two addresses too
    many for each array cost a single pose 6 of 100 ns, since they are read back in vectors before
    the numbers that they consist of have arrived in the cache.

    Args:
        codegen: Numba's generator.
        name: The library's name.
        symbol: Symbol of the function that Python calls.
        plain: Compile it with little effort, unless it holds a kernel.
    """

    def __init__(self, codegen: Any, name: str, symbol: str, plain: bool) -> None:
        super().__init__(codegen, name)
        self._symbol, self._plain = symbol, plain

    def _optimize_functions(self, ll_module: Any) -> None:
        if not self._plain:
            super()._optimize_functions(ll_module)
            return
        ll_module.data_layout = self._codegen._data_layout
        for function in ll_module.functions:
            if not function.is_declaration:
                passes, builder = self._codegen._function_pass_manager(opt=1)
                passes.run(function, builder)

    def _optimize_final_module(self) -> None:
        if not self._holds_a_kernel():
            if not self._plain:
                super()._optimize_final_module()
            return
        for function in self._final_module.functions:
            if not function.is_declaration and function.name != self._symbol:
                # Not "internal": LLVM's loader would take such a copy for the kernel in other code.
                function.linkage = "private"
        super()._optimize_final_module()

    def machine_code(self) -> bytes:
        """The code as an object file, written with little effort if it is plain."""
        if self._holds_a_kernel() or not self._plain:
            return super().machine_code()
        self._ensure_finalized()
        return bytes(_plain_machine(self._codegen).emit_object(self._final_module))

    def _holds_a_kernel(self) -> bool:
        return any(isinstance(one, Copied) for one in self._linking_libraries)


@cache
def _plain_machine(codegen: Any) -> Any:
    """LLVM's writer of machine code for the same processor, at the level above its lowest."""
    options: dict[str, Any] = {}
    codegen._customize_tm_options(options)
    target = llvm.Target.from_triple(llvm.get_process_triple())
    return target.create_target_machine(**options, opt=1)


class Copied:
    """A small kernel as its callers link it."""

    def __init__(self, bitcode: bytes) -> None:
        self._bitcode = bitcode
        self._module: Any = None
        self._reload_init: set[Any] = set()

    def _ensure_finalized(self) -> None:
        """No operation: code is always final."""

    def _get_module_for_linking(self) -> Any:
        if self._module is None:
            self._module = llvm.parse_bitcode(self._bitcode)
        return self._module


def _link(library: Any) -> None:
    """Link what a library depends on; numba's runtime only where it is called."""
    module = library._final_module
    for other in dict.fromkeys(library._linking_libraries):
        if other is not rtsys.library:
            module.link_in(other._get_module_for_linking(), preserve=True)
    if any(one.name.startswith(_RUNTIME) and one.is_declaration for one in module.functions):
        module.link_in(rtsys.library._get_module_for_linking(), preserve=True)


@contextlib.contextmanager
def parts_only(codegen: Any) -> Iterator[None]:
    """Have numba make parts of all that it compiles on the way."""
    before = codegen._library_class
    codegen._library_class = Part
    try:
        yield
    finally:
        codegen._library_class = before


def load(codegen: Any, machine_codes: Iterable[bytes]) -> None:
    """Load object files; all that they call must be among them, or have been loaded before."""
    engine = codegen._engine._ee
    for machine_code in machine_codes:
        engine.add_object_file(llvm.ObjectFileRef.from_data(machine_code))
    engine.finalize_object()
