"""Every field of every request, broken in turn: the problem document says where."""

import math
from typing import Any

import pytest
from pydantic import BaseModel

from armwright_wire.robots.robot import RobotFields
from service.validation import validate_as
from tests.service.schemas.changes import changed, refusals, values, written
from tests.service.schemas.drawn import FULL, KINDS, NAMES, REFUSED

bodies = pytest.mark.parametrize(("model", "body"), FULL, ids=NAMES)

#: Fields whose content only the domain knows: they take any JSON.
FREE = ("planner_options", "changes", "request", "answer")
#: Objects by names of the caller's own: any name is a valid one.
NAMED = (
    "meshes",
    "held",
    "joint_limits",
    "inertias",
    "fingers",
    "joints",
    "ports",
    "for_each",
    "links",
    "objects",
)
#: Texts that may be numbers, and those that may be lists.
PORTS = ("output", "input", "spindle", "gripper")
LISTS = ("support", "into", "control_points", "estimate", "direction")


def is_free(path: tuple[str | int, ...]) -> bool:
    return any(step in FREE for step in path[:-1])


def is_port(path: tuple[str | int, ...]) -> bool:
    return path[-1] in PORTS or path[0] == "ports"


def models_in(value: Any) -> list[BaseModel]:
    if isinstance(value, BaseModel):
        inner = [getattr(value, name) for name in type(value).model_fields]
        return [value, *(model for item in inner for model in models_in(item))]
    if isinstance(value, dict):
        return [model for item in value.values() for model in models_in(item)]
    return [model for item in value for model in models_in(item)] if isinstance(value, list) else []


@bodies
def test_a_body_with_every_field_is_taken(model: type[BaseModel], body: Any) -> None:
    assert refusals(model, body) == {}


def test_the_bodies_hold_every_field_that_a_request_may_have() -> None:
    given: dict[type, set[str]] = {}
    for model, body in FULL:
        for part in models_in(validate_as(model, body)):
            for kind in type(part).__mro__:
                given.setdefault(kind, set()).update(part.model_fields_set)
    missing = {
        (kind.__name__, name)
        for kind in KINDS.values()
        for name in kind.model_fields
        if name not in given.get(kind, set())
    }
    assert missing == REFUSED


@bodies
def test_an_unknown_field_is_named_wherever_it_stands(model: type[BaseModel], body: Any) -> None:
    objects = {path: value for path, value in values(body) if isinstance(value, dict)}
    for path in [(), *objects]:
        if "regrasp" in objects.get(path, {}):  # told by its name alone: nothing stands beside it
            continue
        if is_free((*path, "surprise")) or (path and path[-1] in (*NAMED, "objective")):
            continue
        if path and path[-1] == "tcp" and "hand" in dict(values(body)).get(path, {}):  # by name
            continue
        if path == ("inertias", "links"):  # by name
            continue
        if path == ("motors",) and issubclass(model, RobotFields):  # by joint
            continue
        where = (*path, "surprise")
        assert refusals(model, changed(body, where, 1)).get(written(where)) == "unknown field", (
            where
        )


@bodies
def test_what_is_not_a_number_is_refused_where_it_stands(model: type[BaseModel], body: Any) -> None:
    for path, value in values(body):
        if isinstance(value, bool | str | dict | list) or is_free(path):
            continue
        for wrong in (math.nan, -math.inf, 1e300, True, "1", None):
            if wrong is None and isinstance(path[-1], str):
                continue  # a field may be left out, an element of a vector may not
            if wrong == "1" and is_port(path):
                continue
            paths = refusals(model, changed(body, path, wrong))
            assert written(path) in paths, (path, wrong, paths)


@bodies
def test_numbers_in_options_of_a_planner_are_finite(model: type[BaseModel], body: Any) -> None:
    for path, value in values(body):
        if is_free(path) and isinstance(value, float):
            paths = refusals(model, changed(body, path, math.nan))
            free = next(step for step in path if step in FREE)
            options = written(path[: path.index(free) + 1])
            assert any(name.startswith(options) for name in paths), (path, paths)


@bodies
def test_a_vector_that_is_a_text_is_refused_where_it_stands(
    model: type[BaseModel], body: Any
) -> None:
    for path, value in values(body):
        if isinstance(value, list) and not is_free(path):
            # A pair and motors may be an object, and what an object stands on one name.
            may_be = {"text"} if path[-1] in ("support", "into") else set()
            named = path[-2:-1] == ("allowed_collisions",) or path == ("motors",)
            objects = [] if named else [{"0": 1.0}]
            for wrong in (*({"text"} - may_be), *objects):
                paths = refusals(model, changed(body, path, wrong))
                assert written(path) in paths, (path, paths)


@bodies
def test_a_text_that_is_a_number_is_refused_where_it_stands(
    model: type[BaseModel], body: Any
) -> None:
    for path, value in values(body):
        if not isinstance(value, str) or is_free(path):
            continue
        # A tag decides what its object is, so that the object is at fault.
        places = {written(path), *([written(path[:-1])] if path[-1] in ("type", "kind") else [])}
        # What may be a list of objects blames the entry that is none.
        lists = [] if path[-1] in LISTS else [["text"]]
        for wrong in (*([] if is_port(path) else [7]), *lists, False):
            assert places & refusals(model, changed(body, path, wrong)).keys(), (path, wrong)


@bodies
def test_a_switch_that_is_a_number_is_refused(model: type[BaseModel], body: Any) -> None:
    for path, value in values(body):
        if isinstance(value, bool) and not is_free(path):
            for wrong in (1, 0, "true"):
                assert written(path) in refusals(model, changed(body, path, wrong)), path


@bodies
def test_a_body_that_is_no_object_is_refused(model: type[BaseModel], body: Any) -> None:
    for wrong in (None, [], [body], "text", 1.0):
        assert list(refusals(model, wrong)) == ["body"]


@bodies
def test_what_was_sent_is_not_told_again(model: type[BaseModel], body: Any) -> None:
    secret = "s3cret-value"
    for path, value in values(body):
        if isinstance(value, float) and not is_free(path):
            problems = refusals(model, changed(body, path, secret))
            assert secret not in str(problems), path
