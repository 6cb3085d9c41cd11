"""The OpenAPI document, beyond what the framework derives from the routes.

Its examples are requests and answers of a running service; `scripts/openapi_examples.py` writes the
answers.
"""

import json
from collections import defaultdict
from collections.abc import Iterable, Iterator
from http import HTTPStatus
from importlib.resources import files
from typing import Any, NamedTuple

from fastapi import FastAPI
from fastapi.openapi.utils import get_openapi

from armwright_wire.goals.tool_motion import CartesianOptions
from armwright_wire.plans.job import Problem
from armwright_wire.robots.robot import RobotBody
from planning.sampling.planners import PLANNERS, describe_options
from service.http.errors import KINDS, PROBLEM_MEDIA_TYPE, document
from service.validation import ProblemError


def _references(codes: Iterable[str]) -> dict[str, Any]:
    """The examples of one answer, by code."""
    return {code: {"$ref": f"#/components/examples/{code}"} for code in codes}


def _problem(code: str) -> dict[str, Any]:
    kind = KINDS[code]
    assert kind.example is not None
    told = dict(kind.example)
    instance = told.pop("instance")
    problem = ProblemError(code, hint=kind.hint, **told.pop("details"), **told)
    return document(problem, instance)


Operation = dict[str, Any]

#: Shown where an answer may be any other fault of the request or of the service.
_ANY_OTHER = {"4XX": "METHOD_NOT_ALLOWED", "5XX": "CRASH"}


def add_problems(document: dict[str, Any]) -> None:
    """List the problems of every operation, by status, each with an example.

    Args:
        document: The OpenAPI document with its jobs and schemas; responses are added.
    """
    shown = set(_ANY_OTHER.values())
    for path, operations in document["paths"].items():
        for operation in operations.values():
            by_status = defaultdict(list)
            for code in sorted(set(_codes(path, operation))):
                by_status[KINDS[code].status].append(code)
            responses = operation["responses"]
            for status, codes in sorted(by_status.items()):
                response = responses.setdefault(str(status), _response(status, codes))
                response["content"][PROBLEM_MEDIA_TYPE]["examples"] = _references(codes)
                shown |= set(codes)
            for pattern, code in _ANY_OTHER.items():  # the last word, as no status of its own
                if pattern in responses:
                    responses[pattern] = responses.pop(pattern)
                    content = responses[pattern]["content"]
                    responses[pattern]["content"] = {
                        kind: {**media, "examples": _references([code])}
                        for kind, media in content.items()
                    }
    document["components"]["examples"] = {
        code: {"summary": KINDS[code].title, "value": _problem(code)} for code in sorted(shown)
    }


def _codes(path: str, operation: Operation) -> Iterator[str]:
    """Codes of the problems that an operation may answer."""
    kinds = {"*", operation["operationId"]}
    if "{" in path:
        kinds.add("of a name")
    if "requestBody" in operation:
        kinds.add("with a body")
    if "202" in operation["responses"]:
        kinds.add("as a job")
    return (code for code, kind in KINDS.items() if not kinds.isdisjoint(kind.operations))


def _response(status: int, codes: list[str]) -> dict[str, Any]:
    """The answer of one status: its problems, and their schema."""
    lines = [f"* `{code}`: {KINDS[code].title}" for code in codes]
    return {
        "description": "\n".join([f"{HTTPStatus(status).phrase}", *lines]),
        "content": {PROBLEM_MEDIA_TYPE: {"schema": {"$ref": "#/components/schemas/Problem"}}},
    }


#: Kinds of content that an example's answer may have, the likely one first.
_JSON = "application/json"
#: A request that sends the bundle of the example before it.
BUNDLE = "the bundle"


class Example(NamedTuple):
    """A request with its answer.

    Attributes:
        operation: Identifier of the operation.
        title: Title of the example.
        path: Path of the request, with its query.
        request: Body, None for none.
        status: HTTP status of the answer.
        answer: Body of the answer: JSON, or a text.
    """

    operation: str
    title: str
    path: str
    request: Any
    status: int
    answer: Any


def examples() -> list[Example]:
    """All examples, in an order in which they can be sent to an empty service."""
    text = files("service.http").joinpath("openapi_examples.json").read_text("utf-8")
    return [Example(**fields) for fields in json.loads(text)]


