"""The OpenAPI document, beyond what the framework derives from the routes."""

from typing import Any

from fastapi import FastAPI
from fastapi.openapi.utils import get_openapi

from armwright_wire.job import Problem
from armwright_wire.robot import RobotBody
from armwright_wire.tool_motion import CartesianOptions
from service.http import openapi_examples, openapi_fields, openapi_problems
from service.http.errors import KINDS, PROBLEM_MEDIA_TYPE

DESCRIPTION = """\
Robot, scene, start and goal in; a certified, timed trajectory out.

* JSON in UTF-8; metre, radian, second, kilogram, newton.
* Quaternions are `[x, y, z, w]`. Frames are the robot's root frame unless `frame` says otherwise.
* Joint vectors are in the order of the robot's `joint_names`.
* NaN, infinity, unknown fields and wrong lengths are refused.
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
            # Bodies that routes read by themselves, because they come in more than one form.
            robot = RobotBody.model_json_schema(ref_template="#/components/schemas/{model}")
            schemas |= {**robot.pop("$defs"), "RobotBody": robot} | schemas
            # Of planner_options, which is free in the request's own schema.
            options = CartesianOptions.model_json_schema(
                ref_template="#/components/schemas/{model}"
            )
            schemas |= {**options.pop("$defs"), "CartesianOptions": options} | schemas
            openapi_fields.describe_planner_options(schemas)
            openapi_fields.describe_fields(schemas)
            longest = app.state.settings.max_timeout
            openapi_fields.bound_timeouts(schemas, longest)
            openapi_fields.bound_timeout_parameters(schema["paths"], longest)
            openapi_fields.describe_parameters(schema["paths"])
            for path in schema["paths"].values():
                for method in _COMPUTING & path.keys():
                    _tell_of_jobs(path[method], method)
            openapi_problems.add_problems(schema)
            openapi_examples.add_examples(schema["paths"])
            schema["components"]["securitySchemes"] = _SECURITY_SCHEMES
            openapi_fields.close_maps(schema)
            # Needed only where the service has keys.
            schema["security"] = [{}, *({name: []} for name in _SECURITY_SCHEMES)]
            app.openapi_schema = schema
        return app.openapi_schema

    app.openapi = document  # type: ignore[method-assign]
