"""A compiled function as Python and other kernels see it."""

import contextlib
import gc
import hashlib
import os
import sys
from collections.abc import Callable, Iterator
from functools import cache
from typing import Any

import llvmlite
import numba
from numba import types
from numba.core import compiler, config, errors, sigutils, typing
from numba.core.compiler_lock import global_compiler_lock
from numba.core.registry import CPUDispatcher
from numba.core.targetconfig import ConfigStack

from compiled.compiler import machine_code
from compiled.compiler.fingerprint import describe, settled_fingerprint
from compiled.compiler.machine_code import Code
from compiled.compiler.store import loads, plain
from compiled.compiler.symbol import name_by_content
from compiled.compiler.target import target
from compiled.writes import Use, writable


class Flags(compiler.Flags):
    """Settings whose values are compared at once; numba's compares them option by option."""

    __slots__ = ("_key",)
    _key: tuple[Any, ...]

    def __setattr__(self, name: str, value: object) -> None:
        super().__setattr__(name, value)
        super().__setattr__("_key", None)

    def __delattr__(self, name: str) -> None:
        super().__delattr__(name)
        super().__setattr__("_key", None)

    def discard(self, name: str) -> None:
        """Remove an option, which then has its default value."""
        super().discard(name)
        super().__setattr__("_key", None)

    def __hash__(self) -> int:
        return _HASH

    def __eq__(self, other: object) -> bool:
        if isinstance(other, Flags):
            return self is other or self.key() == other.key()
        return bool(super().__eq__(other))

    def key(self) -> tuple[Any, ...]:
        """The values of all options, in the order of the options."""
        if self._key is None:
            super().__setattr__("_key", tuple(self.values().values()))
        return self._key


#: Symbols hold the name of the class: code that was kept before has this one.
Flags.__name__ = "_Flags"
#: Of every object, as numba's own may be equal to it: keys hold types besides, which differ more.
_HASH = hash(compiler.Flags())


#: Count up with every change of how kernels are compiled that does not show in their functions.
_REVISION = 12
#: Count up with every change of how doors alone are made, for which no kernel is compiled again.
_DOOR_REVISION = 2

#: Set to 1, it forbids to compile: what is called must have been compiled before.
FROZEN = "ARMWRIGHT_KERNELS_FROZEN"
#: Characters of names that are no good in names of files.
_IN_NO_FILE = str.maketrans("", "", "<>/")


