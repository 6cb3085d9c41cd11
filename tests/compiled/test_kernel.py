"""The `kernel` decorator: semantics, and machine code on disk that is never stale."""

import shutil
import threading
from collections.abc import Callable
from pathlib import Path

import pytest

from compiled.compiler import store
from compiled.compiler.fingerprint import identity
from tests.compiled.programs import BIG_PROGRAM, python, write_big

pytestmark = pytest.mark.usefixtures("_nothing_kept")


CALLER = """
import folder.callee
from folder import callee
from compiled.kernel import kernel

@kernel
def top(x: float) -> float:
    return middle(x) + callee.OFFSET

@kernel
def middle(x: float) -> float:
    return folder.callee.base(x)
"""


CALLEE = """
from compiled.kernel import kernel

OFFSET = 1.0

@kernel
def base(x: float) -> float:
    return 2.0 * x
"""


PROGRAM = "import caller; print(caller.top(3.0), sum(caller.top.stats.cache_hits.values()))"


def run(folder: Path, **environment: str) -> tuple[float, int]:
    """The value of the kernel and how often its machine code came from disk, in a new process."""
    value, hits = python(PROGRAM, folder, **environment).split()
    return float(value), int(hits)


def write(folder: Path) -> Path:
    """A folder with both modules."""
    (folder / "folder").mkdir()
    (folder / "caller.py").write_text(CALLER)
    (folder / "folder" / "callee.py").write_text(CALLEE)
    return folder


