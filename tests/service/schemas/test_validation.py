"""Refusals of bodies: the path of each fault, and never its value."""

import pytest

from armwright_wire.plans.plan import PlanRequest
from armwright_wire.scenes.check import CheckRequest
from service.problem import ProblemError
from service.validation import field_path, parse_json, validate_as

SPHERE = {"id": "a", "shape": {"type": "sphere", "radius": -1.0}, "pose": {"position": [0, 0, 0]}}


def refused(body: object) -> ProblemError:
    with pytest.raises(ProblemError) as error:
        validate_as(CheckRequest, body)
    return error.value


def test_every_fault_is_listed_with_its_path() -> None:
    body = {"joints": [0.0, "secret"], "scene": {"obstacles": [SPHERE]}, "extra": 1}
    problem = refused(body)
    assert problem.code == "VALIDATION_ERROR"
    paths = {item["path"]: item["problem"] for item in problem.details["errors"]}
    assert paths["robot"] == "this field is required"
    assert paths["extra"] == "unknown field"
    assert "scene.obstacles[0].shape.radius" in paths
    assert any(path.startswith("joints[1]") for path in paths)
    assert "secret" not in str(problem.details) + problem.detail
    assert problem.details["count"] == len(paths)


def test_a_long_list_is_cut_and_counted() -> None:
    problem = refused({f"field_{i}": i for i in range(80)})
    assert len(problem.details["errors"]) == 50
    assert problem.details["count"] == 82
    assert problem.detail.endswith("; and 79 more")


def test_where_several_kinds_may_stand_only_faults_of_the_one_meant_are_told() -> None:
    body = {"robot": "planar_rr", "start": {"joints": [0.0, 0.0]}, "goal": {"joints": [1.0, 1.0]}}
    for refine, told in (
        ({"rounds": 1.5}, {"refine.rounds": "Input should be a valid integer"}),
        ({"objective": {"time": -1.0}}, {"refine.objective.time": "greater than or equal to 0"}),
    ):
        with pytest.raises(ProblemError) as refusal:
            validate_as(PlanRequest, body | {"refine": refine})
        ((path, words),) = told.items()
        assert refusal.value.detail.startswith(f"{path}: ")
        assert refusal.value.detail.endswith(words)
        assert refusal.value.details["count"] == len(refusal.value.details["errors"]) == 1
    with pytest.raises(ProblemError, match="refine: Input should be a valid boolean; refine: "):
        validate_as(PlanRequest, body | {"refine": 5})


@pytest.mark.parametrize(
    ("location", "body", "path"),
    [
        (("body",), {}, "body"),
        (("body", "a", 1, "b"), {"a": [{}, {"b": 0}]}, "a[1].b"),
        (("body", "scene", "inline", "name"), {"scene": {"name": 1}}, "scene.name"),
        (("query", "limit"), None, "query.limit"),
        ((), [], "body"),
    ],
)
def test_paths_name_fields_of_the_body_alone(
    location: tuple[str | int, ...], body: object, path: str
) -> None:
    assert field_path(location, body) == path


JOINT = {"type": "joint", "joint": "j1", "position": 0.0}


@pytest.mark.parametrize(
    ("location", "path"),
    [
        (("body", "c", 0, "joint", "joint"), "c[0].joint"),
        (("body", "c", 0, "joint", "position"), "c[0].position"),
        (("body", "c", 0, "joint"), "c[0]"),
        (("body", "c", 1, "position", "region", "sphere", "radius"), "c[1].region.radius"),
        (("body", "c", 1, "position", "region", "sphere"), "c[1].region"),
        (("body", "c", "list[constrained-float]"), "c"),
    ],
)
def test_a_tag_that_is_also_the_name_of_a_field_is_a_tag_first(
    location: tuple[str | int, ...], path: str
) -> None:
    region = {"type": "sphere", "radius": "x", "center": [0, 0, 0]}
    body = {"c": [JOINT, {"type": "position", "region": region}]}
    assert field_path(location, body) == path


def test_a_missing_field_is_named_and_a_missing_tag_is_not() -> None:
    body = {"a": {"b": 1}}
    assert field_path(("body", "a", "c"), body, missing=True) == "a.c"
    assert field_path(("body", "a", "c"), body) == "a"
    assert field_path(("body", "x", "a", "b"), body, missing=True) == "a.b"


def test_numbers_that_are_not_finite_are_named() -> None:
    with pytest.raises(ProblemError) as error:
        parse_json(b'{"a": [1, NaN], "b": {"c": -Infinity}}')
    assert [item["path"] for item in error.value.details["errors"]] == ["a[1]", "b.c"]


@pytest.mark.parametrize("name", ["tool_frame", "tip_link", "tool_offset"])
def test_who_asks_for_a_tool_is_told_what_is_possible(name: str) -> None:
    pose = {"position": [0.4, 0.0, 0.4]}
    body = {"robot": "ur5e", "start": {"joints": [0.0] * 6}, "goal": {"pose": pose}, name: pose}
    with pytest.raises(ProblemError) as told:
        validate_as(PlanRequest, body)
    assert f"{name}: unknown field" in told.value.detail
    assert '"tool"' in (told.value.hint or "")
    assert '"tcp"' in (told.value.hint or "")