def add_examples(paths: dict[str, Any]) -> None:
    """Add the examples to their operations.

    Args:
        paths: Operations by path and method, as the document has them; they are changed.
    """
    operations = {
        operation["operationId"]: operation
        for methods in paths.values()
        for operation in methods.values()
    }
    bundle = None
    for example in examples():
        if example.operation == "get_bundle":
            bundle = example.answer
        request = bundle if example.request == BUNDLE else example.request
        operation = operations.get(example.operation)
        if operation is None:
            continue
        if request is not None:
            body = operation["requestBody"]["content"][_JSON]
            _add(body, example.title, request)
        content = operation["responses"].get(str(example.status), {}).get("content", {})
        for answer in content.values():
            _add(answer, example.title, example.answer)


def _add(media: dict[str, Any], title: str, value: Any) -> None:
    """Add an example under the next free name of a kind of content."""
    listed = media.setdefault("examples", {})
    number = 1 + sum(name.startswith("example_") for name in listed)
    listed[f"example_{number}"] = {"summary": title, "value": value}
    media.pop("example", None)


Schema = dict[str, Any]


def describe_fields(schemas: dict[str, Schema]) -> None:
    """Give fields that say nothing of themselves the description of their type.

    Args:
        schemas: Schemas by name, as the document has them; their fields are changed.
    """
    for schema in schemas.values():
        for field in schema.get("properties", {}).values():
            texts = _type_descriptions(field, schemas)
            if "description" not in field and len(texts) == 1:
                field["description"] = texts[0]


def describe_planner_options(schemas: dict[str, Schema]) -> None:
    """List the options of OMPL's planners, which planning has and the models have not.

    Args:
        schemas: Schemas by name, as the document has them; their fields are changed.
    """
    text = "".join(f"\n* `{name}`: {describe_options(name)}" for name in PLANNERS)
    for schema in schemas.values():
        options = schema.get("properties", {}).get("planner_options")
        if options is not None:
            options["description"] += text


def _type_descriptions(field: Schema, schemas: dict[str, Schema]) -> list[str]:
    """First lines of the descriptions of the types that a field may have."""
    if "const" in field:
        return [f"always `{field['const']}`, which tells this form from others"]
    forms = [field, *field.get("anyOf", ())]
    named = [schemas[form["$ref"].rpartition("/")[2]] for form in forms if "$ref" in form]
    texts = [str(form["description"]) for form in (*forms, *named) if "description" in form]
    return [text.partition("\n")[0] for text in texts]


def bound_timeouts(document: Schema, longest: float) -> None:
    """Publish the longest timeout that the service allows, in bodies and in parameters.

    Args:
        document: The OpenAPI document; fields and parameters are changed.
        longest: The longest timeout [s].
    """
    schemas = document["components"]["schemas"].values()
    timeouts = [schema.get("properties", {}).get("timeout", {}) for schema in schemas]
    timeouts += [one["schema"] for one in _parameters(document) if one["name"] == "timeout"]
    for timeout in timeouts:
        for form in (timeout, *timeout.get("anyOf", ())):
            if "maximum" in form:
                form["maximum"] = min(form["maximum"], longest)


def _parameters(document: Schema) -> Iterator[Schema]:
    """Parameters of all operations."""
    for operations in document["paths"].values():
        for operation in operations.values():
            yield from operation.get("parameters", ())


def close_maps(schema: Any) -> None:
    """Say of maps whose names follow a pattern that they have no other names.

    Args:
        schema: The document or a part of it, changed in place.
    """
    if isinstance(schema, dict):
        if "patternProperties" in schema:
            schema.setdefault("additionalProperties", False)
        for inner in schema.values():
            close_maps(inner)
    elif isinstance(schema, list):
        for inner in schema:
            close_maps(inner)


def describe_parameters(paths: dict[str, Schema]) -> None:
    """Say of parameters that say nothing of themselves what they name.

    Args:
        paths: Operations by path and method, as the document has them; parameters are changed.
    """
    for path, operations in paths.items():
        thing = path.removeprefix("/v1/").partition("/")[0].removesuffix("s")
        usual = {
            "name": f"name of the {thing}",
            "id": f"name of the {thing}, as the service gave it",
            "code": f"code of the {thing}",
            "limit": f"largest number of {thing}s to answer",
        }
        for operation in operations.values():
            for parameter in operation.get("parameters", ()):
                parameter.setdefault("description", usual.get(parameter["name"], ""))


