"""Build step of setuptools: a wheel with one top-level package, ``armwright``.

The packages of the repository lie side by side, with names that others have too. In a wheel they
are ``armwright._src.planning`` and so on: files are moved, and whatever names a module is
rewritten: imports, strings such as ``"planning.problem"`` and the lists of kernels. An editable
install is the checkout as it stands.
"""

import re
import shutil
from pathlib import Path

from setuptools.command.build_py import build_py
from setuptools.command.egg_info import egg_info

#: Where the packages are moved to.
PLACE = "armwright._src"


class OnePackage(build_py):
    """Copy of the packages for a wheel, moved below ``armwright``."""

    def run(self) -> None:
        """Copy, move and rewrite; copy nothing where an editable install asks."""
        if self.editable_mode:
            super().run()
            return
        shutil.rmtree(self.build_lib, ignore_errors=True)
        names = sorted({name.partition(".")[0] for name in self.packages} - {"armwright"})
        super().run()
        move(Path(self.build_lib), names)


class OneName(egg_info):
    """Facts about the distribution, whose one top-level package is ``armwright``."""

    def run(self) -> None:
        """Write them."""
        super().run()
        Path(self.egg_info, "top_level.txt").write_text("armwright\n", "utf-8")


def move(folder: Path, names: list[str]) -> None:
    """Move packages of a folder below ``armwright``, and rewrite all that names their modules."""
    place = folder.joinpath(*PLACE.split("."))
    place.mkdir()
    (place / "__init__.py").write_text('"""Packages that the library is made of: not its API."""\n')
    for name in names:
        (folder / name).rename(place / name)
    for path in [*folder.rglob("*.py"), *place.rglob("*kernels.txt")]:
        text = path.read_text("utf-8")
        path.write_text(rewritten(text, names, whole=path.suffix != ".py"), "utf-8")


def rewritten(text: str, names: list[str], *, whole: bool = False) -> str:
    """A text whose modules are named by where they are in a wheel.

    Args:
        text: a module or a list of kernels.
        names: packages that are moved.
        whole: rewrite every dotted name; otherwise those of imports, and strings that are one.
    """
    packages = "|".join(names)
    if whole:
        return re.sub(rf"(?<![\w.])(?=(?:{packages})\.\w)", f"{PLACE}.", text)
    text = re.sub(rf"(?m)^(\s*(?:from|import) )(?=(?:{packages})\b)", rf"\1{PLACE}.", text)
    return re.sub(
        rf"""(?<=["'])(?=(?:{packages})(?:\.[a-z_]\w*)+(?::\w+)?["'])""", f"{PLACE}.", text
    )
