"""Names of modules in a checkout and in a wheel, whose kernels are the same."""

import pickle
from pathlib import Path

import pytest

from compiled.compiler import dispatcher, store
from kinematics.model.dh_table import DhRow
from tests.compiled.programs import python


def test_names_are_those_of_a_checkout_and_lead_here() -> None:
    for name in ("planning.problem", "armwright._src.planning.problem"):
        assert store.plain(name) == "planning.problem"
        assert store.here(name) == "planning.problem"
    assert store.here("numpy.linalg") == "numpy.linalg"


def test_a_wheel_reads_what_a_checkout_wrote(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(store, "HERE", "armwright._src.")
    assert store.here("planning.problem") == "armwright._src.planning.problem"
    assert store.here("json.decoder") == "json.decoder"
    with pytest.raises(ModuleNotFoundError, match=r"armwright\._src"):
        store.loads(pickle.dumps(DhRow("revolute", 1.0, 0.0, 0.0, 0.0), protocol=4))
    assert store.loads(pickle.dumps([1, "planning.problem"])) == [1, "planning.problem"]


def test_a_checkout_reads_what_a_wheel_wrote() -> None:
    row = DhRow("revolute", 1.0, 0.0, 0.0, 0.0)
    content = pickle.dumps(row, protocol=0).replace(
        b"kinematics.model", b"armwright._src.kinematics.model"
    )
    assert repr(store.loads(content)) == repr(row)
    assert isinstance(store.loads(content), DhRow)


PROGRAM = """
from compiled.compiler.dispatcher import before_first
from folder.callee import base

before_first(lambda: print("before"))
print(base(1.0), base(2))
"""
CALLEE = """
from compiled.kernel import kernel

@kernel
def base(x: float) -> float:
    return 2.0 * x
"""


def test_an_action_comes_once_before_the_first_kernel_is_compiled(tmp_path: Path) -> None:
    (tmp_path / "folder").mkdir()
    (tmp_path / "folder/callee.py").write_text(CALLEE)
    unfrozen = {dispatcher.FROZEN: "0"}
    assert python(PROGRAM, tmp_path, **unfrozen) == "before\n2.0 4.0\n"
    assert python(PROGRAM, tmp_path, **unfrozen) == "2.0 4.0\n", "it was kept"
