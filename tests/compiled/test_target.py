"""Stores of machine code and the kinds of processors it is made for."""

import json
import os
import pickle
import subprocess
import sys
from pathlib import Path

import pytest

from compiled.compiler import dispatcher, store
from compiled.compiler import target as kernel_target
from kinematics.model.dh import DhRow
from tests.compiled.programs import python

ROOT = Path(__file__).parents[2]
#: Kernels with vectors of eight, with sums that LLVM may contract, and with neither.
ANSWERS = """
import hashlib, json
import numpy as np
from dynamics.inverse import inverse_dynamics
from compiled.compiler.target import target
from kinematics.forward import forward
from kinematics.jacobian import geometric
from kinematics.robots import builtin_chain
import armwright
answers = {}
for name in ("panda", "ur5e", "scara"):
    chain = builtin_chain(name)
    q, v, a = np.random.default_rng(3).uniform(-1.0, 1.0, (3, 50, chain.n))
    answers[name] = [
        hashlib.sha256(np.ascontiguousarray(found).tobytes()).hexdigest()
        for found in (
            forward(chain, q), geometric(chain, q), forward(chain, q[0]), geometric(chain, q[0]),
            inverse_dynamics(chain, q, v, a), inverse_dynamics(chain, q[0], v[0], a[0]),
            *armwright.dynamics(chain, q[0], v[0]), *armwright.dynamics(chain, q, v),
        )
    ]
print(json.dumps([target().name, answers]))
"""


def ask(target: str) -> list[object]:
    """The target that was taken and digests of answers, in a new process."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "ARMWRIGHT_KERNEL_TARGET": target}
    environment.pop("NUMBA_CPU_NAME", None)
    command = [sys.executable, "-c", ANSWERS]
    ran = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert ran.returncode == 0, ran.stderr
    found: list[object] = json.loads(ran.stdout)
    return found


def test_wider_vectors_answer_with_the_same_bits() -> None:
    wide = "x86-64-v4" if kernel_target.available("x86-64-v4") else "native"
    name, answers = ask("x86-64-v3")
    other, others = ask(wide)
    assert name == "x86-64-v3"
    assert wide in (other, "native")
    assert answers == others


@pytest.mark.parametrize(
    ("features", "usual"),
    [
        (kernel_target._V4, "x86-64-v4"),
        (kernel_target._V4 - {"avx512bw"}, "x86-64-v3"),
        (kernel_target._V3, "x86-64-v3"),
        (kernel_target._V3 - {"fma"}, "native"),
        (frozenset(), "native"),
    ],
)
def test_the_widest_kind_that_the_processor_is_of_is_usual(
    features: frozenset[str], usual: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(kernel_target, "_features", lambda: features)
    assert kernel_target.usual() == usual
    assert kernel_target.available(usual)


def test_a_kind_that_is_none_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ARMWRIGHT_KERNEL_TARGET", "x86-64-v5")
    with pytest.raises(ValueError, match="x86-64-v4"):
        kernel_target.target.__wrapped__()


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