class Kernel(CPUDispatcher):
    """Numba's dispatcher; what it compiles is made from content-named parts.

    Kernels that call it get its code, and only Python's own call gets a door: a second function,
    compiled and kept by itself, that takes Python's objects apart.
    """

    def __init__(self, function: Any, options: dict[str, Any], *more: Any) -> None:
        target()
        name_by_content()
        super().__init__(function, *more, targetoptions=options)
        self._doors: dict[Any, Any] = {}
        self._choices: dict[Any, Any] = {}
        self._uses: dict[Any, Use] = {}

    def get_call_template(self, args: Any, kws: Any) -> Any:
        """The signature by which another kernel calls this one; literals are plain numbers."""
        pysig, folded = self._compiler.fold_argument_types(args, kws)
        kinds = self._settled(tuple(map(types.unliteral, folded)))
        template = typing.make_concrete_template(
            f"CallTemplate({self.py_func.__name__})",
            self.py_func.__name__,
            [self.overloads[kinds].signature],
        )
        return template, pysig, kinds, {}

    def compile(self, sig: Any) -> Any:
        """The function that Python calls for types of arguments."""
        given, _ = sigutils.normalize_signature(sig)
        with global_compiler_lock:
            if given not in self._doors:
                kinds = self._settled(given)
                if kinds not in self._doors:
                    self._open(kinds, machine_code.entry(self._door(self.overloads[kinds])))
                if given not in self._doors:
                    self._open(given, self._doors[kinds])
        return self._doors[given]

    def _open(self, kinds: Any, door: Any) -> None:
        """Have numba call ``door`` for types of arguments, without asking again."""
        self._doors[kinds] = door
        self._insert([kind._code for kind in kinds], door, False)

    def build(self, kinds: Any, door: bool) -> None:
        """Compile for types of arguments, and store the machine code, without loading it.

        Args:
            kinds: the types of the arguments, as they are; nothing is asked about constness.
            door: whether Python is going to call it.
        """
        with global_compiler_lock:
            result = self._overload(kinds)
            if door:
                self._door(result)

    def names(self, kinds: Any, door: bool) -> list[str]:
        """Names of its stored machine code, for types of its arguments."""
        name = self._name(kinds)
        return [name, self._door_name(name)] if door else [name]

    def use(self, kinds: Any) -> Use:
        """Use that this kernel makes of its arguments, for the types that it is compiled for."""
        return self._uses[kinds]

    @global_compiler_lock  # type: ignore[untyped-decorator]
    def _settled(self, given: Any) -> Any:
        """The types that the kernel is compiled for, instead of some that differ in constness only.

        Arrays that it never writes to and does not give back need not be known to be read-only.
        """
        if given not in self._choices:
            kinds = tuple(map(writable, given))
            if kinds == given or not self._leaves_alone(given, kinds):
                kinds = given
                self._overload(kinds)
            self._choices[given] = kinds
        return self._choices[given]

    def _leaves_alone(self, given: Any, kinds: Any) -> bool:
        try:
            self._overload(kinds)
        except errors.NumbaError:
            return False
        constant = {i for i, kind in enumerate(kinds) if kind != given[i]}
        return not constant & (self._uses[kinds].written | self._uses[kinds].given)

    def _door(self, result: Any) -> Code:
        kernel = result.entry_point.name
        name = self._door_name(kernel)
        code = machine_code.find(name)
        if code is None:
            _expect_none_missing(name, result.signature.args)
            self.targetctx.refresh()
            code = machine_code.keep(machine_code.door(name, kernel, result.fndesc, self._flags()))
        return code

    def _door_name(self, kernel: str) -> str:
        lock = "" if self.targetoptions["nogil"] else "-locked"
        return f"{kernel}.door{_DOOR_REVISION}{lock}"

    def _overload(self, kinds: Any) -> Any:
        if kinds not in self.overloads:
            with self._compiling_counter:
                self._add(kinds, self._code(kinds))
        return self.overloads[kinds]

    def _code(self, kinds: Any) -> Code:
        name = self._name(kinds)
        found = machine_code.find(name)
        if found is None and _before_first and not _is_frozen():
            _before_first.pop()()
            found = machine_code.find(name)
        (self._cache_misses if found is None else self._cache_hits)[kinds] += 1
        return found or machine_code.keep(self._compiled(name, kinds))

    def _compiled(self, name: str, kinds: Any) -> Code:
        _expect_none_missing(name, kinds)
        small = self.targetoptions["forceinline"]
        self.targetctx.refresh()  # what only compiling needs, which takes long to import
        with _uncollected():
            return machine_code.compiled(name, self.py_func, kinds, self._flags(), small)

    def _add(self, kinds: Any, code: Code) -> None:
        fndesc, signature = loads(code.facts)
        definition = Definition(code.name)
        self._uses[kinds] = code.use
        libraries = [] if code.bitcode is None else [machine_code.copied(code.name)]
        self.targetctx.insert_user_function(definition, fndesc, libraries)
        self.overloads[kinds] = compiler.compile_result(
            typing_context=self.typingctx, target_context=self.targetctx, signature=signature,
            fndesc=fndesc, entry_point=definition, objectmode=False, lifted=(), metadata=None,
        )  # fmt: skip

    def _flags(self) -> Any:
        flags = Flags()
        with ConfigStack().enter(compiler.Flags()):  # of the caller's, nothing is inherited
            self.targetdescr.options.parse_as_flags(flags, self.targetoptions)
        flags.no_compile = flags.no_cpython_wrapper = flags.no_cfunc_wrapper = True
        return flags

    def _name(self, kinds: Any) -> str:
        options = {name: value for name, value in self.targetoptions.items() if name != "nogil"}
        made_from = (
            settled_fingerprint(self.py_func),
            [describe(kind) for kind in kinds],
            sorted(options.items()),
            *_machinery(),
        )
        digest = hashlib.sha256(repr(made_from).encode()).hexdigest()[:32]
        name = f"{plain(self.py_func.__module__)}.{self.py_func.__qualname__}"
        return f"{name.translate(_IN_NO_FILE)[-100:]}-{digest}"


class KernelMissing(RuntimeError):
    """A kernel is needed that was not compiled beforehand, and compiling is forbidden here."""


#: Called once, before this process compiles its first kernel.
_before_first: list[Callable[[], object]] = []


def before_first(action: Callable[[], object]) -> None:
    """Have a function called once, before this process compiles its first kernel.

    Args:
        action: It may compile kernels in other processes, of which this one takes what it needs.
    """
    _before_first[:] = [action]


def _is_frozen() -> bool:
    return os.environ.get(FROZEN, "") not in ("", "0")


def _expect_none_missing(name: str, kinds: Any) -> None:
    if _is_frozen():
        kernel = name.rpartition("-")[0]
        signature = ", ".join(map(str, kinds))
        raise KernelMissing(
            f"{kernel} was not compiled for ({signature}) before, and {FROZEN} forbids to do it "
            "now. If a request calls it, `make kernel-list` adds it to the list of kernels."
        )


class Definition:
    """Stand-in by which numba knows one compiled signature of a kernel; it is never called."""

    def __init__(self, name: str) -> None:
        self.name = name


@contextlib.contextmanager
def _uncollected() -> Iterator[None]:
    """Look for no garbage meanwhile, which costs a compiler that makes many objects a fifth."""
    collects = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if collects:
            gc.enable()


@cache
def _machinery() -> tuple[Any, ...]:
    switches = (str(config.OPT), config.LOOP_VECTORIZE, config.SLP_VECTORIZE, config.BOUNDSCHECK)
    versions = (numba.__version__, llvmlite.__version__, sys.implementation.cache_tag)
    return (_REVISION, machine_code.LARGE, tuple(target()), versions, switches)
