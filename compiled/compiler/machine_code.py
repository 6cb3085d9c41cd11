"""Machine code of kernels: compiled or read from disk, and loaded with all that it calls."""

import copy
import io
import pickle
from dataclasses import dataclass
from functools import cache
from typing import Any

from numba import _dynfunc, types
from numba.core import compiler
from numba.core.bytecode import FunctionIdentity
from numba.core.environment import Environment, lookup_environment
from numba.core.registry import cpu_target
from numba.core.runtime import rtsys
from numba.core.serialize import NumbaPickler
from numba.core.targetconfig import ConfigStack
from numba.core.untyped_passes import ExtractByteCode

from compiled import writes
from compiled.compiler import library as kernel_library
from compiled.compiler import store
from compiled.compiler import symbol as kernel_symbol
from compiled.compiler.library import Copied, Door, Whole
from compiled.compiler.store import loads
from compiled.writes import Use

#: Instructions of machine code beyond which a kernel is called and not copied into its callers.
LARGE = 150
_NONE = Use(frozenset(), frozenset())


@dataclass(frozen=True)
class Code:
    """One kernel for one signature, or the door by which Python calls one.

    Attributes:
        name: what it is kept under; a digest of all that it is made from is part of it.
        symbol: of its function.
        use: what it may do with its arguments.
        needs: names of the kernels that it calls, which must be loaded before it is.
        machine_code: an object file; nothing for a small kernel, which only stands in callers.
        bitcode: a small kernel in a form that can be copied into callers, and into its door.
        facts: pickled numba descriptions: of the function, its signature and its environments.
        lasting: whether it may be kept on disk; not if it holds addresses of this process.
    """

    name: str
    symbol: str
    use: Use
    needs: tuple[str, ...]
    machine_code: bytes
    bitcode: bytes | None
    environments: bytes
    facts: bytes
    lasting: bool = True

    def pickled(self) -> bytes:
        """The code as bytes for a file."""
        return pickle.dumps(tuple(vars(self).values())[1:-1], protocol=5)

    @classmethod
    def unpickled(cls, name: str, content: bytes) -> "Code":
        """The code of a name from the bytes of its file."""
        return cls(name, *loads(content))


#: Every kernel that was compiled or read in this process, and the kernels' symbols.
_codes: dict[str, Code] = {}
_owners: dict[str, str] = {}
#: Names of what is loaded.
_loaded: set[str] = set()


def find(name: str) -> Code | None:
    """The code of a name from this process or from disk, if all that it calls is there as well."""
    if name not in _codes:
        content = store.read(name)
        if content is None:
            return None
        try:
            code = Code.unpickled(name, content)
        except Exception:  # noqa: BLE001  kept by a version with other types: compiled anew
            return None
        if any(find(need) is None for need in code.needs):
            return None
        _note(code)
    return _codes[name]


def keep(code: Code) -> Code:
    """Remember code that was just compiled, here and on disk."""
    _note(code)
    if code.lasting and all(_codes[need].lasting for need in code.needs):
        store.write(code.name, code.pickled())
    return code


def _note(code: Code) -> None:
    _codes[code.name] = code
    _owners[code.symbol] = code.name


@cache
def copied(name: str) -> Copied:
    """A small kernel, for linking into its callers."""
    _environments(name)  # which callers find by their names
    return Copied(_codes[name].bitcode or b"")


def compiled(name: str, function: Any, kinds: Any, flags: Any, small: bool) -> Code:
    """Compile a kernel for types of arguments."""
    library = Whole(_codegen(), name)
    context = cpu_target.target_context
    pipeline = _Kernel(cpu_target.typing_context, context, library, kinds, None, flags, {})
    pipeline.name = name
    with kernel_library.parts_only(_codegen()):
        result = pipeline.compile_extra(function)
    library._ensure_finalized()
    if library.recurses():
        raise NotImplementedError(f"{function.__qualname__} calls itself by way of another kernel")
    fndesc = result.fndesc
    use = writes.use(pipeline.state.func_ir, fndesc.typemap, fndesc.calltypes)
    fndesc.typemap = fndesc.calltypes = None
    fndesc.doc = ""
    symbol, facts = fndesc.llvm_func_name, (fndesc, result.signature)
    bitcode = library.bitcode() if small or not library.larger_than(LARGE, symbol) else None
    return _code(name, symbol, use, library, bitcode, facts)


