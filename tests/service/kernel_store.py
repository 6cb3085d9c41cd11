"""Machine code of the service's tests: all of it is there before the first request."""

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache

from compiled.compiler.dispatcher import FROZEN
from service.warm_up.kernels import count_missing


@contextmanager
def frozen_kernels() -> Iterator[None]:
    """Compile the list of kernels; then a kernel that is missing is an error, here and in servers.

    Where FROZEN is set already, to 0 by `make kernel-list`, everything is left as it is.
    """
    if FROZEN in os.environ:
        yield
        return
    _warm()
    os.environ[FROZEN] = "1"
    try:
        yield
    finally:
        del os.environ[FROZEN]


@cache
def _warm() -> None:
    """Compile the list, once in a process: files of several folders may come in turns.

    To look whether anything is missing is quick here, where most modules are loaded already.
    """
    if count_missing():
        subprocess.run([sys.executable, "-m", "service.cli", "warm"], check=True)
