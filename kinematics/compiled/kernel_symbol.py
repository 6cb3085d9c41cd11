"""Names for compiled functions that are the same in every process, and equal for equal code only.

Numba counts the functions that it compiles and makes the count part of a symbol's name. Two
processes that save machine code can then give one name to different bodies, and a process that
loads both runs one of them in place of the other.
"""

import hashlib
from functools import cache
from typing import Any

from numba.core import funcdesc, itanium_mangler
from numba.core.bytecode import FunctionIdentity

from kinematics.compiled.kernel_fingerprint import identity


@cache
def name_by_content() -> None:
    """Have numba name every function it compiles from now on by what it is made from."""
    counted = FunctionIdentity.from_function.__func__

    def named(cls: Any, function: Any) -> Any:
        answer = counted(cls, function)
        rename(answer, identity(answer.func))
        return answer

    FunctionIdentity.from_function = classmethod(named)


def rename(function: Any, unique: str) -> None:
    """Give numba's notion of a function a name of our own."""
    function.unique_id = unique
    function.unique_name = f"{function.func_qualname}${unique}"


def mangled(name: str, kinds: Any, *, abi_tags: Any = (), uid: str | None = None) -> str:
    """Numba's symbol, with a digest in place of the types of the arguments.

    Those of tuples of arrays spelled out are kilobytes.
    """
    whole = funcdesc.default_mangler(name, kinds, abi_tags=abi_tags, uid=uid)
    short = hashlib.sha256(whole.encode()).hexdigest()[:24]
    return f"{itanium_mangler.PREFIX}{itanium_mangler.mangle_identifier(name, uid=short)}"
