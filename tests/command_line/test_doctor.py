from importlib.metadata import version
from pathlib import Path
from typing import Any

import pytest

from command_line.commands import doctor
from tests.command_line.commands import Printed, Run


def parts(answer: Printed) -> dict[str, Any]:
    return {finding["part"]: finding for finding in answer.json["findings"]}


def test_it_tells_what_is_installed_and_compiled(run: Run) -> None:
    answer = run("doctor", "--json")
    found = parts(answer)
    assert answer.code == 0
    assert found["numpy"]["detail"] == version("numpy")
    assert found["kernel target"]["detail"].startswith(("x86-64", "native"))
    assert " compiled, in " in found["kernels"]["detail"]
    assert found["data folder"]["state"] == "ok"
    assert "cores" in run("doctor").out


def test_a_missing_package_is_a_fault(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doctor, "requires", lambda _: ["no-such-thing>=1", "numpy>=999"])
    answer = run("doctor", "--json")
    found = parts(answer)
    assert answer.code == 1
    assert found["no-such-thing"]["cure"] == "pip install 'no-such-thing>=1'"
    assert found["numpy"]["state"] == "fault"


def test_missing_kernels_are_counted(
    run: Run, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    monkeypatch.setenv("ARMWRIGHT_KERNELS", str(tmp_path))
    answer = run("doctor", "--json")
    finding = parts(answer)["kernels"]
    assert answer.code == 0
    assert finding["state"] == "warning"
    assert finding["detail"].startswith("0 of ")
    assert finding["cure"] == "armwright warm"


def test_a_data_folder_that_is_a_file_is_a_fault(
    run: Run, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("ARMWRIGHT_DATA_DIR", str(tmp_path / "file"))
    answer = run("doctor", "--json")
    assert answer.code == 1
    assert parts(answer)["data folder"]["state"] == "fault"


def test_a_service_that_does_not_answer_is_a_fault(run: Run) -> None:
    answer = run("doctor", "--json", "--url", "http://127.0.0.1:9")
    finding = parts(answer)["service"]
    assert answer.code == 1
    assert "http://127.0.0.1:9" in finding["detail"]
    assert "armwright serve" in finding["cure"]
