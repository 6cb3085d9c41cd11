"""The checker in C, built here and as WebAssembly of pages: the verdicts of the one on balls."""

import gzip
import subprocess
import sys
from collections.abc import Callable
from copy import deepcopy
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import wasmtime

from checkers import build_wasm as builder
from tests.planning.witness.by_hand import document
from tests.planning.witness.problems import (
    ROOT,
    checker,
    compact,
    meshes,
    peg_in_tube,
    planned,
    rejected,
    reports,
)
from tests.planning.witness.test_by_hand import FALSE, split
from tests.planning.witness.test_witness import MUTATIONS

SOURCE = ROOT / "checkers/c/armwright_check.c"
PROGRAM = gzip.decompress(builder.TARGET.read_bytes())
Check = Callable[[dict[str, Any] | bytes], tuple[int, str]]


@pytest.fixture(scope="module")
def check(tmp_path_factory: pytest.TempPathFactory) -> Check:
    """The exit code of the command and what it says, for a witness."""
    folder = tmp_path_factory.mktemp("checker")
    program, file = folder / "armwright-check", folder / "witness"
    flags = ("-std=c11", "-O2", "-Wall", "-Wextra", "-Werror", "-ffp-contract=off")
    words = (sys.executable, "-m", "ziglang", "cc", *flags, "-o", program, SOURCE, "-lm")
    subprocess.run(words, check=True, timeout=120)

    def checked(witness: dict[str, Any] | bytes) -> tuple[int, str]:
        file.write_bytes(witness if isinstance(witness, bytes) else compact(witness))
        done = subprocess.run(
            (program, file), capture_output=True, check=False, timeout=20,
            text=True, errors="replace",
        )  # fmt: skip
        return done.returncode, done.stdout

    return checked


@pytest.fixture(scope="module")
def pages(tmp_path_factory: pytest.TempPathFactory) -> Check:
    """The same of the program that pages have, each file in an instance of its own."""
    folder, engine = tmp_path_factory.mktemp("wasm"), wasmtime.Engine()
    module = wasmtime.Module(engine, PROGRAM)

    def checked(witness: dict[str, Any] | bytes) -> tuple[int, str]:
        (folder / "in").write_bytes(witness if isinstance(witness, bytes) else compact(witness))
        system = wasmtime.WasiConfig()
        system.argv = ["armwright-check", "-"]
        system.stdin_file = str(folder / "in")
        system.stdout_file = str(folder / "out")
        store, linker = wasmtime.Store(engine), wasmtime.Linker(engine)
        store.set_wasi(system)
        linker.define_wasi()
        start = linker.instantiate(store, module).exports(store)["_start"]
        assert isinstance(start, wasmtime.Func)
        with pytest.raises(wasmtime.ExitTrap) as ended:
            start(store)
        return ended.value.code, (folder / "out").read_text()

    return checked


def test_the_program_of_pages_is_built_from_this_source() -> None:
    """Byte for byte: ``python checkers/build_wasm.py`` builds it anew."""
    assert builder.built() == PROGRAM


def test_its_package_builds_the_command(tmp_path: Path) -> None:
    """As ``pip install checkers/c`` does, and the command tells how it is used."""
    folder = SOURCE.parent
    places = ("--build-base", tmp_path, "--build-temp", tmp_path)
    words = (sys.executable, "setup.py", "build", *places)
    subprocess.run(words, check=True, cwd=folder, capture_output=True, timeout=120)
    file, command = tmp_path / "witness", tmp_path / "armwright-check"
    file.write_bytes(compact(document()))
    assert subprocess.run((command, file), check=False, capture_output=True).returncode == 0
    told = subprocess.run((command,), check=False, capture_output=True, text=True)
    assert (told.returncode, told.stderr) == (3, "usage: armwright-check FILE\n")


def test_certified_motions_are_accepted(check: Check, pages: Check) -> None:
    """With the gap that balls prove, but for its own rounding."""
    cases: list[tuple[Any, ...]] = [(planned, "ur5e", "crowd", 4), (meshes, 3)]
    cases.append((planned, "panda", "crowd", 2, 0.01))
    items = [item for made, *words in cases for item in made(*words)]
    seen = [report for case in cases for report in reports(*case)]
    for item, report in zip(items, seen, strict=True):
        code, said = check(item.document)
        assert (code, said[:9]) == (0, "accepted:")
        assert pages(item.document) == (code, said)
        told = float(said.partition("apart by ")[2].partition(" m ")[0])
        # It is told with six digits.
        assert told == pytest.approx(report.clearance, rel=1e-5, abs=1e-10)
    for one in (check, pages):
        code, said = one(peg_in_tube().document)
        assert code == 2
        assert "not witnessed: pair" in said


def test_the_witness_by_hand_is_accepted(check: Check) -> None:
    """In one piece and in two."""
    assert check(document())[0] == 0
    halves = document()
    split([])(halves)
    assert check(halves)[0] == 0


@pytest.mark.parametrize("name", FALSE)
def test_a_false_witness_is_rejected(check: Check, pages: Check, name: str) -> None:
    """As by the other checker."""
    change, _ = FALSE[name]
    false = document()
    change(false)
    for one in (check, pages):
        code, said = one(false)
        assert code == 1
        assert said.startswith("rejected:")


def test_both_checkers_agree_on_mutations(check: Check) -> None:
    """On each kind, of several motions."""
    random, verdicts = np.random.default_rng(29), {True: 0, False: 0}
    for item in planned("ur5e", "crowd", 4):
        for mutation in MUTATIONS:
            mutant = deepcopy(item.document)
            mutation(mutant, random)
            good = rejected(mutant) is None
            assert (check(mutant)[0] == 0) is good, mutation.__name__
            verdicts[good] += 1
    assert verdicts[False] > 40


def test_bytes_that_are_changed_crash_nothing(check: Check) -> None:
    """Whatever stands there: both checkers give a verdict, and the same one."""
    random, content = np.random.default_rng(7), compact(planned("ur5e", "crowd", 4)[0].document)
    for _ in range(150):
        changed = bytearray(content)
        for k in random.integers(4, len(content), random.integers(1, 4)):
            changed[k] = random.integers(256)
        code, said = check(bytes(changed))
        assert code in {0, 1, 2}, said
        try:
            told: str | None = rejected(checker().read(bytes(changed)))
        except (checker().Rejected, ValueError) as error:
            told = str(error)
        assert (code == 1) is (told is not None), (said, told)
