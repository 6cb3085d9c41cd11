"""Typed client of the Armwright motion planning service.

`Client` and `AsyncClient` are where to begin; `armwright_client.errors` shows the tree of errors.

All names are imported when the first is used: readers of files need neither HTTP nor answers.
"""

from importlib import import_module
from typing import TYPE_CHECKING

from armwright_client.version import VERSION as _VERSION

if TYPE_CHECKING:
    from armwright_client.public_classes import *
    from armwright_client.public_names import *

__version__ = _VERSION


def _load(name: str) -> object:
    if name.startswith("_") and name != "__all__":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    classes, names = (
        vars(import_module(f"{__name__}.{one}")).items()
        for one in ("public_classes", "public_names")
    )
    public = {
        one: value
        for one, value in classes
        if isinstance(value, type) and value.__module__.startswith("armwright_")
    }
    public |= {one: value for one, value in names if not one.startswith("_")}
    globals().update(public, __all__=sorted(public))
    if name not in globals():
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return globals()[name]


if not TYPE_CHECKING:  # names that are not there are errors for type checkers
    __getattr__ = _load


def __dir__() -> list[str]:
    _load("__all__")
    return sorted(globals())
