"""Examples of planning, run against a service: what they print, draw and plan."""

import importlib.util
import re
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType
from typing import Any
from xml.etree import ElementTree

import httpx
import pytest

from armwright_client import Client, PlanningFailed

ROOT = Path(__file__).parents[2]
SVG = "{http://www.w3.org/2000/svg}"
Run = Callable[[ModuleType, Client, Path], None]


def load(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(f"{name}_example", ROOT / f"examples/{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def connected(client: httpx.Client) -> Iterator[Client]:
    with Client(str(client.base_url)) as made:
        yield made


def pick_and_place(example: ModuleType, connected: Client, folder: Path) -> None:
    example.main()


def potential_field(example: ModuleType, connected: Client, folder: Path) -> None:
    assert example.turn_all(connected)


def reach(example: ModuleType, connected: Client, folder: Path) -> None:
    example.draw(connected, folder / "reach.svg")
    assert example.place(connected)
    assert (folder / "reach.svg").read_text("utf-8").startswith("<svg")


def task(example: ModuleType, connected: Client, folder: Path) -> None:
    answer = example.plan(connected)
    example.tell(answer)
    example.draw(connected, answer, folder / "tasks.svg")
    assert all(stage.certificate.verified for stage in answer.stages)
    assert (folder / "tasks.svg").read_text("utf-8").count("<polyline") == 7


@pytest.mark.parametrize(
    ("run", "page"),
    [(pick_and_place, "pick_and_place"), (potential_field, "potential_fields"), (reach, "reach"),
     (task, "tasks")],
)  # fmt: skip
def test_an_example_prints_what_its_page_says(
    connected: Client,
    client: httpx.Client,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    run: Run,
    page: str,
) -> None:
    monkeypatch.setattr(sys, "argv", [run.__name__, "--url", str(client.base_url)])
    run(load(run.__name__), connected, tmp_path)
    told, _, refusal = capsys.readouterr().out.partition("not allowed to touch the table: ")
    text = (ROOT / f"docs/{page}.md").read_text("utf-8")
    if run is task:
        # Durations and the grasp that is quickest follow the planners; the page has those of a run.
        told, text = (re.sub(r"[\d.]+", "0", one) for one in (told, text))
    assert told.strip() in text
    if run is pick_and_place:
        assert refusal.startswith("START_STATE_IN_COLLISION")
        assert "('crate', 'table')" in refusal


def test_the_seam_is_followed(connected: Client) -> None:
    plan = load("seam").follow(connected)
    assert plan.certificate.verified
    assert plan.certificate.tool_speed.share > 0.9
    assert plan.tool_motions[0].part == "approach"


def test_the_tour_visits_all_spots_the_upper_row_first(
    client: httpx.Client,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    example, picture = load("tour"), tmp_path / "tour.svg"
    words = ["tour.py", "--url", str(client.base_url), "--picture", str(picture)]
    monkeypatch.setattr(sys, "argv", words)
    assert example.main() == 0
    order = capsys.readouterr().out.splitlines()[1].split()
    assert sorted(order) == sorted(goal.id for goal in example.spots())
    assert {name[:6] for name in order[:12]} == {"spot_1"}
    assert ElementTree.parse(picture).getroot().find(f"{SVG}polyline") is not None
    page = (ROOT / "docs/pictures/tour.svg").read_text("utf-8")
    assert page.count("<circle") == picture.read_text("utf-8").count("<circle")


@pytest.mark.parametrize("name", ["panda", "ur5e", "iiwa14"])
def test_the_field_plans_where_it_arrives_and_its_fallback_where_not(
    connected: Client, name: str
) -> None:
    example = load("potential_field")
    post = example.plan(connected, name, 0.2, 0.3)
    pillar = example.plan(connected, name, 0.5, 0.05)
    other = example.plan(connected, name, 0.5, 0.05, fallback="PRM")
    with pytest.raises(PlanningFailed) as stuck:
        example.plan(connected, name, 0.5, 0.05, fallback=None)
    planners: Any = post.planner, pillar.planner, other.planner
    assert planners == ("potential_field", "rrt_connect", "prm")
    assert post.potential_field.iterations > 10
    for plan in (post, pillar, other):
        assert plan.certificate.verified
        assert plan.timing.method == "spline"
    stages = {stage.name: stage for stage in pillar.stages}
    assert list(stages)[:3] == ["preflight", "potential_field", "rrt_connect"]
    assert stages["potential_field"].outcome == "failed"
    assert stages["potential_field"].detail.startswith(("Blocked", "A kink", "A local minimum"))
    assert stages["rrt_connect"].outcome == "succeeded"
    assert stuck.value.details["ending"] in ("blocked", "kink", "local_minimum")
