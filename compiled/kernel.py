"""The one door to numba: `kernel` marks a function that is compiled to machine code."""

from collections.abc import Callable
from typing import Any, Literal, ParamSpec, TypeVar, cast, overload

import numba
from numba.core import config

from compiled.compiler.dispatcher import Kernel

#: Freedoms of LLVM with floating-point arithmetic: a product and a sum may be rounded at once,
#: signs of zero may be lost, and there are no NaN and infinities. Sums keep their order: LLVM
#: would change it with the width of a processor's vectors, and the bits of answers with it.
_FASTMATH = {"contract": True, "ninf": True, "nnan": True, "nsz": True}
_F = TypeVar("_F", bound=Callable[..., Any])
_P = ParamSpec("_P")
_R = TypeVar("_R")
#: Kernels by what ``directly`` calls in place of them.
_DOORS: dict[Any, Any] = {}


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
    """Compile a function with numba on its first call and store the machine code on disk.

    Division follows IEEE 754 (x / 0 is inf or nan, never an exception) and the interpreter lock is
    released inside, unless asked otherwise. A type checker sees the signature of the function
    itself. The machine code is looked for in ARMWRIGHT_KERNELS and kept in NUMBA_CACHE_DIR if set,
    else in the user's cache folder; where that can't be written, each process compiles it anew. A
    large kernel is compiled once and called, a small one copied into the kernels that call it.

    Args:
        function: the function to compile, when used without parentheses.
        fastmath: let LLVM round a product and a sum at once; only where no verdict hangs on the
            last bits, and NaN and infinities cannot occur.
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
        if config.DISABLE_JIT:
            return body
        options = {
            "nopython": True,
            "error_model": "numpy",
            "nogil": unlocks,
            "fastmath": dict(_FASTMATH) if fastmath else False,
            "inline": "always" if inline == "always" else "never",
            "forceinline": inline == "code",
            "_nrt": allocates,
        }
        return cast(_F, Kernel(body, options))

    return compiled if function is None else compiled(function)


def direct(function: _F, *examples: object) -> _F:
    """The compiled function for arguments of the very types of ``examples``, without any dispatch.

    A call saves half of what numba spends before the kernel runs. Nothing but being an array is
    checked: the caller answers for dtype, number of dimensions and contiguity.
    """
    if not isinstance(function, Kernel):  # NUMBA_DISABLE_JIT
        return function
    return cast(_F, function.compile(tuple(numba.typeof(example) for example in examples)))


def directly(function: Callable[_P, _R], *args: _P.args, **named: _P.kwargs) -> _R:
    """The result of a kernel called as by ``direct``; the first call's arguments are the examples.

    Later arguments must have the very types of the first ones: a float is never given as an int.

    Args:
        function: the kernel.
        args: its arguments.
        named: none; kernels that are called so take their arguments by place.
    """
    door = _DOORS.get(function)
    if door is None:
        door = _DOORS[function] = direct(function, *args)
    return cast(_R, door(*args, **named))
