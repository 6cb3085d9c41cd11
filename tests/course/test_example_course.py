"""The example that runs the whole course on one arm."""

import importlib.util
from pathlib import Path
from types import ModuleType

import httpx
import matplotlib as mpl
import pytest

from armwright_client import Client

SOURCE = Path(__file__).parents[2] / "examples/course.py"
PICTURES = (
    "1_model", "2_ik", "3_gradient", "4_field", "5_spline", "6_control", "7_lyapunov",
    "8_adaptation",
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
    assert lines["spline"].endswith("limits hold: True")
