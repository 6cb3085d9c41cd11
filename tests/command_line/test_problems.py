import json

import pytest
import typer

from command_line.problems import invalid_value, negative, shows_problems


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
