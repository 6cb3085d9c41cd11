"""The command ``armwright tour``."""

import json
from pathlib import Path

from tests.command_line.commands import Run

START = "0,-1.44,2.5,0,-1.07,0"


def goals(*turns: float) -> list[dict[str, object]]:
    return [{"id": f"g{turn}", "joints": [turn, -1.44, 2.5, 0.0, -1.07, 0.0]} for turn in turns]


def test_goals_are_listed_in_their_best_order(run: Run, tmp_path: Path) -> None:
    request = tmp_path / "tour.json"
    request.write_text(json.dumps({"goals": goals(0.9, 0.3, 0.6), "rounds": 0}))
    answer = run("tour", "kr6_sixx", str(request), "--start", START, "--json")
    assert answer.code == 0, answer.err
    assert answer.json["order"] == ["g0.3", "g0.6", "g0.9"]
    output = tmp_path / "answer.json"
    text = run("tour", "kr6_sixx", str(request), "--start", START, "--end", "start",
               "--output", str(output)).out  # fmt: skip
    assert "3 goals in" in text
    assert "no tour takes less than" in text
    assert len(json.loads(output.read_text())["legs"]) == 4


def test_rules_that_contradict_each_other_are_refused(run: Run, tmp_path: Path) -> None:
    request = tmp_path / "tour.json"
    rules = [["g0.3", "g0.6"], ["g0.6", "g0.3"]]
    request.write_text(json.dumps({"goals": goals(0.3, 0.6), "precedence": rules}))
    answer = run("tour", "kr6_sixx", str(request), "--start", START)
    assert answer.code == 3
    assert "g0.3 before g0.6 before g0.3" in answer.err


def test_goals_left_out_are_listed(run: Run, tmp_path: Path) -> None:
    request = tmp_path / "tour.json"
    document = {"goals": goals(0.3, 0.6, 9.0), "rounds": 0, "allow_partial": True}
    request.write_text(json.dumps(document))
    text = run("tour", "kr6_sixx", str(request), "--start", START).out
    assert "Left out" in text
    assert "g9.0" in text
