"""Write the list of kernels that requests reach: what the tests of the service compile.

    python scripts/kernel_list.py [--add | --first]

All is compiled anew in an empty folder, which takes minutes. With --add the kernels on the list are
compiled first, and stay on it: for a request that was added, or a kernel that was changed. With
--first the list stays, and only the names of the kernels that the demonstration calls are written.
"""

import argparse
import os
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))

from compiled.compiler import kernel_list, store  # noqa: E402
from compiled.compiler.dispatcher import FROZEN  # noqa: E402
from service.warm_up import kernels  # noqa: E402

#: What sends requests of every kind.
_TESTS = ("tests/service", "tests/client", "tests/course", "tests/test_readme.py")
#: Kernels take their time to be compiled in the middle of a request [s].
_TIMEOUT = 900
_FIRST_HEAD = """\
# Kernels that Python calls in the demonstration: compiled before all others for `make demo`.
# `make kernel-list` writes this file; so does, by itself, `python scripts/kernel_list.py --first`.
"""


def record(folder: Path, add: bool) -> None:
    """Run what sends requests, with machine code kept in a folder."""
    environment = os.environ | {
        "NUMBA_CACHE_DIR": str(folder),
        "ARMWRIGHT_KERNELS": str(folder),
        FROZEN: "0",
    }
    # Before there are requests, or the servers of the tests would not be ready in time.
    command = "from service.warm_up import warm_requests; list(warm_requests.steps())"
    first = ["-m", "service.cli", "warm"] if add else ["-c", command]
    subprocess.run([sys.executable, *first], cwd=ROOT, env=environment, check=True)
    tests = [sys.executable, "-m", "pytest", "-q", "--timeout", str(_TIMEOUT), *_TESTS]
    # Requests that wait for a compiler may fail; what they compiled counts.
    if subprocess.run(tests, cwd=ROOT, env=environment, check=False).returncode not in (0, 1):
        raise SystemExit("the tests could not be run")


def record_first() -> None:
    """Run the demonstration without any door that Python calls by: those it makes are its own."""
    subprocess.run([sys.executable, "-m", "service.cli", "warm"], cwd=ROOT, check=True)
    kernels.FIRST.write_text(_FIRST_HEAD, "utf-8")
    with tempfile.TemporaryDirectory() as temporary:
        bodies, doors = Path(temporary, "bodies"), Path(temporary, "doors")
        bodies.mkdir()
        doors.mkdir()
        for folder in store.layers():
            for path in folder.iterdir() if folder.is_dir() else ():
                if ".door" not in path.name and not (bodies / path.name).exists():
                    (bodies / path.name).symlink_to(path.resolve())
        environment = os.environ | {
            "NUMBA_CACHE_DIR": str(doors),
            "ARMWRIGHT_KERNELS": str(bodies),
            FROZEN: "0",
        }
        demo = [sys.executable, "examples/demo.py", "--output", temporary]
        subprocess.run(demo, cwd=ROOT, env=environment, check=True)
        made = {path.name.partition("-")[0] for path in doors.glob("*.door*")}
    kernels.FIRST.write_text("\n".join([_FIRST_HEAD, *sorted(made), ""]), "utf-8")
    print(f"{len(made)} kernels that the demonstration calls")


def main() -> None:
    """Record and write the lists."""
    parser = argparse.ArgumentParser(description="Write the list of kernels that requests reach.")
    parser.add_argument("--add", action="store_true", help="keep what is on the list")
    parser.add_argument("--first", action="store_true", help="only those of the demonstration")
    parser.add_argument("--folder", type=Path, help="machine code that is there already")
    chosen = parser.parse_args()
    if chosen.first:
        record_first()
        return
    with tempfile.TemporaryDirectory() as temporary:
        folder = chosen.folder or Path(temporary)
        record(folder, chosen.add)
        entries = kernel_list.stored(folder)
    kernel_list.write(kernels.LIST, entries)
    doors = sum(entry.door for entry in entries)
    print(f"{len(entries)} kernels, {doors} of which Python calls")
    record_first()


if __name__ == "__main__":
    main()
