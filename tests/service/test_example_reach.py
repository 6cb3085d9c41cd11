"""The example that draws the reach of an arm and finds a place for its base."""

import importlib.util
from pathlib import Path

import httpx
import pytest

from armwright_client import Client

SOURCE = Path(__file__).parents[2] / "examples/reach.py"


def test_the_example_finds_a_base_that_reaches_all_places(
    client: httpx.Client, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    spec = importlib.util.spec_from_file_location("reach_example", SOURCE)
    assert spec is not None
    assert spec.loader is not None
    example = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(example)
    with Client(str(client.base_url)) as connected:
        example.draw(connected, tmp_path / "reach.svg")
        assert example.place(connected)
    assert (tmp_path / "reach.svg").read_text("utf-8").startswith("<svg")
    told = capsys.readouterr().out
    page = (SOURCE.parents[1] / "docs/reach.md").read_text("utf-8")
    assert told.strip() in page
