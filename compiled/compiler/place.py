"""Names of modules as a checkout has them, wherever these packages are installed.

A wheel has every package below ``armwright._src``. Machine code, and the digests that it is kept
under, hold the names of a checkout, so that both share what is compiled.
"""

import io
import pickle
from typing import Any

#: Package of a wheel that holds the others.
WHEEL = "armwright._src."
#: Packages that a wheel moves.
PACKAGES = frozenset(
    {"command_line", "compiled", "dynamics", "kinematics", "obstacles", "planning", "service"}
    | {"studio", "tracking"}
)
#: Names of the packages here begin with this: nothing in a checkout.
HERE = __name__.partition("compiled.")[0]


def plain(module: str | None) -> str:
    """Name of a module as a checkout has it; "None" of a function that has none."""
    return str(module).removeprefix(WHEEL)


def here(module: str) -> str:
    """Name by which a module can be imported in this installation."""
    name = plain(module)
    return HERE + name if name.partition(".")[0] in PACKAGES else module


def loads(content: bytes) -> Any:
    """The value of a pickle that a checkout or a wheel has made."""
    moved = HERE or WHEEL.encode() in content
    return _Unpickler(io.BytesIO(content)).load() if moved else pickle.loads(content)


class _Unpickler(pickle.Unpickler):
    def find_class(self, module: str, name: str) -> Any:
        """The class or function of a name, in this installation."""
        return super().find_class(here(module), name)
