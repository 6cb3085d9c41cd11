"""Wheels with machine code: what is added to the pure one, and where it counts."""

import base64
import hashlib
import importlib.util
import subprocess
import sys
import zipfile
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).parents[1]
NAME = "armwright-0.1.0-py3-none-any.whl"
FACTS = "Wheel-Version: 1.0\nGenerator: test\nRoot-Is-Purelib: true\nTag: py3-none-any\n"


def load(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, ROOT / "scripts" / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def whole(tmp_path: Path) -> Path:
    info = "armwright-0.1.0.dist-info"
    contents = {
        "compiled/__init__.py": "",
        f"{info}/METADATA": "Metadata-Version: 2.1\nName: armwright\nVersion: 0.1.0\n",
        f"{info}/WHEEL": FACTS,
        f"{info}/RECORD": "compiled/__init__.py,sha256=x,0\n",
    }
    with zipfile.ZipFile(tmp_path / NAME, "w") as pure:
        for name, content in contents.items():
            pure.writestr(name, content)
    kernels = []
    for name in ("one", "two"):
        (tmp_path / name).write_bytes(name.encode())
        kernels.append(tmp_path / name)
    (tmp_path / "out").mkdir()
    found = load("wheels").add_kernels(tmp_path / NAME, kernels, tmp_path / "out")
    assert isinstance(found, Path)
    return found


def test_it_is_for_this_python_and_platform_and_holds_the_machine_code(whole: Path) -> None:
    version = f"cp{sys.version_info[0]}{sys.version_info[1]}"
    assert whole.name.startswith(f"armwright-0.1.0-{version}-{version}-linux_")
    with zipfile.ZipFile(whole) as wheel:
        assert wheel.read("compiled/kernels/two") == b"two"
        facts = wheel.read("armwright-0.1.0.dist-info/WHEEL").decode()
    assert "Root-Is-Purelib: false" in facts
    assert f"Tag: {version}-{version}-linux_" in facts
    assert "any" not in facts


def test_every_file_is_recorded_with_its_digest(whole: Path) -> None:
    with zipfile.ZipFile(whole) as wheel:
        lines = wheel.read("armwright-0.1.0.dist-info/RECORD").decode().splitlines()
        recorded = {line.split(",")[0]: line.split(",")[1:] for line in lines}
        assert set(recorded) == set(wheel.namelist())
        for name, (digest, size) in recorded.items():
            if name.endswith("RECORD"):
                assert (digest, size) == ("", "")
                continue
            content = wheel.read(name)
            wanted = base64.urlsafe_b64encode(hashlib.sha256(content).digest()).rstrip(b"=")
            assert (digest, size) == (f"sha256={wanted.decode()}", str(len(content)))


def test_pip_installs_it_here(whole: Path, tmp_path: Path) -> None:
    command = [sys.executable, "-m", "pip", "install", "-q", "--no-index", "--no-deps"]
    subprocess.run([*command, "--target", str(tmp_path / "site"), str(whole)], check=True)
    assert (tmp_path / "site/compiled/kernels/one").read_bytes() == b"one"
