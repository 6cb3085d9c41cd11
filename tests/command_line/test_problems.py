import json

import pytest
import typer

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
