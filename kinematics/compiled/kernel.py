"""The one door to numba: `kernel` marks a function that is compiled to machine code."""

import fcntl
import hashlib
import logging
import os
from collections.abc import Callable, Iterator
from enum import EnumType
from pathlib import Path
from types import CodeType, FunctionType, ModuleType
from typing import Any, Literal, TypeVar, cast, overload

import numba
import numpy as np
from numba.core.caching import FunctionCache
from numba.core.dispatcher import Dispatcher

_F = TypeVar("_F", bound=Callable[..., Any])
_log = logging.getLogger(__name__)


@overload
def kernel(function: _F, /) -> _F: ...
@overload
def kernel(
    *,
    fastmath: bool = False,
    inline: Literal["never", "always", "code"] = "never",
    allocates: bool = True,
    unlocks: bool = True,
) -> Callable[[_F], _F]: ...
def kernel(
    function: _F | None = None,
    /,
    *,
    fastmath: bool = False,
    inline: Literal["never", "always", "code"] = "never",
    allocates: bool = True,
    unlocks: bool = True,
) -> _F | Callable[[_F], _F]:
    """Compile a function with numba on its first call and keep the machine code on disk.

    Division follows IEEE 754 (x / 0 is inf or nan, never an exception) and the interpreter lock is
    released inside, unless asked otherwise. A type checker sees the signature of the function
    itself. The machine code is kept in NUMBA_CACHE_DIR if set, else beside the source, else (read-
    only source) in the user's cache folder; where none can be written it is compiled anew in each
    process.

    Args:
        function: the function to compile, when used without parentheses.
        fastmath: let LLVM reorder floating-point arithmetic; only where no verdict hangs on the
            last bits and NaN cannot occur.
        inline: "always" pastes the body into the kernels that call it, "code" its machine code:
            vectors that go in and out by way of memory can cost more than their arithmetic.
        allocates: False for a kernel that makes no array: numba then counts no references, which
            for a handful of arrays in tuples costs more than a small kernel does.
        unlocks: False for a kernel that Python calls and that is over sooner than the lock is given
            up and taken again.

    Returns:
        The compiled function, or a decorator when called with options.
    """

    def compiled(body: _F) -> _F:
        dispatcher = numba.njit(
            error_model="numpy",
            nogil=unlocks,
            fastmath=fastmath,
            inline="always" if inline == "always" else "never",
            **({"forceinline": True} if inline == "code" else {}),
            cache=False,
            _nrt=allocates,
        )(body)
        if isinstance(dispatcher, Dispatcher):  # NUMBA_DISABLE_JIT leaves the function as it is
            _keep_on_disk(dispatcher)
        return cast(_F, dispatcher)

    return compiled if function is None else compiled(function)


def direct(function: _F, *examples: object) -> _F:
    """The compiled function for arguments of the very types of ``examples``, without any dispatch.

    A call saves half of what numba spends before the kernel runs. Nothing but being an array is
    checked: the caller answers for dtype, number of dimensions and contiguity.
    """
    if not isinstance(function, Dispatcher):  # NUMBA_DISABLE_JIT
        return function
    signature = tuple(numba.typeof(example) for example in examples)
    function.compile(signature)
    return cast(_F, function.overloads[signature].entry_point)


def _keep_on_disk(dispatcher: Any) -> None:
    try:
        dispatcher._cache = _KernelCache(dispatcher)
    except RuntimeError as error:  # numba found no folder it may write to
        _log.warning("%s; it is compiled anew in each process. Set NUMBA_CACHE_DIR.", error)


class _KernelCache(FunctionCache):
    """Numba's cache with three faults mended.

    Numba's own stamp is the file of the kernel alone, so a kernel would keep the stale machine code
    of an edited kernel that it calls from another file; and two processes that save different
    signatures of one kernel at once can each take the other's code for their own. A type that is
    there no more, in a signature that is kept, would end the call.
    """

    def __init__(self, dispatcher: Any) -> None:
        super().__init__(dispatcher.py_func)
        self._options = "" if dispatcher.targetoptions["nogil"] else " locked"

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        # Not before the first call: by then every name the kernel uses exists.
        self._cache_file._source_stamp = fingerprint(self._py_func) + self._options
        try:
            return super().load_overload(sig, target_context)
        except (AttributeError, ImportError):
            # The list of what is kept names a type that an earlier version had.
            Path(self._cache_file._index_path).unlink(missing_ok=True)
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        self._impl.locator.ensure_cache_path()
        folder = os.open(self.cache_path, os.O_RDONLY)
        try:
            fcntl.flock(folder, fcntl.LOCK_EX)
            super().save_overload(sig, data)
        finally:
            os.close(folder)


def fingerprint(function: Callable[..., Any]) -> str:
    """Digest of all that the machine code of a kernel is made from, as loaded in this process.

    That is its byte code, the constants it reads from its module and others, and the same of every
    kernel that it calls.
    """
    digest = hashlib.sha256()
    _add_function(digest, cast(FunctionType, getattr(function, "py_func", function)), set())
    return digest.hexdigest()


def _add_function(digest: Any, function: FunctionType, seen: set[object]) -> None:
    if function in seen:
        return
    seen.add(function)
    digest.update(f"{function.__module__}.{function.__qualname__}{function.__defaults__}".encode())
    names: list[str] = []
    for code in _nested(function.__code__):
        digest.update(code.co_code)
        digest.update(repr((_constants(code), code.co_names, code.co_varnames)).encode())
        names.extend(code.co_names)
    for cell in function.__closure__ or ():
        _add_value(digest, cell.cell_contents, names, seen)
    for name in names:
        if name in function.__globals__:
            _add_value(digest, function.__globals__[name], names, seen)


def _nested(code: CodeType) -> Iterator[CodeType]:
    yield code
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _nested(constant)


def _constants(code: CodeType) -> list[Any]:
    # The order of a frozenset changes from process to process, a code object's repr is its address.
    return [
        sorted(map(repr, constant)) if isinstance(constant, frozenset) else constant
        for constant in code.co_consts
        if not isinstance(constant, CodeType)
    ]


def _add_value(digest: Any, value: object, names: list[str], seen: set[object]) -> None:
    if isinstance(value, Dispatcher):
        digest.update(repr(sorted(value.targetoptions.items(), key=str)).encode())
        _add_function(digest, value.py_func, seen)
    elif isinstance(value, np.ndarray):
        digest.update(value.dtype.str.encode() + repr(value.shape).encode() + value.tobytes())
    elif isinstance(value, EnumType):
        digest.update(repr(list(value)).encode())
    elif isinstance(value, FunctionType):
        # One that numba knows by an overload, which may say its revision.
        name = f"{value.__module__}.{value.__qualname__}"
        digest.update(f"{name} {getattr(value, 'revision', 0)}".encode())
    elif isinstance(value, ModuleType) and (value, *names) not in seen:
        seen.add((value, *names))
        # Read as `module.name`; a module of another library yields constants such as math.pi.
        for name in names:
            _add_value(digest, vars(value).get(name), names, seen)
    elif isinstance(value, bool | int | float | complex | str | tuple | np.generic):
        digest.update(repr(value).encode())
