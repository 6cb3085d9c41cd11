"""Digest of everything that the machine code of a kernel is made from."""

import dis
import hashlib
import uuid
from collections.abc import Callable, Iterator
from enum import EnumType
from types import CodeType, FunctionType, ModuleType
from typing import Any, cast
from weakref import WeakKeyDictionary

import numpy as np
from numba import types
from numba.core.dispatcher import Dispatcher

from compiled.compiler.store import plain

#: Instructions that read a constant by its index.
_READS_CONSTANT = frozenset(dis.hasconst)
#: What a function is made from by itself, and the kernels that it names.
_Own = tuple[bytes, tuple[FunctionType, ...]]
_Known = WeakKeyDictionary[FunctionType, _Own]

_known: _Known = WeakKeyDictionary()
_identities: WeakKeyDictionary[FunctionType, str] = WeakKeyDictionary()


def fingerprint(function: Callable[..., Any]) -> str:
    """Digest of all that the machine code of a kernel is made from, as loaded in this process.

    That is its byte code, the constants it reads from its module and others, and the same of every
    kernel that it calls; docstrings do not enter it.
    """
    return _whole(cast(FunctionType, getattr(function, "py_func", function)), WeakKeyDictionary())


def settled_fingerprint(function: FunctionType) -> str:
    """The fingerprint of a kernel that is about to be compiled: each function is read once only.

    Constants that change later are not seen, as little as compiled code sees them.
    """
    return _whole(function, _known)


def callees(function: FunctionType) -> tuple[FunctionType, ...]:
    """The functions of all kernels that a kernel reads from around it, and so may call."""
    return _own(function, _known)[1]


def identity(function: FunctionType) -> str:
    """A name for a function that no other function has in any process.

    It is a digest of what the function is made from, where that can be told, and else random.
    """
    if function not in _identities:
        digest = hashlib.sha256(settled_fingerprint(function).encode())
        try:
            for value in _captured(function):
                digest.update(_add_settled(value).encode())
            _identities[function] = digest.hexdigest()[:24]
        except _Untold:
            _identities[function] = uuid.uuid4().hex[:24]
    return _identities[function]


class _Untold(Exception):
    """A value of which nothing is known that is the same in every process."""


def _captured(function: FunctionType) -> Iterator[object]:
    """Values that a function reads from around it, without those of modules of numba's version."""
    for cell in function.__closure__ or ():
        yield cell.cell_contents
    yield from function.__defaults__ or ()
    if not function.__module__ or function.__module__.startswith("<"):
        yield _Untold
        return
    if function.__code__.co_filename.startswith("<"):  # written at run time, with its own globals
        for code in _nested(function.__code__):
            for name in code.co_names:
                yield function.__globals__.get(name)


def _add_settled(value: object) -> str:
    if value is None or isinstance(value, bool | int | float | complex | str | bytes):
        return repr(value)
    if isinstance(value, tuple | list):
        return f"{type(value).__name__}({','.join(map(_add_settled, value))})"
    if isinstance(value, dict):
        return f"dict({','.join(f'{_add_settled(k)}:{_add_settled(v)}' for k, v in value.items())})"
    if isinstance(value, np.ufunc | np.dtype):
        return f"{type(value).__name__} {value!s}"
    if isinstance(value, types.Type):
        return describe(value)
    if isinstance(value, Dispatcher):
        return settled_fingerprint(value.py_func)
    if isinstance(value, FunctionType):
        return identity(value)
    if isinstance(value, type | ModuleType):
        return f"{plain(getattr(value, '__module__', ''))}.{plain(value.__name__)}"
    raise _Untold


def describe(kind: Any) -> str:
    """A type of numba's, in words that mean the same in every process."""
    if isinstance(kind, types.BaseNamedTuple):
        of = kind.instance_class
        inside = ",".join(
            f"{name}:{describe(one)}" for name, one in zip(kind.fields, kind.types, strict=True)
        )
        return f"{plain(of.__module__)}.{of.__qualname__}({inside})"
    if isinstance(kind, types.UniTuple):
        return f"{describe(kind.dtype)}*{kind.count}"
    if isinstance(kind, types.BaseTuple):
        return f"({','.join(map(describe, kind))})"
    if isinstance(kind, types.Dispatcher):
        return f"kernel {settled_fingerprint(kind.dispatcher.py_func)}"
    if isinstance(kind, types.Function | types.Opaque) and "0x" in str(kind):
        raise _Untold
    return str(kind)


def _whole(function: FunctionType, known: _Known) -> str:
    digest = hashlib.sha256()
    pending, seen = [function], {function}
    while pending:
        own, callees = _own(pending.pop(), known)
        digest.update(own)
        pending.extend(callee for callee in callees if callee not in seen)
        seen.update(callees)
    return digest.hexdigest()


def _own(function: FunctionType, known: _Known) -> _Own:
    if function not in known:
        digest, callees = hashlib.sha256(), dict[FunctionType, None]()
        _add_function(digest, function, callees)
        known[function] = digest.digest(), tuple(callees)
    return known[function]


def _add_function(digest: Any, function: FunctionType, callees: dict[FunctionType, None]) -> None:
    name = f"{plain(function.__module__)}.{function.__qualname__}"
    digest.update(f"{name}{function.__defaults__}".encode())
    names: list[str] = []
    for code in _nested(_without_docstring(function)):
        digest.update(code.co_code)
        digest.update(repr((_constants(code), code.co_names, code.co_varnames)).encode())
        names.extend(code.co_names)
    seen: set[object] = set()
    for cell in function.__closure__ or ():
        _add_value(digest, cell.cell_contents, names, seen, callees)
    for name in names:
        if name in function.__globals__:
            _add_value(digest, function.__globals__[name], names, seen, callees)


def _without_docstring(function: FunctionType) -> CodeType:
    """Code of a function, its docstring left out where no instruction reads the same constant."""
    code, docstring = function.__code__, function.__doc__
    if docstring is None or code.co_consts[:1] != (docstring,):
        return code
    instructions = set(zip(code.co_code[::2], code.co_code[1::2], strict=True))
    if any((op, 0) in instructions for op in _READS_CONSTANT):
        return code
    return code.replace(co_consts=(None, *code.co_consts[1:]))


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


def _add_value(
    digest: Any,
    value: object,
    names: list[str],
    seen: set[object],
    callees: dict[FunctionType, None],
) -> None:
    if isinstance(value, Dispatcher):
        digest.update(repr(sorted(value.targetoptions.items(), key=str)).encode())
        callees[value.py_func] = None
    elif isinstance(value, np.ndarray):
        digest.update(value.dtype.str.encode() + repr(value.shape).encode() + value.tobytes())
    elif isinstance(value, EnumType):
        digest.update(repr(list(value)).encode())
    elif isinstance(value, FunctionType):
        # One that numba knows by an overload, which may say its revision.
        name = f"{plain(value.__module__)}.{value.__qualname__}"
        digest.update(f"{name} {getattr(value, 'revision', 0)}".encode())
    elif isinstance(value, ModuleType) and value not in seen:
        seen.add(value)
        # Read as `module.name`; a module of another library yields constants such as math.pi.
        for name in names:
            _add_value(digest, vars(value).get(name), names, seen, callees)
    elif isinstance(value, bool | int | float | complex | str | tuple | np.generic):
        digest.update(repr(value).encode())
