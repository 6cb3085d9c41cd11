"""Lists of kernels, their compilation in several processes, and stores for each processor."""

import json
import os
import pickle
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from compiled.compiler import dispatcher, store
from compiled.compiler import target as kernel_target
from kinematics.model.dh import DhRow
from tests.compiled.programs import ROOT, python, run

#: A chain of large kernels, each calling the one before, and a small one that is copied.
KERNELS = (
    """
import numpy as np
from compiled.kernel import kernel

@kernel(fastmath=True)
def small(x):
    return x + 1.0

@kernel
def large0(values):
    return values[0]
"""
    + "".join(
        f"""
@kernel
def large{number}(values):
    total = large{number - 1}(values)
    for i in range(len(values)):
        total += small(values[i]) * np.sin(values[i] + {number}.0)
        for j in range(i):
            total += np.exp(-values[i]) * np.arctan2(values[j], total) - np.tanh(total)
    return total
"""
        for number in range(1, 5)
    )
    + """
@kernel
def top(values):
    if len(values) > 1000:
        raise ValueError("too many")
    roots = np.sqrt(values * 2.0) + np.minimum(values, 1.0)
    return large4(values) + small(2.0) + roots.sum()
"""
)
COMMON = """
import sys
from pathlib import Path
from compiled.compiler import build, kernel_list, store
path = Path("kernels.txt")
"""
MAKE_LIST = (
    COMMON
    + """
import numpy as np, chain
answer = chain.top(np.arange(3.0))
kernel_list.write(path, kernel_list.stored(store.user_folder()))
print(answer)
"""
)
BUILD = (
    COMMON
    + """
entries, unknown = kernel_list.read(path)
assert not unknown
missing = build.missing_entries(entries)
print(len(entries), len(missing), flush=True)
def report(done, total, seconds_left):
    print(done, total, seconds_left, flush=True)
for failure in build.build(missing, 2, report):
    print("failed", failure.split(":")[:2])
"""
)
PRUNE = (
    COMMON
    + """
entries, _ = kernel_list.read(path)
wanted = {name for entry in entries for name in entry.files}
print(store.prune(wanted), store.prune(wanted))
"""
)
CALL = """
import numpy as np, chain
print(chain.top(np.arange(3.0)))
"""


@pytest.fixture(scope="module")
def listed(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """A folder with kernels and their list, made by calling one of them, and what it answered."""
    folder = tmp_path_factory.mktemp("listed")
    (folder / "chain.py").write_text(KERNELS)
    return folder, python(MAKE_LIST, folder)


def files(folder: Path, cache: str) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in (folder / cache).iterdir()}


def test_the_list_names_what_python_calls_and_what_kernels_call(listed: tuple[Path, str]) -> None:
    lines = (listed[0] / "kernels.txt").read_text().splitlines()
    doors = [line.split()[2] for line in lines if line.startswith("python")]
    others = [line.split()[2] for line in lines if line.startswith("kernel")]
    assert doors == ["chain.top(float64[::1])"]
    assert others == [*(f"chain.large{n}(float64[::1])" for n in range(5)), "chain.small(float64)"]


def test_what_python_needs_is_a_kernel_with_all_that_it_calls(listed: tuple[Path, str]) -> None:
    program = f"""{COMMON}
entries, _ = kernel_list.read(path)
for names in ({{"chain.top"}}, {{"chain.large2"}}, set()):
    print([one.name for one in kernel_list.needed_by(names, entries)] == [
        one.name for one in entries if names == {{"chain.top"}}])
# As if Python called both, of which one alone is asked for.
both = [one._replace(door=one.name in ("chain.large2", "chain.top")) for one in entries]
print([(one.name, one.door) for one in kernel_list.needed_by({{"chain.large2"}}, both)])
"""
    needed = [(f"chain.large{number}", number == 2) for number in range(3)]
    said = python(program, listed[0]).splitlines()
    assert said == [*["True"] * 3, str([*needed, ("chain.small", False)])]


def test_two_processes_compile_all_of_it_and_the_same_as_one(listed: tuple[Path, str]) -> None:
    folder, answer = listed
    head, *progress = python(BUILD, folder, "parallel").splitlines()
    assert head == "7 7"
    assert [line.split()[0] for line in progress] == [str(n) for n in range(8)]
    assert progress[-1] == "7 7 0.0"
    assert files(folder, "parallel") == files(folder, "cache")
    frozen = python(CALL, folder, "parallel", ARMWRIGHT_KERNELS_FROZEN="1")
    assert frozen == answer
    assert python(BUILD, folder, "parallel").splitlines()[0] == "7 0"


