"""Install a wheel with kernels in a new environment and compare its answers between processors.

    python scripts/try_wheel.py WHEEL [--processors Haswell Skylake-Client-v4]

The client's wheel of the same version, which has the models of requests and answers, lies beside
it, as `scripts/wheels.py` leaves it.

The answers of `scripts/answers.py` are computed on this processor and on those named, which
`qemu-x86_64` emulates (Debian's package qemu-user). Nothing may be compiled and nothing written,
and all answers must be equal to the last bit. An emulated run takes minutes.
"""

import argparse
import json
import os
import shutil
import subprocess
import sys
import sysconfig
import tempfile
import time
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
#: What other settings of this shell could change.
_SETTINGS = ("PYTHONPATH", "NUMBA_CPU_NAME", "ARMWRIGHT_KERNEL_TARGET", "ARMWRIGHT_KERNELS")


def main() -> None:
    """Install, ask and compare."""
    parser = argparse.ArgumentParser(description="Compare a wheel's answers between processors.")
    parser.add_argument("wheel", type=Path)
    parser.add_argument("--processors", nargs="*", default=["Haswell", "Skylake-Client-v4"])
    chosen = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        python = install(chosen.wheel, Path(folder))
        first = answers([str(python)], Path(folder), "this processor")
        for processor in chosen.processors:
            emulator = shutil.which("qemu-x86_64")
            if emulator is None:
                raise SystemExit("qemu-x86_64 is not there; Debian's package is qemu-user")
            command = [emulator, "-cpu", processor, str(python)]
            other = answers(command, Path(folder), processor)
            differing = [name for name, one in first.items() if other[name] != one]
            if differing:
                raise SystemExit(f"{processor} answers differently: {', '.join(differing)}")
    print(f"{len(first)} digests equal on {1 + len(chosen.processors)} processors, none compiled")


def install(wheel: Path, folder: Path) -> Path:
    """Install a wheel in an environment that borrows its dependencies; gives its interpreter."""
    subprocess.run([sys.executable, "-m", "venv", str(folder / "venv")], check=True)
    python = folder / "venv" / "bin" / "python"
    (client,) = wheel.parent.glob("armwright_client-*.whl")
    command = [str(python), "-m", "pip", "install", "-q", "--no-deps", "--no-index"]
    subprocess.run([*command, str(wheel), str(client)], check=True)
    program = "import sysconfig; print(sysconfig.get_paths()['purelib'])"
    own = subprocess.run([str(python), "-c", program], check=True, capture_output=True, text=True)
    # Later on the path than the wheel itself.
    (Path(own.stdout.strip()) / "dependencies.pth").write_text(sysconfig.get_paths()["purelib"])
    return python


def answers(command: list[str], folder: Path, name: str) -> dict[str, Any]:
    """The digests of the answers on a processor, where nothing was compiled and nothing written."""
    store = folder / "store"
    environment = {key: value for key, value in os.environ.items() if key not in _SETTINGS}
    environment |= {
        "NUMBA_CACHE_DIR": str(store),
        "ARMWRIGHT_KERNELS_FROZEN": "1",
        "PYTHONSAFEPATH": "1",
    }
    begun = time.monotonic()
    ran = subprocess.run(
        [*command, str(ROOT / "scripts" / "answers.py")],
        cwd=folder, env=environment, capture_output=True, text=True, check=False,
    )  # fmt: skip
    if ran.returncode != 0:
        raise SystemExit(f"{name}: {ran.stderr[-3000:]}")
    found = json.loads(ran.stdout)
    print(f"{name}: kernels for {found['target']}, {found['compiled']} compiled, "
          f"{time.monotonic() - begun:.0f} s", flush=True)  # fmt: skip
    if found["compiled"] or store.exists():
        raise SystemExit(f"{name}: machine code was made or written")
    return dict(found["answers"])


if __name__ == "__main__":
    main()
