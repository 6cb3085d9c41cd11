"""Descriptions and bounds of fields and parameters in the OpenAPI document."""

from typing import Any

from planning.sampling.planners import PLANNERS, describe_options

Schema = dict[str, Any]


def describe_fields(schemas: dict[str, Schema]) -> None:
    """Give fields that say nothing of themselves the description of their type.

    Args:
        schemas: By name, as the document has them; their fields are changed.
    """
    for schema in schemas.values():
        for field in schema.get("properties", {}).values():
            texts = _type_descriptions(field, schemas)
            if "description" not in field and len(texts) == 1:
                field["description"] = texts[0]


def describe_planner_options(schemas: dict[str, Schema]) -> None:
    """List the options of OMPL's planners, which planning has and the models have not.

    Args:
        schemas: By name, as the document has them; their fields are changed.
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


def bound_timeouts(schemas: dict[str, Schema], longest: float) -> None:
    """Publish the longest timeout that the service allows.

    Args:
        schemas: By name, as the document has them; their fields are changed.
        longest: The longest timeout [s].
    """
    for schema in schemas.values():
        timeout = schema.get("properties", {}).get("timeout", {})
        for form in (timeout, *timeout.get("anyOf", ())):
            if "maximum" in form:
                form["maximum"] = min(form["maximum"], longest)


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


def bound_timeout_parameters(paths: dict[str, Schema], longest: float) -> None:
    """Publish the longest timeout that the service allows in parameters.

    Args:
        paths: Operations by path and method, as the document has them; parameters are changed.
        longest: The longest timeout [s].
    """
    for operations in paths.values():
        for operation in operations.values():
            for parameter in operation.get("parameters", ()):
                if parameter["name"] == "timeout":
                    form = parameter["schema"]
                    bound_timeouts({"": {"properties": {"timeout": form}}}, longest)


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
