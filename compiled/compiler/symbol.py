"""Names for compiled functions that are the same in every process, and equal for equal code only.

Numba counts the functions that it compiles and makes the count part of a symbol's name. Two
processes that save machine code can then give one name to different bodies, and a process that
loads both runs one of them in place of the other.
"""

import hashlib
import importlib
from functools import cache, wraps
from types import FunctionType
from typing import Any

from numba.core import environment, funcdesc, itanium_mangler, serialize
from numba.core.base import BaseContext
from numba.core.bytecode import FunctionIdentity
from numba.core.cpu_options import FastMathOptions

from compiled.compiler.fingerprint import identity
from compiled.compiler.store import HERE, here, loads, plain

#: How numba begins the names of functions that it writes for expressions of whole arrays, and of
#: what those call; addresses follow.
_EXPRESSION = "__numba_array_expr_"
_CALLED = "__ufunc_or_dufunc_"


@cache
def name_by_content() -> None:
    """Have numba name every function it compiles from now on by what it is made from."""
    counted = FunctionIdentity.from_function.__func__

    def named(cls: Any, function: Any) -> Any:
        if getattr(function, "__name__", "").startswith(_EXPRESSION):
            function = without_addresses(function)
        answer = counted(cls, function)
        rename(answer, identity(answer.func))
        return answer

    FunctionIdentity.from_function = classmethod(named)
    insert = BaseContext.insert_const_bytes

    def insert_const_bytes(self: Any, module: Any, content: bytes, name: str | None = None) -> Any:
        # Numba's own choice, Python's hash of the bytes, differs from process to process.
        digest = hashlib.sha256(content).hexdigest()[:24]
        return insert(self, module, content, name or digest)

    BaseContext.insert_const_bytes = insert_const_bytes

    def encode(self: Any) -> str:
        # A part of symbols; the order of a set's text differs from process to process.
        return f"{{{', '.join(map(repr, sorted(self.flags)))}}}" if self.flags else "set()"

    FastMathOptions.encode = encode
    # Classes of answers, which machine code holds as pickles.
    serialize.cloudpickle = _Pickles
    if HERE:
        _name_as_in_checkout()


class _Pickles:
    """What numba reads pickles with."""

    loads = staticmethod(loads)


def _name_as_in_checkout() -> None:
    """Have numba name modules in symbols and pickles as a checkout does."""
    described = funcdesc.FunctionDescriptor._get_function_info.__func__
    found, rebuilt = funcdesc.FunctionDescriptor.lookup_module, environment._rebuild_env

    def described_plainly(cls: Any, function: Any) -> Any:
        name, unique, module, *more = described(cls, function)
        return name, unique, plain(module), *more

    def lookup_module(self: Any) -> Any:
        if here(self.modname) != self.modname:
            return importlib.import_module(here(self.modname))
        return found(self)

    @wraps(rebuilt)
    def rebuild(module: str, *more: Any) -> Any:
        return rebuilt(here(module), *more)

    funcdesc.FunctionDescriptor._get_function_info = classmethod(described_plainly)
    funcdesc.FunctionDescriptor.lookup_module = lookup_module
    environment._rebuild_env = rebuild


def without_addresses(function: FunctionType) -> FunctionType:
    """A function that numba wrote for an expression of arrays, with names that hold no addresses.

    Those of universal functions become names of what they stand for, in the order of their use.
    """
    code = function.__code__
    names: dict[str, str] = {}
    for name in code.co_names:
        if name.startswith(_CALLED):
            names[name] = f"{_CALLED}{len(names)}_{function.__globals__[name].__name__}"
    values = {names.get(name, name): one for name, one in function.__globals__.items()}
    values["__name__"] = "numba.np.ufunc.array_exprs"
    settled = code.replace(
        co_name=_EXPRESSION,
        co_qualname=_EXPRESSION,
        co_names=tuple(names.get(name, name) for name in code.co_names),
    )
    return FunctionType(settled, values, _EXPRESSION)


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