DESCRIPTION = """\
Robot, scene, start and goal in; a certified, timed trajectory out.

* JSON in UTF-8; metre, radian, second, kilogram, newton.
* Quaternions are `[x, y, z, w]`. Frames are the robot's root frame unless `frame` says otherwise.
* Joint vectors are in the order of the robot's `joint_names`.
* NaN, infinity, unknown fields, unknown query parameters of a GET and wrong lengths are refused.
* Every error is a problem document (RFC 9457) with `code`, `stage`, `hint` and `details`.
* `timeout` [s] in a body covers every stage; `seed` makes an answer reproducible.
* `Prefer: respond-async` on anything that computes gives 202 and a job (`/v1/jobs`).
* A repeated POST with the same `Idempotency-Key` that created something, a job among it, gives the
  same answer.
* A plan answered with 200 is certified.
"""

_PROBLEM = {
    "content": {PROBLEM_MEDIA_TYPE: {"schema": {"$ref": "#/components/schemas/Problem"}}},
}
#: To be given to every router: any error is a problem document.
RESPONSES: dict[int | str, dict[str, Any]] = {
    "4XX": {"description": "Any other fault of the request", **_PROBLEM},
    "5XX": {"description": "Any other fault of the service", **_PROBLEM},
}


#: Two ways to show an API key.
_SECURITY_SCHEMES = {
    "bearer": {"type": "http", "scheme": "bearer", "bearerFormat": "aw_<id>_<secret>"},
    "header": {"type": "apiKey", "in": "header", "name": "X-API-Key"},
}
#: Methods of requests that compute, and may become jobs.
_COMPUTING = {"post", "put"}
_PREFER = {
    "name": "Prefer",
    "in": "header",
    "schema": {"type": "string"},
    "description": "respond-async: answer 202 with a job, and the result when it is there",
    "example": "respond-async",
}
_KEY = {
    "name": "Idempotency-Key",
    "in": "header",
    # Printable ASCII, spaces too.
    "schema": {"type": "string", "minLength": 1, "maxLength": 255, "pattern": "^[ -~]+$"},
    "description": "the same key with the same request gives the answer again that created "
    "something or accepted a job",
}
_ACCEPTED = {
    "description": "Accepted as a job",
    "headers": {"Location": {"schema": {"type": "string"}, "description": "the job"}},
    "content": {"application/json": {"schema": {"$ref": "#/components/schemas/JobSummary"}}},
}


def _tell_of_jobs(operation: dict[str, Any], method: str) -> None:
    parameters = operation.setdefault("parameters", [])
    parameters.append(_PREFER)
    if method == "post":
        parameters.append(_KEY)
    operation["responses"]["202"] = _ACCEPTED


def install(app: FastAPI) -> None:
    """Have the application publish its document with the schema of problems in it."""

    def document() -> dict[str, Any]:
        if app.openapi_schema is None:
            schema = get_openapi(
                title=app.title,
                version=app.version,
                description=app.description,
                routes=app.routes,
                license_info=app.license_info,
            )
            problem = Problem.model_json_schema()
            problem["properties"]["code"]["examples"] = sorted(KINDS)
            schemas = schema.setdefault("components", {}).setdefault("schemas", {})
            schemas["Problem"] = problem
            # Bodies that routes read by themselves, because they come in more than one form, and
            # planner_options, which is free in the request's own schema.
            for model in (RobotBody, CartesianOptions):
                more = model.model_json_schema(ref_template="#/components/schemas/{model}")
                schemas |= {**more.pop("$defs"), model.__name__: more} | schemas
            describe_planner_options(schemas)
            describe_fields(schemas)
            bound_timeouts(schema, app.state.settings.max_timeout)
            describe_parameters(schema["paths"])
            for path in schema["paths"].values():
                for method in _COMPUTING & path.keys():
                    _tell_of_jobs(path[method], method)
            add_problems(schema)
            add_examples(schema["paths"])
            schema["components"]["securitySchemes"] = _SECURITY_SCHEMES
            close_maps(schema)
            # Needed only where the service has keys.
            schema["security"] = [{}, *({name: []} for name in _SECURITY_SCHEMES)]
            app.openapi_schema = schema
        return app.openapi_schema

    app.openapi = document  # type: ignore[method-assign]
