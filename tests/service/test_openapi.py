"""The published schema says what is refused: one of several fields, the longest timeout, events."""

import re
from collections.abc import Iterator
from typing import Any

import httpx

from armwright_wire.base import Body
from armwright_wire.robots.kinematics import VelocityRequest
from armwright_wire.scenes.check import Attached
from armwright_wire.scenes.scene import Scene


def test_the_rule_is_published_for_every_model_that_has_it(client: httpx.Client) -> None:
    schemas = client.get("/openapi.json").json()["components"]["schemas"]
    models: tuple[type[Body], ...] = (Scene, VelocityRequest, Attached)
    for model in models:
        names = [rule["required"] for rule in schemas[model.__name__]["allOf"][0]["oneOf"]]
        assert names == [[name] for name in model.one_of]


def test_timeouts_are_published_as_they_are_allowed(client: httpx.Client) -> None:
    schemas = client.get("/openapi.json").json()["components"]["schemas"]
    plan = schemas["PlanRequest"]["properties"]["timeout"]
    (longest,) = [form["maximum"] for form in plan["anyOf"] if "maximum" in form]
    body = {"robot": "panda", "joints": [0.0] * 7}
    assert client.post("/v1/check", json=body | {"timeout": longest}).status_code == 200
    assert client.post("/v1/check", json=body | {"timeout": longest + 1}).status_code == 422


def test_timeouts_of_parameters_are_published_as_they_are_allowed(client: httpx.Client) -> None:
    document = client.get("/openapi.json").json()
    path = "/v1/robots/{name}/equations"
    parameters = document["paths"][path]["get"]["parameters"]
    (timeout,) = [one["schema"] for one in parameters if one["name"] == "timeout"]
    (longest,) = [f["maximum"] for f in (timeout, *timeout.get("anyOf", ())) if "maximum" in f]
    plan = document["components"]["schemas"]["PlanRequest"]["properties"]["timeout"]
    assert [form["maximum"] for form in plan["anyOf"] if "maximum" in form] == [longest]


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