def test_orders_of_sets_change_no_byte(listed: tuple[Path, str]) -> None:
    folder, answer = listed
    assert python(CALL, folder, "reordered", PYTHONHASHSEED="1") == answer
    assert files(folder, "reordered") == files(folder, "cache")


def test_a_run_that_was_killed_goes_on_where_it_stopped(listed: tuple[Path, str]) -> None:
    folder, _ = listed
    process = subprocess.Popen(
        [sys.executable, "-c", BUILD], cwd=folder, stdout=subprocess.PIPE, text=True,
        env=os.environ
        | {
            "PYTHONPATH": f"{ROOT}{os.pathsep}{folder}",
            "NUMBA_CACHE_DIR": str(folder / "killed"),
        },
    )  # fmt: skip
    assert process.stdout is not None
    while not process.stdout.readline().startswith("2 "):
        pass
    process.send_signal(signal.SIGKILL)
    process.communicate()  # the workers end with the kernels that they are at
    before = files(folder, "killed")
    assert 2 <= len([name for name in before if "door" not in name]) < 7
    head = python(BUILD, folder, "killed").splitlines()[0]
    assert head == f"7 {7 - len([name for name in before if 'door' not in name])}"
    after = files(folder, "killed")
    assert after == files(folder, "cache")


def test_a_kernel_that_is_edited_is_compiled_again_and_no_other(
    listed: tuple[Path, str], tmp_path: Path
) -> None:
    folder, _ = listed
    python(BUILD, folder, "edited")
    (tmp_path / "kernels.txt").write_bytes((folder / "kernels.txt").read_bytes())
    (tmp_path / "chain.py").write_text(KERNELS.replace("values[i] + 3.0", "values[i] + 3.5"))
    (folder / "edited").rename(tmp_path / "edited")
    # The third, the fourth and what Python calls, with its door.
    assert python(BUILD, tmp_path, "edited").splitlines()[0] == "7 3"
    assert python(PRUNE, tmp_path, "edited").split() == ["4", "0"]
    assert python(BUILD, tmp_path, "edited").splitlines()[0] == "7 0"


def test_a_kernel_that_can_not_be_compiled_is_named(tmp_path: Path) -> None:
    (tmp_path / "chain.py").write_text(KERNELS.replace("x + 1.0", "x + 'one'"))
    (tmp_path / "kernels.txt").write_text(
        "python 1 chain.top(float64[::1])\nkernel 1 chain.small(float64)\n"
    )
    *_, done, failed = python(BUILD, tmp_path).splitlines()
    assert done.startswith("2 2")
    # The other, that only kernels call, may be listed for types that nobody uses any more.
    assert failed == "failed ['chain.top', ' TypingError']"


def test_lines_of_what_is_not_there_are_given_back(tmp_path: Path) -> None:
    (tmp_path / "chain.py").write_text(KERNELS)
    lines = ["kernel 1 chain.gone(float64)", "kernel 1 chain.small(float65)", "python chain.top()"]
    (tmp_path / "kernels.txt").write_text("\n".join(["# A list.", "", *lines]))
    program = f"{COMMON}\nprint(kernel_list.read(path)[1] == {lines!r})"
    assert python(program, tmp_path) == "True\n"


def test_a_kernel_that_is_missing_is_named_where_compiling_is_forbidden(
    listed: tuple[Path, str], tmp_path: Path
) -> None:
    folder, _ = listed
    variables = {"NUMBA_CACHE_DIR": str(tmp_path / "cache"), "ARMWRIGHT_KERNELS_FROZEN": "1"}
    answer = run(CALL, folder, variables)
    assert answer.returncode == 1
    assert "KernelMissing: chain.top was not compiled for (array(float64, 1d, C))" in answer.stderr
    assert not (tmp_path / "cache").exists()


TARGET_ROOT = Path(__file__).parents[2]
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
    environment = {**os.environ, "PYTHONPATH": str(TARGET_ROOT), "ARMWRIGHT_KERNEL_TARGET": target}
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
