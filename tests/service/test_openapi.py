"""The published schema says what is refused, and its examples what is answered."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest
from fastapi.routing import APIRoute
from pydantic import TypeAdapter

from armwright_wire.base import Body
from armwright_wire.plans.job import Problem
from armwright_wire.robots.kinematics import VelocityRequest
from armwright_wire.scenes.check import Attached
from armwright_wire.scenes.scene import Scene
from scripts.openapi_examples import cut, send_all
from service.app import _ROUTERS
from service.http.errors import KINDS, PROBLEM_MEDIA_TYPE
from service.http.openapi import Example, examples
from tests.service.conftest import Served


def test_the_rule_is_published_for_every_model_that_has_it(client: httpx.Client) -> None:
    schemas = client.get("/openapi.json").json()["components"]["schemas"]
    models: tuple[type[Body], ...] = (Scene, VelocityRequest, Attached)
    for model in models:
        names = [rule["required"] for rule in schemas[model.__name__]["allOf"][0]["oneOf"]]
        assert names == [[name] for name in model.one_of]


def test_timeouts_are_published_as_they_are_allowed(client: httpx.Client) -> None:
    document = client.get("/openapi.json").json()
    plan = document["components"]["schemas"]["PlanRequest"]["properties"]["timeout"]
    (longest,) = [form["maximum"] for form in plan["anyOf"] if "maximum" in form]
    parameters = document["paths"]["/v1/robots/{name}/equations"]["get"]["parameters"]
    (timeout,) = [one["schema"] for one in parameters if one["name"] == "timeout"]
    assert longest in [form.get("maximum") for form in (timeout, *timeout.get("anyOf", ()))]
    body = {"robot": "panda", "joints": [0.0] * 7}
    assert client.post("/v1/check", json=body | {"timeout": longest}).status_code == 200
    assert client.post("/v1/check", json=body | {"timeout": longest + 1}).status_code == 422


def test_maps_have_the_names_that_follow_their_pattern_and_no_others(client: httpx.Client) -> None:
    def maps(part: Any) -> Iterator[dict[str, Any]]:
        inner = part.values() if isinstance(part, dict) else part
        if isinstance(part, dict) and "patternProperties" in part:
            yield part
        for one in inner if isinstance(part, dict | list) else ():
            yield from maps(one)

    document = client.get("/openapi.json").json()
    found = list(maps(document))
    assert found
    assert all(one["additionalProperties"] is False for one in found)
    robot = document["paths"]["/v1/robots"]["post"]["requestBody"]["content"]
    assert robot["multipart/form-data"]["schema"]["additionalProperties"] is False
    body = {"joint_limits": {"elbow\x19": {"acceleration": 1.0}}}
    assert client.patch("/v1/robots/none", json=body).status_code == 422
    files = {"file": ("arm.zip", b"PK")}
    assert client.post("/v1/robots", files=files, data={"other": "x"}).status_code == 422


def test_events_are_no_text(client: httpx.Client) -> None:
    operation = client.get("/openapi.json").json()["paths"]["/v1/jobs/{id}/events"]["get"]
    schema = operation["responses"]["200"]["content"]["text/event-stream"]["schema"]
    assert "type" not in schema


def test_every_field_says_what_it_is(client: httpx.Client) -> None:
    schemas = client.get("/openapi.json").json()["components"]["schemas"]
    silent = [
        f"{name}.{field}"
        for name, schema in schemas.items()
        for field, form in schema.get("properties", {}).items()
        if not form.get("description")
    ]
    assert silent == []
    assert sum(len(schema.get("properties", {})) for schema in schemas.values()) > 1_000


def test_operations_are_named_by_their_functions_and_say_what_they_do(client: httpx.Client) -> None:
    paths = client.get("/openapi.json").json()["paths"]
    operations = [operation for methods in paths.values() for operation in methods.values()]
    names = [operation["operationId"] for operation in operations]
    assert len(set(names)) == len(names)
    assert all(re.fullmatch(r"[a-z]+(_[a-z]+)*", name) for name in names)
    for operation in operations:
        assert operation["summary"], operation["operationId"]
        assert operation["description"], operation["operationId"]
        for parameter in operation.get("parameters", ()):
            assert parameter.get("description"), (operation["operationId"], parameter["name"])


def test_options_name_the_methods_that_the_document_has(client: httpx.Client) -> None:
    document = client.get("/openapi.json").json()
    for path, methods in document["paths"].items():
        named = client.options(path.replace("{", "").replace("}", "")).headers["Allow"]
        assert set(named.split(", ")) == {method.upper() for method in methods}, path
    assert client.options("/nowhere").status_code == 404


def test_a_scene_may_be_new_where_it_is_put(client: httpx.Client) -> None:
    responses = client.get("/openapi.json").json()["paths"]["/v1/scenes/{name}"]["put"]["responses"]
    assert {"200", "201"} <= set(responses)


def test_the_document_is_made_once_compressed_and_tagged(client: httpx.Client) -> None:
    first = client.get("/openapi.json", headers={"Accept-Encoding": "identity"})
    tag = first.headers["etag"]
    assert "content-encoding" not in first.headers
    packed = client.get("/openapi.json", headers={"Accept-Encoding": "gzip"})
    assert packed.headers["content-encoding"] == "gzip"
    assert packed.headers["etag"] == tag
    assert int(packed.headers["content-length"]) < 0.2 * len(first.content)
    assert packed.json() == first.json()
    for condition in (tag, f"W/{tag}", f'"other", {tag}', "*"):
        same = client.get("/openapi.json", headers={"If-None-Match": condition})
        assert (same.status_code, same.content, same.headers["etag"]) == (304, b"", tag)
    assert client.get("/openapi.json", headers={"If-None-Match": '"other"'}).status_code == 200


#: Operations whose whole answer tells what happens to run or to be stored.
STATE = {
    "metrics", "job_events", "list_jobs", "list_plans", "list_robots", "list_scenes", "list_tools",
    "plan_batch",
}  # fmt: skip
#: What the files of these operations begin with; the rest changes with the code that makes them.
FILES = {"view_plan": "<!doctype html>\n<html lang=", "swept_plan": r"glTF\x02\x00\x00\x00"}
#: Fields that differ from run to run, or from machine to machine.
VOLATILE = {
    "created", "updated", "started", "ended", "expires", "milliseconds", "versions", "id",
    "version", "workers", "plan_id", "detail", "instance", "request_hash",
}  # fmt: skip
Operations = dict[str, dict[str, Any]]


@pytest.fixture(scope="module")
def document(served: Served) -> dict[str, Any]:
    published: dict[str, Any] = served.client.get("/openapi.json").json()
    return published


@pytest.fixture(scope="module")
def operations(document: dict[str, Any]) -> Operations:
    return operations_of(document)


def operations_of(document: dict[str, Any]) -> Operations:
    paths = document["paths"].values()
    return {one["operationId"]: one for methods in paths for one in methods.values()}


def same(answer: Any, printed: Any, place: str) -> None:
    """Fail where an answer differs from an example in more than rounding and in volatile fields."""
    if isinstance(printed, dict):
        assert answer.keys() == printed.keys(), place
        for key in printed.keys() - VOLATILE:
            same(answer[key], printed[key], f"{place}.{key}")
    elif isinstance(printed, list):
        assert len(answer) == len(printed), place
        for i, item in enumerate(printed):
            same(answer[i], item, f"{place}[{i}]")
    elif isinstance(printed, float):
        assert answer == pytest.approx(printed, rel=1e-6, abs=1e-7), place
    else:
        assert answer == printed, place


def test_the_service_answers_as_the_examples_say(client: httpx.Client) -> None:
    wanted = examples()
    for example, answered in zip(wanted, send_all(client, wanted), strict=True):
        place = f"{example.operation} ({example.title})"
        assert answered.status == example.status, place
        if example.operation in FILES:
            for content in (answered.answer, example.answer):
                assert content.startswith(FILES[example.operation]), place
        elif example.operation == "cancel_job" and example.status == httpx.codes.OK:
            # How far it had come is a matter of the moment.
            assert answered.answer["status"] == example.answer["status"] == "cancelled"
        elif example.operation not in STATE:
            same(cut(answered.answer), example.answer, place)


def test_every_operation_has_an_example_of_success(operations: Operations) -> None:
    shown = {one.operation for one in examples() if one.status < httpx.codes.BAD_REQUEST}
    assert operations.keys() == shown
    for name, operation in operations.items():
        if "requestBody" in operation:
            content = operation["requestBody"]["content"]["application/json"]
            assert content["examples"]["example_1"]["value"], name
        answers = [
            media["examples"]
            for status, response in operation["responses"].items()
            for media in response.get("content", {}).values()
            if "examples" in media and status[0] == "2"
        ]
        assert answers or "204" in operation["responses"], name


def test_answers_have_the_published_form() -> None:
    models = {
        route.name: TypeAdapter(route.response_model)
        for router in _ROUTERS
        for route in router.routes
        if isinstance(route, APIRoute) and route.response_model is not None
    }
    judged = set()
    for example in examples():
        if example.status == httpx.codes.OK and example.operation in models:
            models[example.operation].validate_python(example.answer)
            judged.add(example.operation)
        elif example.status >= httpx.codes.BAD_REQUEST:
            problem = Problem.model_validate(example.answer)
            assert KINDS[problem.code].status == example.status
    assert len(judged) > 30


def test_problems_of_operations_are_listed_by_status(operations: Operations) -> None:
    plan = operations["plan"]["responses"]
    assert {"404", "422", "429", "503", "504"} <= plan.keys()
    assert "`GOAL_IN_COLLISION`" in plan["422"]["description"]
    assert "`TIMED_OUT`" in plan["504"]["description"]
    assert "504" not in operations["healthz"]["responses"]
    for example in examples():
        if example.status >= httpx.codes.BAD_REQUEST:
            response = operations[example.operation]["responses"][str(example.status)]
            assert f"`{example.answer['code']}`" in response["description"], example.operation


def test_every_error_answer_has_examples_of_its_problems(document: dict[str, Any]) -> None:
    shared = document["components"]["examples"]
    judged = 0
    for operation in operations_of(document).values():
        for status, response in operation["responses"].items():
            if status[0] not in "45":
                continue
            listed = response["content"][PROBLEM_MEDIA_TYPE]["examples"]
            place = f"{operation['operationId']} {status}"
            assert listed, place
            for name, example in listed.items():
                one = shared[name] if "$ref" in example else example
                problem = Problem.model_validate(one["value"])
                assert name in (problem.code, "example_1"), place
                assert KINDS[problem.code].status == problem.status, place
                assert str(problem.status).startswith(status.rstrip("X")), place
                assert problem.code in response["description"] or "X" in status, place
                assert all((problem.detail, problem.hint, problem.stage)), place
                judged += 1
    assert judged > 800


def test_long_lists_and_texts_are_cut() -> None:
    assert cut({"a": [{"b": 1}] * 9, "c": list(range(99))}) == {
        "a": [{"b": 1}] * 4,
        "c": list(range(16)),
    }
    assert cut("x\n" * 20).endswith("x\n...")
    assert cut([[0.0] * 7] * 6) == [[0.0] * 7] * 6


def test_requests_stand_in_the_file_once() -> None:
    keys = [(one.operation, one.title) for one in examples()]
    assert len(set(keys)) == len(keys)
    assert all(isinstance(one, Example) and Path(one.path).is_absolute() for one in examples())
