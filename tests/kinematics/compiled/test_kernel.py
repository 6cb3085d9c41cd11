"""The `kernel` decorator: semantics, and machine code on disk that is never stale."""

import math
import os
import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from numba.core.errors import TypingError

from kinematics.compiled import kernel_code, kernel_store
from kinematics.compiled.kernel import direct, kernel
from kinematics.compiled.kernel_fingerprint import fingerprint, identity

ROOT = Path(__file__).parents[3]
Array = np.ndarray[Any, np.dtype[np.float64]]

CALLER = """
import folder.callee
from folder import callee
from kinematics.compiled.kernel import kernel

@kernel
def top(x: float) -> float:
    return middle(x) + callee.OFFSET

@kernel
def middle(x: float) -> float:
    return folder.callee.base(x)
"""
CALLEE = """
from kinematics.compiled.kernel import kernel

OFFSET = 1.0

@kernel
def base(x: float) -> float:
    return 2.0 * x
"""
PROGRAM = "import caller; print(caller.top(3.0), sum(caller.top.stats.cache_hits.values()))"


@pytest.fixture(autouse=True)
def _nothing_kept(
    tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Kernels of this file are compiled here, whatever earlier runs left."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path_factory.mktemp("kernels")))


def python(program: str, folder: Path, **environment: str) -> str:
    """What a program prints in a new process."""
    answer = subprocess.run(
        [sys.executable, "-c", program],
        capture_output=True,
        check=False,
        text=True,
        env={
            **os.environ,
            "PYTHONPATH": f"{ROOT}{os.pathsep}{folder}",
            "NUMBA_CACHE_DIR": str(folder / "cache"),
            **environment,
        },
    )
    assert answer.returncode == 0, answer.stderr
    return answer.stdout


def run(folder: Path, **environment: str) -> tuple[float, int]:
    """The value of the kernel and how often its machine code came from disk, in a new process."""
    value, hits = python(PROGRAM, folder, **environment).split()
    return float(value), int(hits)


@pytest.fixture
def sources(tmp_path: Path) -> Path:
    (tmp_path / "folder").mkdir()
    (tmp_path / "caller.py").write_text(CALLER)
    (tmp_path / "folder" / "callee.py").write_text(CALLEE)
    return tmp_path


# ------------------------------------------------------------------------------------- on disk


def test_an_edited_callee_in_another_file_is_recompiled(sources: Path) -> None:
    assert run(sources) == (7.0, 0)
    assert run(sources) == (7.0, 1)
    (sources / "folder" / "callee.py").write_text(CALLEE.replace("2.0 * x", "10.0 * x"))
    assert run(sources) == (31.0, 0)
    (sources / "folder" / "callee.py").write_text(CALLEE.replace("OFFSET = 1.0", "OFFSET = 5.0"))
    assert run(sources) == (11.0, 0)


def test_a_kernel_that_keeps_the_lock_has_a_door_of_its_own(sources: Path) -> None:
    run(sources)
    doors = len(list((sources / "cache").glob("caller.top*.door*")))
    locked = CALLER.replace("@kernel\ndef top", "@kernel(unlocks=False)\ndef top")
    (sources / "caller.py").write_text(locked)
    assert run(sources) == (7.0, 1)
    assert len(list((sources / "cache").glob("caller.top*.door*"))) == doors + 1


def test_an_edit_that_changes_no_code_keeps_the_machine_code(sources: Path) -> None:
    run(sources)
    (sources / "folder" / "callee.py").write_text("# a remark\n\n\n" + CALLEE + "# another\n")
    assert run(sources) == (7.0, 1)


def test_another_checkout_shares_the_machine_code(sources: Path, tmp_path: Path) -> None:
    run(sources)
    other = tmp_path / "other"
    other.mkdir()
    (sources / "caller.py").rename(other / "caller.py")
    (sources / "folder").rename(other / "folder")
    assert run(other, NUMBA_CACHE_DIR=str(sources / "cache")) == (7.0, 1)


def test_another_target_has_machine_code_of_its_own(sources: Path) -> None:
    assert run(sources) == (7.0, 0)
    assert run(sources, ARMWRIGHT_KERNEL_TARGET="x86-64") == (7.0, 0)
    assert run(sources, ARMWRIGHT_KERNEL_TARGET="x86-64") == (7.0, 1)
    assert run(sources, NUMBA_CPU_NAME="nehalem") == (7.0, 0)


def test_shipped_machine_code_is_used_and_nothing_is_written(sources: Path) -> None:
    run(sources)
    shipped = sources / "shipped"
    (sources / "cache").rename(shipped)
    before = {path: path.stat().st_mtime_ns for path in shipped.iterdir()}
    assert run(sources, ARMWRIGHT_KERNELS=str(shipped)) == (7.0, 1)
    assert not (sources / "cache").exists()
    assert {path: path.stat().st_mtime_ns for path in shipped.iterdir()} == before


def test_damaged_machine_code_is_made_again(sources: Path) -> None:
    run(sources)
    for path in (sources / "cache").iterdir():
        path.write_bytes(path.read_bytes()[:-20])
    assert run(sources) == (7.0, 0)
    assert run(sources) == (7.0, 1)


def test_machine_code_whose_callee_is_gone_is_made_again(sources: Path) -> None:
    first = python(BIG_PROGRAM, write_big(sources), NUMBA_NRT_STATS="1")
    for path in (sources / "cache").glob("big.large-*"):
        path.unlink()
    assert python(BIG_PROGRAM, sources, NUMBA_NRT_STATS="1") == first


def test_a_folder_that_can_not_be_written_is_said_once(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "file").touch()
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "file"))
    kernel_store.write("one", b"")
    kernel_store.write("two", b"")
    assert [record.levelname for record in caplog.records] == ["WARNING"]
    assert kernel_store.read("one") is None


