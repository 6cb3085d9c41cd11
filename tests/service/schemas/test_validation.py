"""Refusals of bodies: strict JSON, paths of faults, and rules that the domain has too."""

import json
import time
import tracemalloc
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from armwright_wire import pose
from armwright_wire.goals import goal
from armwright_wire.plans import plan
from armwright_wire.plans.plan import PlanRequest
from armwright_wire.scenes import tool
from armwright_wire.scenes.check import CheckRequest
from kinematics.errors import InvalidPose
from kinematics.rounding import check_axis_length, check_quaternion_norm, check_rotation
from obstacles.robots.tool import SIZES
from planning.pipeline.path_search import PLANNERS
from planning.values.preferences import DEFAULT_PREFERRED, MAX_PREFERRED, GoalCosts
from service.validation import (
    MAX_FIELDS,
    MAX_OBJECT_FIELDS,
    ProblemError,
    field_path,
    parse_json,
    validate_as,
)

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


@pytest.mark.parametrize("name", ["tool_frame", "tip_link", "tool_offset"])
def test_who_asks_for_a_tool_is_told_what_is_possible(name: str) -> None:
    pose = {"position": [0.4, 0.0, 0.4]}
    body = {"robot": "ur5e", "start": {"joints": [0.0] * 6}, "goal": {"pose": pose}, name: pose}
    with pytest.raises(ProblemError) as told:
        validate_as(PlanRequest, body)
    assert f"{name}: unknown field" in told.value.detail
    assert '"tool"' in (told.value.hint or "")
    assert '"tcp"' in (told.value.hint or "")


#: Names and texts with all that could be taken for the end of a string or of a field.
TEXT = st.text(alphabet='ab":\\{}[], \n', max_size=6)
VALUES: st.SearchStrategy[Any] = st.recursive(
    st.none() | st.booleans() | st.integers(-9, 9) | st.floats(-9.0, 9.0) | TEXT,
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(TEXT, inner, max_size=4),
    max_leaves=20,
)


@given(VALUES, st.sampled_from([None, 2]))
def test_what_has_no_name_twice_is_parsed(value: Any, indent: int | None) -> None:
    assert parse_json(json.dumps(value, indent=indent).encode()) == value


@given(VALUES, VALUES, TEXT)
def test_a_name_twice_is_refused_wherever_it_is(first: Any, second: Any, name: str) -> None:
    pair = f"{json.dumps(name)}: {json.dumps(first)}"
    twice = "{" + f"{pair}, {json.dumps(name)}: {json.dumps(second)}" + "}"
    for text in (twice, f"[1, [2.5, {twice}]]", f'{{"x": [[], {twice}], "y": [1]}}'):
        with pytest.raises(ProblemError) as refused:
            parse_json(text.encode())
        assert repr(name) in refused.value.detail or "twice" in refused.value.detail
        assert refused.value.code == "VALIDATION_ERROR"


def test_the_number_of_fields_is_bounded_before_anything_is_parsed() -> None:
    fields = {f"field_{i}": i for i in range(MAX_FIELDS + 1)}
    content = json.dumps(fields).encode()
    began = time.perf_counter()
    with pytest.raises(ProblemError, match=f"the body has more than {MAX_FIELDS} fields"):
        parse_json(content)
    assert time.perf_counter() - began < 0.1


def test_colons_in_texts_are_no_fields() -> None:
    text = '\\": ' * (MAX_FIELDS + 1)
    assert parse_json(json.dumps({"moveit": text}).encode()) == {"moveit": text}


def test_nothing_stays_of_what_was_parsed() -> None:
    parse_json(b'{"name": "arm"}')
    tracemalloc.start()
    try:
        for number in range(5000):
            parse_json(b'{"name": "a robot that is named once: %d"}' % number)
        kept, _ = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert kept < 50_000


def test_the_fields_of_one_object_are_bounded_exactly() -> None:
    fields = {str(i): i for i in range(MAX_OBJECT_FIELDS)}
    assert parse_json(json.dumps([fields]).encode()) == [fields]
    with pytest.raises(ProblemError, match=f"an object has more than {MAX_OBJECT_FIELDS}"):
        parse_json(json.dumps([fields | {"x": 0}]).encode())


def test_defaults_and_names_are_those_of_planning() -> None:
    assert set(plan.PLANNERS) == set(PLANNERS)
    assert goal.GoalCosts().model_dump() == {
        name: getattr(GoalCosts(), name) for name in GoalCosts.__slots__
    }
    assert goal.DEFAULT_PREFERRED == DEFAULT_PREFERRED
    assert goal.MAX_PREFERRED == MAX_PREFERRED


def test_built_in_tools_have_the_same_sizes() -> None:
    forms = (tool.ParallelJaw, tool.ThreeJaw, tool.SuctionCup, tool.Torch, tool.Spindle)
    sizes = {form().type: form().model_dump(exclude={"type"}) for form in forms}
    assert sizes == SIZES
    assert tuple(sizes) == tool.BUILTIN_TOOLS


def refusal(check: object, value: object) -> str | None:
    try:
        check(value)  # type: ignore[operator]
    except InvalidPose as error:
        return f"{error.message}. {error.hint or ''}".rstrip()
    except ValueError as error:
        return str(error)
    return None


@pytest.mark.parametrize("digits", [1, 2, 3, 4, 6, 9, 15])
def test_rounding_is_judged_alike(digits: int) -> None:
    random = np.random.default_rng(digits)
    for _ in range(200):
        q = random.normal(size=4)
        q /= np.linalg.norm(q)
        x, y, z, w = q
        rotation = np.eye(3) + 2 * np.array([
            [-y * y - z * z, x * y - z * w, x * z + y * w],
            [x * y + z * w, -x * x - z * z, y * z - x * w],
            [x * z - y * w, y * z + x * w, -x * x - y * y],
        ])  # fmt: skip
        for scale in (1.0, 1.0005, 1.01, -1.0, 2.0):
            rows = (scale * rotation).round(digits).tolist()
            written = (scale * q).round(digits).tolist()
            assert refusal(pose.check_rotation, rows) == refusal(check_rotation, rows)
            assert refusal(pose.check_quaternion_norm, written) == refusal(
                lambda value: check_quaternion_norm(float(np.linalg.norm(value))), written
            )
    for axis in ([0.0, 0.0, 0.0], [1e-13, 0.0, 0.0], [1e-11, 0.0, 0.0]):
        assert refusal(pose.check_axis_length, axis) == refusal(
            lambda value: check_axis_length(float(np.linalg.norm(value))), axis
        )
