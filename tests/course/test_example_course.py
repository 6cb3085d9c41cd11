"""The example that runs the whole course on one arm."""

import importlib.util
import math
from pathlib import Path
from types import ModuleType

import httpx
import matplotlib as mpl
import pytest

from armwright_client import Client
from tests.course.example import ask

SOURCE = Path(__file__).parents[2] / "examples/course.py"
PICTURES = (
    "1_model", "2_equations", "3_ik", "4_gradient", "5_field", "6_spline", "7_control",
    "8_lyapunov", "9_adaptation",
)  # fmt: skip


@pytest.fixture(scope="module")
def course() -> ModuleType:
    mpl.use("Agg")
    spec = importlib.util.spec_from_file_location("course_example", SOURCE)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def check_formulas(service: httpx.Client, formulas: dict[str, str]) -> None:
    """Hold the formulas that the example prints against the values that the service answers."""
    q, qd = (0.4, -1.1), (0.7, 0.3)
    values = {
        "m_1": 2.0, "m_2": 1.0, "l_1": 0.6, "l_2": 0.4, "l_c1": 0.3, "l_c2": 0.2, "g": 9.81,
        "I_1": 2.0 * 0.6**2 / 12.0, "I_2": 0.4**2 / 12.0, "qd_1": qd[0], "qd_2": qd[1],
        "c_1": math.cos(q[0]), "s_1": math.sin(q[0]), "c_2": math.cos(q[1]),
        "s_2": math.sin(q[1]), "c_12": math.cos(sum(q)), "s_12": math.sin(sum(q)),
    }  # fmt: skip
    told = {name: eval(formula, {}, values) for name, formula in formulas.items()}
    dynamics = ask(service, "robots/course_arm/dynamics", {"joints": q, "velocities": qd})
    pose = ask(service, "robots/course_arm/fk", {"joints": q})["pose"]["position"]
    expected = dict(zip("xyz", pose, strict=True))
    for i in range(2):
        expected[f"G_{i + 1}"] = dynamics["gravity"][i]
        for j in range(2):
            expected[f"D_{i + 1}{j + 1}"] = dynamics["mass_matrix"][i][j]
            expected[f"C_{i + 1}{j + 1}"] = dynamics["coriolis_matrix"][i][j]
    assert told == pytest.approx(expected, rel=1e-12, abs=1e-12)


def test_the_course_runs_and_tells_what_theory_says(
    service: httpx.Client,
    course: ModuleType,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    with Client(str(service.base_url)) as client:
        course.run(client, tmp_path)
    assert sorted(path.stem for path in tmp_path.iterdir()) == list(PICTURES)
    assert all((tmp_path / f"{name}.png").stat().st_size > 5_000 for name in PICTURES)
    told = capsys.readouterr().out
    lines = {line.partition(":")[0]: line.partition(":")[2] for line in reversed(told.splitlines())}
    assert lines["ik, elbow up"] != lines["ik, elbow down"]
    largest = {
        name: float(text.split()[2]) for name, text in lines.items() if name.startswith("control, ")
    }
    assert min(largest, key=largest.__getitem__) == "control, adaptive"
    assert largest["control, computed torque"] < largest["control, PD + gravity"]
    growth = {name: text for name, text in lines.items() if name.startswith("lyapunov, ")}
    assert len(growth) == 4
    for name, text in growth.items():
        assert float(text.split()[2]) < 1e-6, name
    rates = {name: text for name, text in lines.items() if name.startswith("rate, ")}
    assert len(rates) == 4
    for name, text in rates.items():
        assert float(text.split()[2]) < 1e-6, name
    for name, text in lines.items():
        if name.startswith("adaptation, "):
            learned, _, true, _ = text.split()
            assert float(learned) == pytest.approx(float(true), abs=3e-3), name
    formulas = {
        name.removeprefix("equations, "): text.strip()
        for name, text in lines.items()
        if name.startswith("equations, ")
    }
    check_formulas(service, formulas)
    assert lines["spline"].endswith("limits hold: True")
