"""Fields of a form, read from the API's OpenAPI document."""

from collections.abc import Mapping
from typing import Any, NamedTuple, get_args

from armwright_client.planner import KnownPlanner

#: Settings of the form, by their path in a plan request.
PATHS = (
    "planner",
    "margin",
    "clearance.preferred",
    "timing.method",
    "timing.velocity_scaling",
    "timing.acceleration_scaling",
    "timing.jerk_scaling",
    "timing.torque_limits",
    "timing.tool_speed",
    "refine",
    "collisions",
    "timeout",
    "seed",
)


class FormField(NamedTuple):
    """One setting of a plan request.

    Args:
        path: In the request, "timing.method".
        kind: "choice", "number", "integer" or "flag".
        description: Of the API.
        default: Used where the field is left out; None where the service decides.
        choices: Of a choice.
        minimum: Of a number, if there is one.
        maximum: Of a number, if there is one.
        above_minimum: Whether the minimum itself is refused.
    """

    path: str
    kind: str
    description: str
    default: Any
    choices: tuple[str, ...] = ()
    minimum: float | None = None
    maximum: float | None = None
    above_minimum: bool = False


def form_fields(document: Mapping[str, Any]) -> tuple[FormField, ...]:
    """The settings of a plan request that the service has, in the order of `PATHS`.

    Args:
        document: The OpenAPI document of the service.

    Raises:
        KeyError: The document has no plan request.
    """
    schemas = document["components"]["schemas"]
    fields = (_field(schemas, path) for path in PATHS)
    return tuple(field for field in fields if field is not None)


def _field(schemas: Mapping[str, Any], path: str) -> FormField | None:
    """A setting; None where an older service does not have it."""
    schema: Mapping[str, Any] = schemas["PlanRequest"]
    for name in path.split("."):
        properties = _resolved(schemas, schema).get("properties", {})
        if name not in properties:
            return None
        schema = properties[name]
    description = str(schema.get("description", ""))
    plain = _scalar(schemas, schema)
    choices = tuple(plain.get("enum", ()))
    if path == "planner":
        # The service takes OMPL's spellings as well, so its schema lists no names.
        choices = tuple(name for name in get_args(KnownPlanner) if name.islower())
    above = "exclusiveMinimum" in plain
    return FormField(
        path,
        _kind(plain, choices),
        description or str(plain.get("description", "")),
        schema.get("default"),
        choices,
        plain.get("exclusiveMinimum" if above else "minimum"),
        plain.get("maximum"),
        above,
    )


def _kind(schema: Mapping[str, Any], choices: tuple[str, ...]) -> str:
    if choices:
        return "choice"
    return {"boolean": "flag", "integer": "integer"}.get(str(schema.get("type")), "number")


def _resolved(schemas: Mapping[str, Any], schema: Mapping[str, Any]) -> Mapping[str, Any]:
    """The schema behind references and alternatives to null."""
    while True:
        if "$ref" in schema:
            schema = schemas[schema["$ref"].rpartition("/")[2]]
        elif "anyOf" in schema and "properties" not in schema:
            schema = next(item for item in schema["anyOf"] if item.get("type") != "null")
        elif "allOf" in schema and "properties" not in schema:
            schema = schema["allOf"][0]
        else:
            return schema


def _scalar(schemas: Mapping[str, Any], schema: Mapping[str, Any]) -> Mapping[str, Any]:
    """The first alternative that is a choice, a number or a flag."""
    alternatives = schema.get("anyOf", [schema])
    plain = (_resolved(schemas, item) for item in alternatives)
    return next(item for item in plain if item.get("type") not in ("null", "object"))
