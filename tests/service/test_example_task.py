"""The example that picks a crate with whichever grasp serves."""

import importlib.util
import re
from pathlib import Path

import httpx
import pytest

from armwright_client import Client

SOURCE = Path(__file__).parents[2] / "examples/task.py"


def test_the_example_plans_all_stages_and_draws_them(
    client: httpx.Client, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    spec = importlib.util.spec_from_file_location("task_example", SOURCE)
    assert spec is not None
    assert spec.loader is not None
    example = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(example)
    with Client(str(client.base_url)) as connected:
        answer = example.plan(connected)
        example.tell(answer)
        example.draw(connected, answer, tmp_path / "tasks.svg")
    assert all(stage.certificate.verified for stage in answer.stages)
    assert (tmp_path / "tasks.svg").read_text("utf-8").count("<polyline") == 7
    told = capsys.readouterr().out
    page = (SOURCE.parents[1] / "docs/tasks.md").read_text("utf-8")
    # Durations and the grasp that is quickest follow the planners; the page has those of one run.
    assert re.sub(r"[\d.]+", "0", told.strip()) in re.sub(r"[\d.]+", "0", page)