def test_processes_that_write_at_once_leave_whole_files(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    contents = [bytes([number]) * 1_000_000 for number in range(8)]
    writers = [threading.Thread(target=kernel_store.write, args=("x", one)) for one in contents]
    for writer in writers:
        writer.start()
    while any(writer.is_alive() for writer in writers):
        assert kernel_store.read("x") in [None, *contents]
    assert [path.name for path in tmp_path.iterdir()] == ["x"]


# ------------------------------------------------------------------------------------- symbols

#: Kernels that differ in what they close over; too large to be inlined, too small to be called.
MAKER = """
from math import atan2, sqrt
from kinematics.compiled.kernel import kernel

def made(factor):
    @kernel
    def inner(x):
        y = z = x
LINES
        return y + z
    return inner
""".replace(
    "LINES",
    6
    * """
        y = sqrt(abs(z) + factor) + atan2(y, factor) + sqrt(y * y + z * z)
        z = atan2(z, y) + sqrt(y * y + 3.0) + atan2(factor, z)
""",
)
USER = """
from kinematics.compiled.kernel import kernel
from maker import made

inner = made({factor})

@kernel
def outer(x):
    return inner(x) + inner(2.0 * x)
"""
COUNTED = "from kinematics.compiled import kernel_symbol as s; s.rename = lambda *_: None\n"
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


# ------------------------------------------------------------------------------------- calls

BIG = """
import numpy as np
from kinematics.compiled.kernel import kernel

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
BIG_PROGRAM = """
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
assert references == sys.getrefcount(values)
assert after.alloc - before.alloc == after.free - before.free
"""


def write_big(folder: Path) -> Path:
    (folder / "big.py").write_text(BIG)
    return folder


def test_a_large_kernel_is_called_with_errors_and_arrays_intact(tmp_path: Path) -> None:
    fresh = python(BIG_PROGRAM, write_big(tmp_path), NUMBA_NRT_STATS="1")
    assert fresh.splitlines()[1] == "too much"
    assert python(BIG_PROGRAM, tmp_path, NUMBA_NRT_STATS="1") == fresh
    caller = next((tmp_path / "cache").glob("big.caller-*[0-9a-f]"))
    large = next((tmp_path / "cache").glob("big.large-*[0-9a-f]"))
    assert large.name.encode() in caller.read_bytes()


@kernel
def ratio(numerator: float, denominator: float) -> float:
    return numerator / denominator


@kernel(inline="always", fastmath=True)
def total(values: Array) -> float:
    sum_ = 0.0
    for value in values:
        sum_ += value
    return sum_


@kernel
def scaled(values: Array, by: int) -> float:
    return float(values[0] * by)


@kernel
def scaled_thrice(values: Array) -> float:
    return scaled(values, 2) + scaled(values, 3) + scaled(values, by=int(values[0]))


def test_literals_in_calls_make_no_signatures_of_their_own() -> None:
    assert scaled_thrice(np.array([4.0])) == 36.0
    assert len(scaled.overloads) == 1  # type: ignore[attr-defined]


def test_a_kernel_that_only_kernels_call_has_no_door() -> None:
    assert scaled_thrice(np.array([4.0])) == 36.0
    names = [name for name in kernel_code._codes if "test_kernel.scaled-" in name]
    assert names
    assert not [name for name in names if "door" in name]
    # Python may call it all the same, and then it gets one.
    assert scaled(np.array([4.0]), 2) == 8.0


@kernel
def factorial(n: int) -> int:
    return 1 if n < 2 else n * factorial(n - 1)


@kernel
def even(n: int) -> bool:
    return True if n == 0 else odd(n - 1)


@kernel
def odd(n: int) -> bool:
    return False if n == 0 else even(n - 1)


def test_a_kernel_may_call_itself_but_not_by_way_of_another() -> None:
    assert factorial(5) == 120
    with pytest.raises(NotImplementedError, match="calls itself by way of another"):
        even(4)


class Pair(NamedTuple):
    left: Array
    right: Array


@kernel
def swapped(pair: Pair) -> Pair:
    return Pair(pair.right, pair.left)


def test_tuples_of_arrays_go_through_doors() -> None:
    left, right = np.arange(3.0), np.arange(4.0)
    answer = swapped(Pair(left, right))
    assert isinstance(answer, Pair)
    assert np.shares_memory(answer.left, right)
    assert direct(swapped, Pair(left, right))(Pair(right, left)).right.size == 4


@kernel
def measure(pair: Pair, at: int) -> float:
    return float(pair.left[at] * pair.right[at])


@kernel
def both(pair: Pair) -> float:
    return measure(pair, 0) + measure(pair, 1)


@kernel
def clear(values: Array) -> None:
    values[0] = 0.0


@kernel
def clear_somewhere(pair: Pair, right: bool) -> float:
    end = pair.left[1:]
    if right:
        end = pair.right
    clear(end)
    return 0.0


@kernel
def clear_and_measure(pair: Pair, out: Pair) -> float:
    out.left[0] = 1.0
    return measure(pair, 0) + measure(out, 1)


def constant(values: Array) -> Array:
    values.flags.writeable = False
    return values


def test_a_kernel_that_only_reads_is_compiled_once_for_constant_arrays() -> None:
    for left in (np.ones(2), constant(np.ones(2))):
        for right in (np.ones(2), constant(np.ones(2))):
            assert both(Pair(left, right)) == 2.0
    assert len(both.overloads) == len(measure.overloads) == 1  # type: ignore[attr-defined]


def test_a_kernel_that_writes_calls_one_that_reads_with_all_kinds_of_tuples() -> None:
    for left in (np.ones(2), constant(np.ones(2))):
        for pair in (Pair(left, np.ones(2)), Pair(left, constant(np.ones(2)))):
            assert clear_and_measure(pair, Pair(np.ones(2), constant(np.ones(2)))) == 2.0


@pytest.mark.parametrize("right", [False, True])
def test_a_kernel_that_writes_refuses_constant_arrays(right: bool) -> None:
    for pair in (Pair(constant(np.ones(2)), np.ones(2)), Pair(np.ones(2), constant(np.ones(2)))):
        with pytest.raises(TypingError):
            clear_somewhere(pair, right)
    assert clear_somewhere(Pair(np.ones(2), np.ones(2)), right) == 0.0


def test_division_by_zero_follows_ieee_754() -> None:
    assert ratio(1.0, 0.0) == math.inf
    assert math.isnan(ratio(0.0, 0.0))


def test_options_are_passed_on() -> None:
    values = np.random.default_rng(0).normal(size=1000)
    assert total(values) == pytest.approx(math.fsum(values), rel=1e-12)
    assert total.targetoptions["fastmath"] is True  # type: ignore[attr-defined]
    assert ratio.targetoptions["fastmath"] is False  # type: ignore[attr-defined]


def test_fingerprint_tells_kernels_apart_and_repeats() -> None:
    assert fingerprint(ratio) == fingerprint(ratio)
    assert fingerprint(ratio) != fingerprint(total)