@pytest.fixture(scope="module")
def first(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The modules with their machine code, made once; not to be written to."""
    folder = write(tmp_path_factory.mktemp("first"))
    assert run(folder) == (7.0, 0)
    return folder


@pytest.fixture
def compiled(first: Path, tmp_path: Path) -> Path:
    """A copy of the modules with their machine code."""
    copied = tmp_path / "compiled"
    shutil.copytree(first, copied, ignore=shutil.ignore_patterns("__pycache__"))
    return copied


def test_an_edited_callee_in_another_file_is_recompiled(compiled: Path) -> None:
    assert run(compiled) == (7.0, 1)
    (compiled / "folder" / "callee.py").write_text(CALLEE.replace("2.0 * x", "10.0 * x"))
    assert run(compiled) == (31.0, 0)
    (compiled / "folder" / "callee.py").write_text(CALLEE.replace("OFFSET = 1.0", "OFFSET = 5.0"))
    assert run(compiled) == (11.0, 0)


def test_a_kernel_that_keeps_the_lock_has_a_door_of_its_own(compiled: Path) -> None:
    doors = len(list((compiled / "cache").glob("caller.top*.door*")))
    locked = CALLER.replace("@kernel\ndef top", "@kernel(unlocks=False)\ndef top")
    (compiled / "caller.py").write_text(locked)
    assert run(compiled) == (7.0, 1)
    assert len(list((compiled / "cache").glob("caller.top*.door*"))) == doors + 1


def test_an_edit_that_changes_no_code_keeps_the_machine_code(compiled: Path) -> None:
    (compiled / "folder" / "callee.py").write_text("# a remark\n\n\n" + CALLEE + "# another\n")
    assert run(compiled) == (7.0, 1)


def test_another_checkout_shares_the_machine_code(compiled: Path, tmp_path: Path) -> None:
    other = tmp_path / "other"
    other.mkdir()
    (compiled / "caller.py").rename(other / "caller.py")
    (compiled / "folder").rename(other / "folder")
    assert run(other, NUMBA_CACHE_DIR=str(compiled / "cache")) == (7.0, 1)


def test_another_target_has_machine_code_of_its_own(compiled: Path) -> None:
    assert run(compiled, ARMWRIGHT_KERNEL_TARGET="x86-64") == (7.0, 0)
    assert run(compiled, ARMWRIGHT_KERNEL_TARGET="x86-64") == (7.0, 1)
    assert run(compiled, NUMBA_CPU_NAME="nehalem") == (7.0, 0)


def test_shipped_machine_code_is_used_and_nothing_is_written(compiled: Path) -> None:
    shipped = compiled / "shipped"
    (compiled / "cache").rename(shipped)
    before = {path: path.stat().st_mtime_ns for path in shipped.iterdir()}
    assert run(compiled, ARMWRIGHT_KERNELS=str(shipped)) == (7.0, 1)
    assert not (compiled / "cache").exists()
    assert {path: path.stat().st_mtime_ns for path in shipped.iterdir()} == before


def test_damaged_machine_code_is_made_again(compiled: Path) -> None:
    for path in (compiled / "cache").iterdir():
        path.write_bytes(path.read_bytes()[:-20])
    assert run(compiled) == (7.0, 0)
    assert run(compiled) == (7.0, 1)


def test_machine_code_whose_callee_is_gone_is_made_again(tmp_path: Path) -> None:
    answer = python(BIG_PROGRAM, write_big(tmp_path))
    for path in (tmp_path / "cache").glob("big.large-*"):
        path.unlink()
    assert python(BIG_PROGRAM, tmp_path) == answer


def test_a_folder_that_can_not_be_written_is_said_once(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "file").touch()
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "file"))
    store.write("one", b"")
    store.write("two", b"")
    assert [record.levelname for record in caplog.records] == ["WARNING"]
    assert store.read("one") is None


def test_processes_that_write_at_once_leave_whole_files(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    contents = [bytes([number]) * 1_000_000 for number in range(8)]
    writers = [threading.Thread(target=store.write, args=("x", one)) for one in contents]
    for writer in writers:
        writer.start()
    while any(writer.is_alive() for writer in writers):
        assert store.read("x") in [None, *contents]
    assert [path.name for path in tmp_path.iterdir()] == ["x.kernel"]


#: Kernels that differ in what they close over, too large to be copied into their callers.
MAKER = """
from math import atan2, sqrt
from compiled.kernel import kernel

def made(factor):
    @kernel
    def inner(x):
        y = z = x
LINES
        return y + z
    return inner
""".replace(
    "LINES",
    12
    * """
        y = sqrt(abs(z) + factor) + atan2(y, factor) + sqrt(y * y + z * z)
        z = atan2(z, y) + sqrt(y * y + 3.0) + atan2(factor, z)
""",
)


USER = """
from compiled.kernel import kernel
from maker import made

inner = made({factor})

@kernel
def outer(x):
    return inner(x) + inner(2.0 * x)
"""


COUNTED = "from compiled.compiler import symbol as s; s.rename = lambda *_: None\n"


LOAD_BOTH = """
import one, two
print(one.outer(5.0), two.outer(5.0))
assert all(sum(k.stats.cache_hits.values()) == 1 for k in (one.outer, two.outer))
"""


def namesakes(folder: Path, mend: str = "") -> tuple[list[str], list[str]]:
    """What kernels of two processes that count alike answer there, and loaded into one process."""
    (folder / "maker.py").write_text(MAKER)
    alone = []
    for name, factor in (("one", 2.0), ("two", 30.0)):
        (folder / f"{name}.py").write_text(USER.format(factor=factor))
        program = f"{mend}import {name}; print({name}.outer(5.0))"
        alone.append(python(program, folder).strip())
    return alone, python(mend + LOAD_BOTH, folder).split()


def test_caches_of_two_processes_are_loaded_into_one(tmp_path: Path) -> None:
    alone, together = namesakes(tmp_path)
    assert together == alone


def test_numbas_count_would_mix_caches_of_two_processes_up(tmp_path: Path) -> None:
    alone, together = namesakes(tmp_path, COUNTED)
    assert together != alone


def closure(factor: float) -> Callable[[float], float]:
    def inner(x: float) -> float:
        return factor * x

    return inner


def test_functions_are_named_by_what_they_are_made_from() -> None:
    assert identity(closure(1.0)) == identity(closure(1.0))  # type: ignore[arg-type]
    assert identity(closure(1.0)) != identity(closure(2.0))  # type: ignore[arg-type]
    # What nothing is known of is never taken for another.
    assert identity(closure(object())) != identity(closure(object()))  # type: ignore[arg-type]
