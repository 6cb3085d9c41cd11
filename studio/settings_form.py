"""Fields of a form, read from the API's OpenAPI document."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from armwright_wire.plans.plan import PLANNERS

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

#: Options of a tour and of a tool path that have a widget.
_TOUR_OPTIONS = ("end", "precedence", "rounds", "leg_timeout", "allow_partial")
_PATH_OPTIONS = (
    "tool_speed",
    "speed_band",
    "blend",
    "through",
    "tolerance",
    "approach",
    "retreat",
    "branch_changes",
    "orientation",
    "max_deviation",
    "max_orientation_deviation",
    "allow_partial",
)

#: Types of JSON with a widget of their own.
_SINGLE = ("boolean", "integer", "number", "string")


class FormField(NamedTuple):
    """One setting of a plan request.

    Args:
        path: Path in the request, "timing.method".
        kind: "choice", "number", "integer", "flag", "text", or "json" for lists and objects.
        description: Description of the API.
        default: Used where the field is left out; None where the service decides.
        choices: Allowed values of a choice.
        minimum: Minimum of a number, if there is one.
        maximum: Maximum of a number, if there is one.
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
    required: bool = False


class EntryForms(NamedTuple):
    """Forms of the entries of a list, by their kind.

    Args:
        tag: Field that names the kind.
        fields: Fields of each kind, without the field of the kind.
    """

    tag: str
    fields: Mapping[str, tuple[FormField, ...]]

    def kind(self, entry: Mapping[str, Any]) -> str:
        """The kind of an entry; the only one where entries do not name theirs."""
        return str(entry[self.tag]) if self.tag else next(iter(self.fields))


def goal_form(document: Mapping[str, Any]) -> EntryForms:
    """The form of a tour's goals, from the OpenAPI document of the service."""
    return _list_form(document, "TourRequest", "goals", "goal")


def waypoint_form(document: Mapping[str, Any]) -> EntryForms:
    """The form of a tool path's waypoints, from the OpenAPI document of the service."""
    return _list_form(document, "CartesianOptions", "waypoints", "waypoint")


def tour_fields(document: Mapping[str, Any]) -> tuple[FormField, ...]:
    """Options of a tour, from the OpenAPI document of the service."""
    return _option_fields(document, "TourRequest", _TOUR_OPTIONS)


def path_fields(document: Mapping[str, Any]) -> tuple[FormField, ...]:
    """Options of a tool path, from the OpenAPI document of the service."""
    return _option_fields(document, "CartesianOptions", _PATH_OPTIONS)


def _list_form(document: Mapping[str, Any], model: str, name: str, word: str) -> EntryForms:
    schemas = document["components"]["schemas"]
    items = _resolved(schemas, schemas[model]["properties"][name])["items"]
    return EntryForms("", {word: _fields_of(schemas, _resolved(schemas, items))})


def _option_fields(
    document: Mapping[str, Any], model: str, names: Sequence[str]
) -> tuple[FormField, ...]:
    schemas = document["components"]["schemas"]
    found = {field.path: field for field in _fields_of(schemas, schemas[model])}
    return tuple(found[name] for name in names if name in found)


def _fields_of(
    schemas: Mapping[str, Any], schema: Mapping[str, Any], without: str = ""
) -> tuple[FormField, ...]:
    required = schema.get("required", ())
    return tuple(
        _form_field(schemas, path, item)._replace(required=path in required)
        for path, item in schema["properties"].items()
        if path != without
    )


def entry_forms(document: Mapping[str, Any], model: str, name: str) -> EntryForms:
    """Forms of a list whose entries have one of several kinds.

    Args:
        document: The OpenAPI document of the service.
        model: Model of the request, "TaskRequest".
        name: Name of the list in the request, "stages".

    Raises:
        KeyError: The document has no such request, or no such list in it.
    """
    schemas = document["components"]["schemas"]
    items = _resolved(schemas, schemas[model]["properties"][name])["items"]
    discriminator = items["discriminator"]
    tag = str(discriminator["propertyName"])
    kinds = {reference: kind for kind, reference in discriminator["mapping"].items()}
    fields = {}
    # The mapping is sorted by name; the alternatives stand in the API's own order. Another form of
    # one of them has no name of its own.
    for reference in (item["$ref"] for item in items["oneOf"] if "$ref" in item):
        kind = kinds[reference]
        fields[kind] = _fields_of(schemas, schemas[reference.rpartition("/")[2]], tag)
    return EntryForms(tag, fields)


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
    return _form_field(schemas, path, schema)


def _form_field(schemas: Mapping[str, Any], path: str, schema: Mapping[str, Any]) -> FormField:
    description = str(schema.get("description", ""))
    plain = _scalar(schemas, schema)
    choices = tuple(plain.get("enum", ()))
    if path == "planner":
        # The service takes OMPL's spellings as well, so its schema lists no names.
        choices = PLANNERS
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
    kinds = {"boolean": "flag", "integer": "integer", "number": "number", "string": "text"}
    return kinds.get(str(schema.get("type")), "json")


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
    """The first alternative that is a choice, a number, a flag or a text; else any but null."""
    plain = [_resolved(schemas, item) for item in schema.get("anyOf", [schema])]
    present = [item for item in plain if item.get("type") != "null"]
    single = (item for item in present if item.get("type") in _SINGLE or "enum" in item)
    return next(single, present[0])
