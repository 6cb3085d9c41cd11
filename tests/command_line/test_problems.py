"""Problems, progress and the doctor of the command."""

import json
import re
from importlib.metadata import version
from pathlib import Path
from typing import Any

import pytest
import typer

from command_line.commands import doctor
from command_line.problems import (
    UNREACHABLE,
    ExitCode,
    exit_code,
    invalid_value,
    negative,
    shows_problems,
)
from kinematics.errors import InvalidOption
from kinematics.model.chain import Limits
from service.http.errors import KINDS
from tests.command_line.commands import Printed, Run
from tests.service.robots import ASIDE, POST


def test_an_unexpected_fault_is_told_without_a_traceback(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("ARMWRIGHT_DEBUG", raising=False)
    with pytest.raises(typer.Exit) as end, shows_problems(as_json=False):
        raise KeyError("lost")
    assert end.value.exit_code == 8
    text = capsys.readouterr().err
    assert "KeyError: 'lost'" in text
    assert "Traceback" not in text
    monkeypatch.setenv("ARMWRIGHT_DEBUG", "1")
    with pytest.raises(KeyError), shows_problems(as_json=False):
        raise KeyError("lost")


def test_a_problem_is_a_problem_document_for_programs(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(typer.Exit) as end, shows_problems(as_json=True):
        raise invalid_value("--pose", "it is none", "Give one.")
    assert end.value.exit_code == 3
    document = json.loads(capsys.readouterr().out)
    assert document["title"] == "The request does not have the right form"
    assert (document["detail"], document["hint"]) == ("--pose: it is none", "Give one.")


def test_an_answer_of_no_passes_through(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(typer.Exit) as end, shows_problems(as_json=False):
        raise negative()
    assert end.value.exit_code == 1
    assert capsys.readouterr() == ("", "")


@pytest.mark.parametrize(
    ("quantity", "words"),
    [
        ("acceleration", ['--default-limits "acceleration=10 x velocity"', "--joint-limits"]),
        ("effort", ["--joint-limits FILE", '{"elbow": {"effort": ...}}']),
    ],
)
def test_a_limit_that_is_missing_is_given_by_options_of_that_quantity(
    quantity: str, words: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(typer.Exit), shows_problems(as_json=False):
        Limits.unlimited(1).require(quantity, ["elbow"])
    text = capsys.readouterr().err
    assert all(word in text for word in words)
    assert ("acceleration" in text) is (quantity == "acceleration")


def test_hints_name_the_options_of_commands(capsys: pytest.CaptureFixture[str]) -> None:
    hint = 'Name "tip_link", or allow more time with the field timeout.'
    with pytest.raises(typer.Exit), shows_problems(as_json=False):
        raise InvalidOption("it is wrong", hint=hint)
    assert (
        "Name --tip-link, or allow more time with the field --timeout." in capsys.readouterr().err
    )


def test_every_kind_of_problem_has_the_exit_code_of_its_class() -> None:
    classes = {code: int(exit_code(code)) for code in KINDS}
    assert classes["VALIDATION_ERROR"] == classes["NOT_FOUND"] == 3
    assert classes["PLANNING_FAILED"] == classes["NO_IK_SOLUTION"] == 4
    assert classes["TIMED_OUT"] == 5
    assert classes["UNAUTHENTICATED"] == classes["FORBIDDEN"] == 6
    assert classes["OVERLOADED"] == int(exit_code(UNREACHABLE)) == 7
    assert classes["CRASH"] == 8


def test_problems_that_another_attempt_may_solve_are_told_from_faults() -> None:
    unavailable = {code for code in KINDS if exit_code(code) is ExitCode.UNAVAILABLE}
    assert unavailable == {"OVERLOADED", "NOT_READY", "STORAGE_UNAVAILABLE"}


def test_a_terminal_shows_the_stage_that_runs(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = tmp_path / "scene.json"
    scene.write_text(json.dumps({"obstacles": [POST]}))
    words = ("plan", "panda", "--start", "home", "--goal", ",".join(map(str, ASIDE)),
             "--scene", str(scene), "--json")  # fmt: skip
    silent = run(*words, "--timeout", "60")
    assert silent.code == 0, silent.err
    assert silent.err == ""
    for name, value in (("TTY_COMPATIBLE", "1"), ("TTY_INTERACTIVE", "1"), ("TERM", "xterm")):
        monkeypatch.setenv(name, value)
    # RRT* looks for shorter paths until its time is up: long enough for the line to be drawn.
    shown = run(*words, "--planner", "rrt_star", "--timeout", "1.5")
    assert shown.code == 0, shown.err
    assert shown.json["planner"] == "rrt_star"
    drawn = re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", shown.err)
    assert drawn.count("rrt_star") > 2  # once for each turn of the spinner
    # The line is gone at the end: erased, and the cursor is back.
    assert shown.err.rstrip().endswith(("\x1b[2K", "\x1b[?25h"))


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
