"""Programs that are run in processes of their own."""

import os
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

ROOT = Path(__file__).parents[2]


def run(
    program: str, folder: Path, variables: Mapping[str, str] = {}
) -> "subprocess.CompletedProcess[str]":
    """Run a program in a new process.

    Args:
        program: Python.
        folder: Where its modules are, and where it runs.
        variables: More than this process has.
    """
    path = f"{ROOT}{os.pathsep}{folder}"
    return subprocess.run(
        [sys.executable, "-c", program], cwd=folder, capture_output=True, check=False, text=True,
        env={**os.environ, "PYTHONPATH": path, **variables},
    )  # fmt: skip


def python(program: str, folder: Path, cache: str = "cache", **more: str) -> str:
    """The text that a program prints in a new process.

    Args:
        program: Python.
        folder: Where its modules are, and where it runs.
        cache: Folder of its machine code, in that folder.
        more: More variables.
    """
    ended = run(program, folder, {"NUMBA_CACHE_DIR": str(folder / cache), **more})
    assert ended.returncode == 0, ended.stderr
    return ended.stdout


BIG = """
import numpy as np
from compiled.kernel import kernel

@kernel
def large(values, count):
    out = np.empty(count)
    for i in range(count):
        out[i] = np.sin(values[i]) * np.cos(values[i])
        if values[i] > 100.0:
            raise ValueError("too much")
        for j in range(i):
LINES
    return out

@kernel
def caller(values):
    return large(values, 3).sum() + large(values, len(values))[0]
""".replace(
    "LINES",
    6
    * """
            out[j] += values[j] * np.exp(-out[i]) - np.sqrt(abs(values[j] * out[j]))
            out[i] -= np.tanh(out[j]) * np.arctan2(values[i], values[j]) + np.log1p(abs(out[j]))
""",
)


#: Counts allocations from its start.
BIG_PROGRAM = """
from numba.core.runtime import _nrt_python
_nrt_python.memsys_enable_stats()
import big, sys
import numpy as np
print(big.caller(np.arange(6.0)))
try:
    big.caller(np.arange(200.0))
except ValueError as error:
    print(error)
from numba.core.runtime import rtsys
values = np.arange(6.0)
references, before = sys.getrefcount(values), rtsys.get_allocation_stats()
for _ in range(1000):
    big.caller(values)
after = rtsys.get_allocation_stats()
assert after.alloc - before.alloc >= 1000
assert references == sys.getrefcount(values)
assert after.alloc - before.alloc == after.free - before.free
"""


def write_big(folder: Path) -> Path:
    (folder / "big.py").write_text(BIG)
    return folder
