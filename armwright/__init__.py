"""Armwright as a library: robots, scenes, plans and proofs from Python, without the server.

>>> import armwright as aw
>>> robot = aw.load_robot("panda")
>>> scene = aw.Scene([aw.Obstacle("post", aw.Box((0.1, 0.1, 1.0)), aw.pose([0.5, 0.0, 0.5]))])
>>> result = aw.plan(robot, scene, start, goal)

Names are imported when they are first used, so that importing this package costs nothing.
"""

from functools import cache
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from armwright.arm_names import *
    from armwright.motion_names import *

#: Modules that import the public names; the second takes twice as long.
_NAMES = ("armwright.arm_names", "armwright.motion_names")
#: Packages that the library is made of, side by side with this one.
PACKAGES = ("compiled", "kinematics", "dynamics", "obstacles", "planning", "tracking")


@cache
def check_packages() -> None:
    """See that the packages of Armwright are the ones that Python imports.

    Raises:
        ImportError: Another package of the same name comes first on the path, or one is missing.
    """
    home = Path(__file__).resolve().parents[1]
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


def __getattr__(name: str) -> object:
    if name == "__all__":
        return _names()
    if not name.startswith("_"):
        check_packages()
        for module in _NAMES:
            found = vars(import_module(module))
            if name in found:
                globals()[name] = found[name]
                return found[name]
    raise AttributeError(f"module 'armwright' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *_names()})


def _names() -> list[str]:
    """All public names, in order."""
    modules = [import_module(module) for module in _NAMES]
    return sorted(name for module in modules for name in vars(module) if not name.startswith("_"))
