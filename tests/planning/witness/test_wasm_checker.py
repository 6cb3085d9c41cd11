"""The checker in C as WebAssembly, as pages have it: built from this source, with its verdicts."""

import gzip
from pathlib import Path
from typing import Any

import pytest
import wasmtime

from checkers import build_wasm as builder
from tests.planning.witness.by_hand import document
from tests.planning.witness.problems import compact, meshes, peg_in_tube, planned
from tests.planning.witness.test_by_hand import FALSE

PROGRAM = gzip.decompress(builder.TARGET.read_bytes())


class Checker:
    """Runs the program on files, each in an instance of its own."""

    def __init__(self, folder: Path) -> None:
        self.engine, self.folder = wasmtime.Engine(), folder
        self.module = wasmtime.Module(self.engine, PROGRAM)

    def __call__(self, witness: Any) -> tuple[int, str]:
        """The exit code and what it says."""
        (self.folder / "in").write_bytes(compact(witness))
        system = wasmtime.WasiConfig()
        system.argv = ["armwright-check", "-"]
        system.stdin_file = str(self.folder / "in")
        system.stdout_file = str(self.folder / "out")
        store, linker = wasmtime.Store(self.engine), wasmtime.Linker(self.engine)
        store.set_wasi(system)
        linker.define_wasi()
        start = linker.instantiate(store, self.module).exports(store)["_start"]
        assert isinstance(start, wasmtime.Func)
        with pytest.raises(wasmtime.ExitTrap) as ended:
            start(store)
        return ended.value.code, (self.folder / "out").read_text()


@pytest.fixture(scope="module")
def check(tmp_path_factory: pytest.TempPathFactory) -> Checker:
    return Checker(tmp_path_factory.mktemp("wasm"))


def test_it_is_built_from_this_source() -> None:
    """Byte for byte: ``python checkers/build_wasm.py`` builds it anew."""
    assert builder.built() == PROGRAM


def test_certified_motions_are_accepted(check: Checker) -> None:
    """And what a file leaves open is told."""
    for item in (*planned("ur5e", "crowd", 4), *meshes(3)[:1]):
        assert check(item.document)[0] == 0
    code, said = check(peg_in_tube().document)
    assert code == 2
    assert "not witnessed: pair" in said


@pytest.mark.parametrize("name", FALSE)
def test_a_false_witness_is_rejected(check: Checker, name: str) -> None:
    """As by the other checkers."""
    change, _ = FALSE[name]
    false = document()
    change(false)
    code, said = check(false)
    assert code == 1
    assert said.startswith("rejected:")
