"""Armwright as a library: robots, scenes, plans and proofs from Python, without the server.

>>> import armwright as aw
>>> robot = aw.load_robot("panda")
>>> scene = aw.Scene([aw.Obstacle("post", aw.Box((0.1, 0.1, 1.0)), aw.pose([0.5, 0.0, 0.5]))])
>>> result = aw.plan(robot, scene, start, goal)

Names are imported when they are first used, so that importing this package costs nothing.
"""

import ast
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from armwright.public_names import *

#: File whose imports are the public names; it is read, so that a name loads its module alone.
_FILE = "public_names.py"
#: Packages that the library is made of, side by side with this one.
PACKAGES = ("compiled", "kinematics", "dynamics", "obstacles", "planning", "tracking")


@cache
def check_packages() -> None:
    """See that the packages of Armwright are the ones that Python imports.

    Raises:
        ImportError: Another package of the same name comes first on the path, or one is missing.
    """
    home = Path(__file__).resolve().parents[1]
    if home.joinpath("armwright", "_src").is_dir():  # a wheel, with all inside of armwright
        import_module("armwright.first_use").compile_at_first_use()
        return
    for name in PACKAGES:
        place = _location(name)
        if place is None:
            raise ImportError(
                f"Armwright's package {name!r} is missing: it should be at {home / name}. "
                "Install Armwright again."
            )
        if place != home / name:
            raise ImportError(
                f"the package {name!r} at {place} shadows Armwright's at {home / name}. Rename "
                "it, or keep its folder off the path (start Python elsewhere, or with "
                "PYTHONSAFEPATH=1)."
            )


def _location(name: str) -> Path | None:
    """Folder that ``import name`` would load; None where there is no such package."""
    spec = find_spec(name)
    if spec is None:
        return None
    if spec.submodule_search_locations:
        return Path(next(iter(spec.submodule_search_locations))).resolve()
    return None if spec.origin is None else Path(spec.origin).resolve()


def _load(name: str) -> object:
    if name == "__all__":
        return sorted(_modules())
    if name not in _modules():
        raise AttributeError(f"module 'armwright' has no attribute {name!r}")
    check_packages()
    value = globals()[name] = getattr(import_module(_modules()[name]), name)
    return value


if not TYPE_CHECKING:  # names that are not there are errors for type checkers
    __getattr__ = _load


def __dir__() -> list[str]:
    return sorted({*globals(), *_modules()})


@cache
def _modules() -> dict[str, str]:
    """Module of each public name."""
    text = Path(__file__).with_name(_FILE).read_text("utf-8")
    imports = [node for node in ast.parse(text).body if isinstance(node, ast.ImportFrom)]
    return {item.name: str(node.module) for node in imports for item in node.names}
