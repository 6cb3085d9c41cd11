"""The example that visits drilling spots in the best order."""

import importlib.util
import sys
from pathlib import Path
from xml.etree import ElementTree

import httpx
import pytest

SOURCE = Path(__file__).parents[2] / "examples/tour.py"


def test_the_example_visits_all_spots_the_upper_row_first(
    client: httpx.Client,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    spec = importlib.util.spec_from_file_location("tour_example", SOURCE)
    assert spec is not None
    assert spec.loader is not None
    example = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(example)
    picture = tmp_path / "tour.svg"
    words = ["tour.py", "--url", str(client.base_url), "--picture", str(picture)]
    monkeypatch.setattr(sys, "argv", words)
    assert example.main() == 0
    order = capsys.readouterr().out.splitlines()[1].split()
    assert sorted(order) == sorted(goal.id for goal in example.spots())
    assert {name[:6] for name in order[:12]} == {"spot_1"}
    drawn = ElementTree.parse(picture).getroot()
    assert drawn.find("{http://www.w3.org/2000/svg}polyline") is not None
    page = (SOURCE.parents[1] / "docs/pictures/tour.svg").read_text("utf-8")
    assert page.count("<circle") == picture.read_text("utf-8").count("<circle")
