"""Wheels: one package, whole where it is installed; machine code that is added to one."""

import base64
import hashlib
import importlib.util
import os
import shutil
import subprocess
import sys
import sysconfig
import zipfile
from importlib.metadata import version
from pathlib import Path
from types import ModuleType

import pytest

from compiled.compiler.dispatcher import FROZEN
from compiled.compiler.store import user_folder

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
        "armwright/__init__.py": "",
        f"{info}/METADATA": "Metadata-Version: 2.1\nName: armwright\nVersion: 0.1.0\n",
        f"{info}/WHEEL": FACTS,
        f"{info}/RECORD": "armwright/__init__.py,sha256=x,0\n",
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
        assert wheel.read("armwright/_src/compiled/kernels/two") == b"two"
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
    assert (tmp_path / "site/armwright/_src/compiled/kernels/one").read_bytes() == b"one"


@pytest.fixture(scope="module")
def environment(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A new virtual environment with both wheels, which borrows what they depend on."""
    folder = tmp_path_factory.mktemp("wheels")
    source = load("wheels").copy_sources(folder)
    # Without the network where this environment has a new enough setuptools.
    ours = ["--no-build-isolation"] if int(version("setuptools").split(".")[0]) >= 77 else []
    build = ["wheel", "-q", "--no-deps", *ours, "-w", str(folder / "dist")]
    subprocess.run(
        [sys.executable, "-m", "pip", *build, str(source), str(source / "client")], check=True
    )
    home = folder / "environment"
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", str(home)], check=True)
    wheels = map(str, folder.glob("dist/*.whl"))
    install = ["--python", str(home / "bin/python"), "install", "-q", "--no-deps", "--no-index"]
    subprocess.run([sys.executable, "-m", "pip", *install, *wheels], check=True)
    (site,) = home.glob("lib/python*/site-packages")
    # Editable installs among these are not followed.
    (site / "dependencies.pth").write_text(sysconfig.get_paths()["purelib"])
    return home


def outside(environment: Path, folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    """Run a module or program with the Python of an environment, in a folder of its own."""
    settings = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    return subprocess.run(
        [environment / "bin/python", *words], cwd=folder, env=settings, check=False,
        capture_output=True, text=True,
    )  # fmt: skip


def test_one_package_is_installed(environment: Path) -> None:
    (site,) = environment.glob("lib/python*/site-packages")
    folders = {path.name for path in site.iterdir() if path.is_dir() and "-" not in path.name}
    assert folders == {"armwright", "armwright_client", "armwright_wire"}
    (names,) = site.glob("armwright-*.dist-info/top_level.txt")
    assert names.read_text() == "armwright\n"


@pytest.mark.timeout(300)
def test_the_installed_wheel_plans_serves_and_obeys_commands(
    environment: Path, tmp_path: Path
) -> None:
    (tmp_path / "planning").mkdir()
    (tmp_path / "planning/__init__.py").write_text("MINE = True\n")
    shutil.copy2(ROOT / "tests/wheel_checks.py", tmp_path)
    ran = outside(environment, tmp_path, "wheel_checks.py")
    assert ran.returncode == 0, ran.stderr[-3000:]
    assert ran.stdout.count("check_") == 4


@pytest.mark.timeout(300)
def test_type_checkers_see_names_from_outside(environment: Path, tmp_path: Path) -> None:
    (tmp_path / "program.py").write_text(
        "import armwright as aw\nfrom armwright_client import Client, LimitsAt\n"
        "aw.planx\nreveal_type(aw.load_robot)\nreveal_type(Client.close)\n"
        "LimitsAt(begin=0.0, end=1.0)\nLimitsAt(begin=0.0)\n"
    )
    cache = ["--cache-dir", str(ROOT / ".mypy_cache/outside")]
    python = ["--python-executable", str(environment / "bin/python")]
    settings = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    ran = subprocess.run(
        [sys.executable, "-m", "mypy", "--strict", *cache, *python, "program.py"],
        cwd=tmp_path, env=settings, check=False, capture_output=True, text=True,
    )  # fmt: skip
    assert 'program.py:3: error: Module has no attribute "planx"' in ran.stdout
    assert "RobotGeometry" in ran.stdout.splitlines()[1]
    assert "armwright_client" in ran.stdout.splitlines()[2]
    assert 'program.py:7: error: Missing named argument "end"' in ran.stdout
    assert ran.stdout.count("error") == 3, ran.stdout


@pytest.mark.timeout(300)
def test_kernels_that_are_missing_are_compiled_at_first_use(
    environment: Path, tmp_path: Path
) -> None:
    store = tmp_path / "store"
    store.mkdir(mode=0o700)
    for file in user_folder().glob("*.kernel"):
        if not file.name.startswith("obstacles.convex.sphere_cover.cover-"):
            shutil.copy2(file, store)
    program = "import armwright as aw; print(aw.load_robot('planar_rr'))"
    settings = os.environ | {"NUMBA_CACHE_DIR": str(store), FROZEN: "0"}
    settings.pop("PYTHONPATH", None)
    for expected in ("Compiling kernels: 0 of ", ""):
        ran = subprocess.run(
            [environment / "bin/python", "-c", program], cwd=tmp_path, env=settings, check=True,
            capture_output=True, text=True,
        )  # fmt: skip
        assert ran.stderr[: len(expected)] == expected
        assert bool(ran.stderr) == bool(expected), "they are kept"
        shutil.rmtree(store / "solids", ignore_errors=True)
