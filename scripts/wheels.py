"""Build wheels of Armwright: pure, with the machine code of all kernels, of client and checker.

    python scripts/wheels.py [--output dist] [--targets x86-64-v3 x86-64-v4]

`pip install --find-links dist armwright` takes them. The second is for the Python that runs this
and for processors of the targets' kinds; pip prefers it where it fits. Elsewhere, and with other
versions of numba, kernels are compiled as from the pure one. A kernel's key holds its code, numba's
version, Python's and the target, so that a wheel can't bring machine code that does not fit.
"""

import argparse
import base64
import hashlib
import os
import shutil
import subprocess
import sys
import sysconfig
import tempfile
import zipfile
from collections.abc import Sequence
from pathlib import Path

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))

from compiled.compiler import target as kernel_target  # noqa: E402

#: Where an installed package looks for machine code first.
_KERNELS = "armwright/_src/compiled/kernels"
#: The first date that a zip file can hold: equal contents make equal wheels.
_DATE = (1980, 1, 1, 0, 0, 0)
#: Program that prints where the machine code of all kernels is, with what it calls.
_FILES = """
from compiled.compiler import kernel_list, machine_code, store
from service.warm_up.kernels import LIST
names = {name: None for entry in kernel_list.read(LIST)[0] for name in entry.files}
for name in (pending := list(names)):
    new = [need for need in machine_code.find(name).needs if need not in names]
    names.update(dict.fromkeys(new))
    pending += new
    print(next(p for folder in store.layers() if (p := store.file_of(folder, name)).exists()))
"""
#: Kinds of processors that a wheel is for; those that this one is of.
_TARGETS = tuple(kind for kind in ("x86-64-v3", "x86-64-v4") if kernel_target.available(kind))


def main() -> None:
    """Build both wheels."""
    parser = argparse.ArgumentParser(description="Build wheels with and without kernels.")
    parser.add_argument("--output", type=Path, default=ROOT / "dist", help="where to (dist)")
    parser.add_argument("--targets", nargs="+", default=_TARGETS, help="kinds of processors")
    chosen = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        source = copy_sources(Path(folder))
        pure = build_pure(source)
        others = [build_pure(source / place) for place in ("client", "checkers/python")]
        kernels = [path for target in chosen.targets for path in compile_for(target, source)]
        chosen.output.mkdir(parents=True, exist_ok=True)
        for wheel in (pure, *others):
            shutil.copy2(wheel, chosen.output)
        whole = add_kernels(pure, kernels, chosen.output)
    for path in (whole, *(chosen.output / wheel.name for wheel in (pure, *others))):
        print(f"{path} ({path.stat().st_size / 1e6:.1f} MB)")


def copy_sources(folder: Path) -> Path:
    """Copy the sources into a folder and give the copy: wheel and kernels are of one state."""
    source = folder / "source"
    ignored = shutil.ignore_patterns("__pycache__", "build", "dist", "*.egg-info", "tests", ".*")
    shutil.copytree(ROOT, source, ignore=ignored)
    return source


def build_pure(source: Path) -> Path:
    """Build the wheel of the sources of a distribution, and give its path."""
    folder = source.parent / f"wheel-of-{source.name}"
    command = [sys.executable, "-m", "pip", "wheel", "-q", "--no-deps", "-w", str(folder)]
    subprocess.run([*command, str(source)], check=True)
    (wheel,) = folder.glob("*.whl")
    return wheel


def compile_for(target: str, source: Path) -> list[Path]:
    """Compile all kernels of a copy of the sources for a kind of processor; give their files.

    Those that this user has compiled already, of the same code, are taken.
    """
    path = os.pathsep.join([str(source), str(source / "client")])
    environment = os.environ | {"PYTHONPATH": path, "ARMWRIGHT_KERNEL_TARGET": target}
    print(f"Kernels for {target}:", flush=True)
    for command in (["-m", "service.cli", "warm"], ["-c", _FILES]):
        ran = subprocess.run(
            [sys.executable, *command], cwd=source, env=environment, check=True,
            stdout=subprocess.PIPE, text=True,
        )  # fmt: skip
    return sorted(map(Path, ran.stdout.split("\n")[:-1]))


def add_kernels(pure: Path, kernels: Sequence[Path], output: Path) -> Path:
    """Write a wheel with machine code, for this Python on this platform, and give its path.

    Args:
        pure: the wheel without.
        kernels: files of machine code.
        output: the folder to write to.
    """
    version = "".join(map(str, sys.version_info[:2]))
    platform = sysconfig.get_platform().replace("-", "_").replace(".", "_")
    tag = f"cp{version}-cp{version}-{platform}"
    whole = output / pure.name.replace("py3-none-any", tag)
    record = []
    with zipfile.ZipFile(pure) as source, zipfile.ZipFile(whole, "w") as wheel:
        contents = {name: source.read(name) for name in source.namelist()}
        (record_name,) = (name for name in contents if name.endswith(".dist-info/RECORD"))
        del contents[record_name]
        (facts,) = (name for name in contents if name.endswith(".dist-info/WHEEL"))
        lines = contents[facts].decode().replace("Root-Is-Purelib: true", "Root-Is-Purelib: false")
        contents[facts] = lines.replace("Tag: py3-none-any", f"Tag: {tag}").encode()
        contents |= {f"{_KERNELS}/{path.name}": path.read_bytes() for path in kernels}
        for name, content in contents.items():
            digest = base64.urlsafe_b64encode(hashlib.sha256(content).digest()).rstrip(b"=")
            record.append(f"{name},sha256={digest.decode()},{len(content)}")
            _write(wheel, name, content)
        _write(wheel, record_name, "\n".join([*record, f"{record_name},,", ""]).encode())
    return whole


def _write(wheel: zipfile.ZipFile, name: str, content: bytes) -> None:
    entry = zipfile.ZipInfo(name, _DATE)
    entry.compress_type = zipfile.ZIP_DEFLATED
    entry.external_attr = 0o644 << 16
    wheel.writestr(entry, content)


if __name__ == "__main__":
    main()
