"""Detection of other packages that have the names of Armwright's."""

from functools import cache
from importlib.util import find_spec
from pathlib import Path

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
