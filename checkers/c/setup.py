"""Build the command armwright-check with the C compiler of the wheel ``ziglang``."""

import os
import subprocess
import sys
from pathlib import Path

from setuptools import Distribution, setup
from setuptools.command.build import build

FLAGS = ("-std=c11", "-O2", "-ffp-contract=off")


class Compiled(build):  # type: ignore[misc]
    """The program, installed where commands are."""

    def run(self) -> None:
        """Compile it."""
        folder = Path(self.build_temp)
        folder.mkdir(parents=True, exist_ok=True)
        program = folder / ("armwright-check.exe" if os.name == "nt" else "armwright-check")
        words = (sys.executable, "-m", "ziglang", "cc", *FLAGS, "-o", program)
        subprocess.run((*words, "armwright_check.c", "-lm"), check=True)
        bin_ = "Scripts" if os.name == "nt" else "bin"
        self.distribution.data_files = [(bin_, [str(program)])]
        super().run()


class OfOnePlatform(Distribution):  # type: ignore[misc]
    """A wheel with machine code in it."""

    def has_ext_modules(self) -> bool:
        """Whether the wheel is for one platform."""
        return True


setup(py_modules=[], distclass=OfOnePlatform, cmdclass={"build": Compiled})