def door(name: str, kernel: str, fndesc: Any, flags: Any) -> Code:
    """Compile what takes Python's objects apart, calls a kernel and puts its answer together."""
    fndesc = copy.copy(fndesc)
    fndesc.env_name += "_door"
    environment = Environment.from_fndesc(fndesc)
    context = compiler._make_subtarget(cpu_target.target_context, flags)
    context = context.subtarget(environment=environment, fndesc=fndesc)
    symbol = fndesc.llvm_cpython_wrapper_name
    # Calls that are over so soon that the lock is kept notice a few nanoseconds.
    library = Door(_codegen(), name, symbol, plain=flags.release_gil)
    if _codes[kernel].bitcode is not None:
        library.add_linking_library(copied(kernel))
    with (
        ConfigStack().enter(flags),
        kernel_library.parts_only(_codegen()),
        context.push_code_library(library),
    ):
        context.create_cpython_wrapper(library, fndesc, environment, None, flags.release_gil)
    return _code(name, symbol, _NONE, library, None, fndesc)


def entry(code: Code) -> Any:
    """The function that Python calls, of a door."""
    load(code.name)
    fndesc = loads(code.facts)
    address = _codegen()._engine.get_function_address(code.symbol)
    environment = lookup_environment(fndesc.env_name) or Environment.from_fndesc(fndesc)
    return _dynfunc.make_function(
        fndesc.lookup_module(), fndesc.qualname.split(".")[-1], f"kernel {fndesc.qualname}",
        address, environment, (environment,),
    )  # fmt: skip


def load(*names: str) -> None:
    """Load code and all that it calls, at once: each load by itself costs as much again."""
    codes: dict[str, Code] = {}
    pending = list(names)
    while pending:
        name = pending.pop()
        if name not in _loaded and name not in codes:
            codes[name] = _codes[name]
            pending += codes[name].needs
    if not codes:
        return
    rtsys.initialize(cpu_target.target_context)
    # A small kernel has none: it stands in those that call it.
    machine_codes = [code.machine_code for code in codes.values() if code.machine_code]
    kernel_library.load(_codegen(), machine_codes)
    for name in codes:
        for environment in _environments(name):
            _codegen().set_env(environment.env_name, environment)
    _loaded.update(codes)


@cache
def _environments(name: str) -> Any:
    """The environments that code reads, which live as long as the process."""
    return loads(_codes[name].environments)


def _code(
    name: str,
    symbol: str,
    use: Use,
    library: Whole,
    bitcode: bytes | None,
    facts: Any,
) -> Code:
    needs = dict.fromkeys(_owners[one] for one in library.called() if one in _owners)
    environments = [lookup_environment(one) for one in library.environments()]
    used = _dumps([one for one in environments if one is not None])
    machine_code = library.machine_code() if bitcode is None else b""
    return Code(
        name, symbol, use, tuple(needs), machine_code, bitcode, used, _dumps(facts),
        not library.has_dynamic_globals,
    )  # fmt: skip


class _Pickler(NumbaPickler):
    """Numba's pickler, for types without the numbers that they have in this process only."""

    def reducer_override(self, one: Any) -> Any:
        """Parts of a value that it is made from again."""
        if isinstance(one, types.Type) and "_code" in vars(one):
            make, (reconstruct, given, state), *more = one.__reduce__()
            lasting = {name: value for name, value in state.items() if name != "_code"}
            return make, (reconstruct, given, lasting), *more
        return super().reducer_override(one)


def _dumps(value: Any) -> bytes:
    file = io.BytesIO()
    _Pickler(file, protocol=4).dump(value)
    return file.getvalue()


class _Kernel(compiler.Compiler):
    """Numba's compiler, for one kernel whose symbol says what it is made from."""

    name = ""

    def compile_extra(self, function: Any) -> Any:
        self.state.targetctx = self.state.targetctx.subtarget(
            mangler=kernel_symbol.mangled, get_abi_sizeof=_size
        )
        self.state.func_id = FunctionIdentity.from_function(function)
        kernel_symbol.rename(self.state.func_id, self.name)
        ExtractByteCode().run_pass(self.state)
        self.state.lifted, self.state.lifted_from = (), None
        return self._compile_bytecode()


@cache
def _size(kind: Any) -> int:
    """The size of a type of LLVM [bytes]; numba asks for each variable, by parsing a module."""
    return int(kind.get_abi_size(cpu_target.target_context.target_data))


@cache
def _codegen() -> Any:
    return cpu_target.target_context.codegen()
