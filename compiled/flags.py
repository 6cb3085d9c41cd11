"""Numba's settings of a compilation, compared in a fraction of the time.

They are part of a key that is looked up for every call of a library function in a kernel.
"""

from typing import Any

from numba.core import compiler


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
