"""The one door to numba: `kernel` marks a function that is compiled to machine code."""

from collections.abc import Callable
from typing import Any, Literal, TypeVar, cast, overload

import numba

_F = TypeVar("_F", bound=Callable[..., Any])


@overload
def kernel(function: _F, /) -> _F: ...
@overload
def kernel(
    *, fastmath: bool = False, inline: Literal["never", "always"] = "never"
) -> Callable[[_F], _F]: ...
def kernel(
    function: _F | None = None,
    /,
    *,
    fastmath: bool = False,
    inline: Literal["never", "always"] = "never",
) -> _F | Callable[[_F], _F]:
    """Compile a function with numba on first call and keep its machine code on disk.

    Division follows IEEE 754 (x / 0 is inf or nan, never an exception), and the interpreter lock is
    released inside. The signature seen by a type checker is that of the function itself.

    Args:
        function: the function to compile, when used without parentheses.
        fastmath: let LLVM reorder floating-point arithmetic; only where no verdict hangs on the
            last bits and NaN cannot occur.
        inline: "always" pastes the body into calling kernels.

    Returns:
        The compiled function, or a decorator when called with options.
    """

    def compiled(body: _F) -> _F:
        options = {"cache": True, "error_model": "numpy", "nogil": True}
        return cast(_F, numba.njit(fastmath=fastmath, inline=inline, **options)(body))

    return compiled if function is None else compiled(function)
