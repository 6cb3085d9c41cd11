"""A list of kernels, each for types of its arguments, in a file beside the sources.

Kernels that Python calls need a door besides; those that only kernels call are listed so that
they can be compiled at once in several processes, and are compiled on the way if they are not.
"""

import pkgutil
from collections.abc import Collection, Iterable
from pathlib import Path
from typing import Any, NamedTuple

from compiled.compiler import machine_code, store
from compiled.compiler.dispatcher import Kernel
from compiled.compiler.fingerprint import callees
from compiled.compiler.machine_code import Code
from compiled.compiler.signature import named_tuples, type_of_text, type_text
from compiled.compiler.store import loads

#: Begins a line of a kernel that Python calls.
_DOOR = "python"
_BODY = "kernel"
_HEAD = """\
# Kernels that a request can reach, with the types that they are compiled for.
# `make kernel-list` writes this file from what the service's tests compile.
# First short names of types; then who calls a kernel, its size in kB, its name and its arguments.
"""


class Entry(NamedTuple):
    """A kernel for types of its arguments.

    Attributes:
        kernel: the kernel.
        kinds: numba's types of its arguments.
        door: whether Python calls it.
        weight: about how long it takes to compile, beside others; the size of its code [kB].
    """

    kernel: Kernel
    kinds: tuple[Any, ...]
    door: bool
    weight: int

    @property
    def name(self) -> str:
        """The name by which it can be imported."""
        return f"{self.kernel.py_func.__module__}.{self.kernel.py_func.__qualname__}"

    @property
    def files(self) -> list[str]:
        """Names of its stored machine code."""
        return self.kernel.names(self.kinds, self.door)


def read(path: Path) -> tuple[list[Entry], list[str]]:
    """The entries of a list, and the lines that name no kernel or no type that is there."""
    names: dict[str, Any] = {}
    entries, unknown = [], []
    for line in path.read_text("utf-8").splitlines():
        if not line or line.startswith("#"):
            continue
        try:
            if " = " in line:
                name, _, text = line.partition(" = ")
                names[name] = type_of_text(text, names)
            else:
                entries.append(_entry(line, names))
        except (ValueError, AttributeError, ImportError, KeyError):
            unknown.append(line)
    return entries, unknown


def called_by_python(line: str) -> bool:
    """Whether a line of a list is of a kernel that Python calls."""
    return line.partition(" ")[0] == _DOOR


def needed_by(names: Collection[str], entries: Iterable[Entry]) -> list[Entry]:
    """The entries that Python needs to call kernels of some names, for any types of the list.

    Those are the kernels, with their doors, and all that they call; types are not followed, so that
    a kernel may be among them for types that only others call it with.
    """
    entries = list(entries)
    pending = [one.kernel.py_func for one in entries if one.door and one.name in names]
    reached = set(pending)
    while pending:
        found = set(callees(pending.pop())) - reached
        reached |= found
        pending += found
    return [
        one._replace(door=one.door and one.name in names)
        for one in entries
        if one.kernel.py_func in reached
    ]


def load(entries: Iterable[Entry]) -> bool:
    """Load kernels that Python calls at once, those that are on disk with all that they call.

    Returns:
        Whether these are all.
    """
    doors = {entry.files[-1]: entry for entry in entries}
    there = [door for door in doors if machine_code.find(door) is not None]
    machine_code.load(*there)
    for door in there:
        doors[door].kernel.compile(doors[door].kinds)
    return len(there) == len(doors)


def write(path: Path, entries: Iterable[Entry]) -> None:
    """Write a list, in an order that does not hang on that of the entries.

    Raises:
        ValueError: Python calls a kernel with a type that has no notation in text. Kernels that
            only kernels call with such types are left out.
    """
    entries = [entry for entry in entries if entry.door or _has_text(entry.kinds)]
    names = _short_names(entry.kinds for entry in entries)
    lines = []
    for kind, name in names.items():
        others = {other: short for other, short in names.items() if other != kind}
        lines.append(f"{name} = {type_text(kind, others)}")
    for entry in entries:
        kinds = ", ".join(type_text(kind, names) for kind in entry.kinds)
        caller = _DOOR if entry.door else _BODY
        lines.append(f"{caller} {entry.weight} {entry.name}({kinds})")
    body = sorted(lines[len(names) :], key=lambda line: line.split(" ", 2)[2])
    path.write_text("\n".join([_HEAD, *lines[: len(names)], "", *body, ""]), "utf-8")


def stored(folder: Path) -> list[Entry]:
    """The kernels of a folder of machine code, as far as the code of today would make them."""
    names = set(store.names(folder))
    entries = []
    for name in sorted(one for one in names if ".door" not in one):
        kernel = _kernel(name.rpartition("-")[0])
        content = store.read_from(folder, name)
        if kernel is None or content is None:
            continue
        code = Code.unpickled(name, content)
        kinds = loads(code.facts)[1].args
        if kernel.names(kinds, door=False) == [name]:
            door = kernel.names(kinds, door=True)[-1] in names
            weight = round((len(code.machine_code) + len(code.bitcode or b"")) / 1024)
            entries.append(Entry(kernel, kinds, door, weight))
    return entries


def _entry(line: str, names: dict[str, Any]) -> Entry:
    caller, weight, text = line.split(" ", 2)
    name, _, arguments = text.partition("(")
    kernel = _kernel(name)
    if kernel is None or caller not in (_DOOR, _BODY):
        raise ValueError(line)
    kinds = type_of_text(f"({arguments.removesuffix(')')},)", names) if arguments != ")" else ()
    return Entry(kernel, tuple(kinds), caller == _DOOR, int(weight))


def _kernel(name: str) -> Kernel | None:
    try:
        kernel = pkgutil.resolve_name(name)
    except (ValueError, AttributeError, ImportError):
        return None
    return kernel if isinstance(kernel, Kernel) else None


def _has_text(kinds: tuple[Any, ...]) -> bool:
    try:
        return bool([type_text(kind) for kind in kinds]) or not kinds
    except ValueError:
        return False


def _short_names(signatures: Iterable[tuple[Any, ...]]) -> dict[Any, str]:
    kinds = dict.fromkeys(kind for kinds in signatures for kind in named_tuples(kinds))
    names: dict[Any, str] = {}
    for kind in sorted(kinds, key=lambda kind: (kind.instance_class.__name__, str(kind))):
        name = kind.instance_class.__name__
        taken = sum(other.instance_class.__name__ == name for other in names)
        names[kind] = f"{name}{taken + 1}" if taken else name
    return dict(sorted(names.items(), key=lambda pair: _depth(pair[0])))


def _depth(kind: Any) -> int:
    return 1 + max((_depth(one) for one in named_tuples(list(kind))), default=0)
