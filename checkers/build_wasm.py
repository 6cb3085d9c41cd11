"""Build the checker of witnesses for pages: checkers/c/armwright_check.c as WebAssembly.

    python checkers/build_wasm.py

The compiler is Zig's (the wheel ``ziglang``). A test builds it again and compares.
"""

import gzip
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parents[1]
SOURCE = ROOT / "checkers/c/armwright_check.c"
TARGET = ROOT / "service/viewer/assets/armwright_check.wasm.gz"
_FLAGS = ("-target", "wasm32-wasi", "-std=c11", "-O2", "-msimd128", "-ffp-contract=off", "-s")


def built() -> bytes:
    """The program, compiled anew."""
    with tempfile.TemporaryDirectory() as folder:
        # Names of files may end up in what is built.
        program = Path(folder, "armwright_check.wasm")
        Path(folder, SOURCE.name).write_bytes(SOURCE.read_bytes())
        words = (sys.executable, "-m", "ziglang", "cc", *_FLAGS, "-o", program.name, SOURCE.name)
        subprocess.run(words, check=True, cwd=folder, timeout=600)
        return program.read_bytes()


if __name__ == "__main__":
    TARGET.write_bytes(gzip.compress(built(), mtime=0))
