"""The `kernel` decorator: semantics, and machine code on disk that is never stale."""

import fcntl
import importlib
import math
import os
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest

from kinematics.compiled.kernel import fingerprint, kernel

ROOT = Path(__file__).parents[2]

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


def run(folder: Path, **environment: str) -> tuple[float, int]:
    """The value of the kernel and how often its machine code came from disk, in a new process."""
    answer = subprocess.run(
        [sys.executable, "-c", PROGRAM],
        capture_output=True,
        check=True,
        text=True,
        env={**os.environ, "PYTHONPATH": f"{ROOT}{os.pathsep}{folder}", **environment},
    )
    value, hits = answer.stdout.split()
    return float(value), int(hits)


@pytest.fixture
def sources(tmp_path: Path) -> Path:
    (tmp_path / "folder").mkdir()
    (tmp_path / "caller.py").write_text(CALLER)
    (tmp_path / "folder" / "callee.py").write_text(CALLEE)
    return tmp_path


def test_an_edited_callee_in_another_file_is_recompiled(sources: Path) -> None:
    assert run(sources) == (7.0, 0)
    assert run(sources) == (7.0, 1)
    (sources / "folder" / "callee.py").write_text(CALLEE.replace("2.0 * x", "10.0 * x"))
    assert run(sources) == (31.0, 0)
    (sources / "folder" / "callee.py").write_text(CALLEE.replace("OFFSET = 1.0", "OFFSET = 5.0"))
    assert run(sources) == (11.0, 0)


def test_a_kernel_that_keeps_the_lock_is_recompiled(sources: Path) -> None:
    run(sources)
    locked = CALLER.replace("@kernel\ndef top", "@kernel(unlocks=False)\ndef top")
    (sources / "caller.py").write_text(locked)
    assert run(sources) == (7.0, 0)
    assert run(sources) == (7.0, 1)


def test_an_edit_that_changes_no_code_keeps_the_machine_code(sources: Path) -> None:
    run(sources)
    with (sources / "folder" / "callee.py").open("a") as file:
        file.write("# a remark\n")
    assert run(sources) == (7.0, 1)


def test_cache_folder_of_the_environment_is_used(sources: Path, tmp_path: Path) -> None:
    elsewhere = tmp_path / "elsewhere"
    assert run(sources, NUMBA_CACHE_DIR=str(elsewhere)) == (7.0, 0)
    assert run(sources, NUMBA_CACHE_DIR=str(elsewhere)) == (7.0, 1)
    assert list(elsewhere.rglob("*.nbc"))
    assert not list(sources.glob("**/__pycache__/*.nbc"))


def test_saving_waits_for_the_other_process(sources: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(sources / "folder")
    callee = importlib.import_module("callee")

    cache = Path(callee.base.stats.cache_path)
    descriptor = os.open(cache, os.O_RDONLY)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX)
        other = threading.Thread(target=callee.base, args=(1.0,))
        other.start()
        other.join(1.0)
        assert other.is_alive()
        assert not list(cache.glob("*.nbi"))
    finally:
        os.close(descriptor)
    other.join()
    assert list(cache.glob("*.nbi"))


@kernel
def ratio(numerator: float, denominator: float) -> float:
    return numerator / denominator


@kernel(inline="always", fastmath=True)
def total(values: np.ndarray[tuple[int], np.dtype[np.float64]]) -> float:
    sum_ = 0.0
    for value in values:
        sum_ += value
    return sum_


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
