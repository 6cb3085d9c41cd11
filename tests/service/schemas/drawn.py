"""Bodies with every field of every request, drawn from the published schemas."""

import inspect
import itertools
import operator
import pkgutil
import re
from collections.abc import Iterator
from importlib import import_module
from typing import Any

import numpy as np
from pydantic import BaseModel, ValidationError
from pydantic.json_schema import models_json_schema

import armwright_wire
from armwright_wire.base import Body
from tests.service.schemas.bodies import BRIEF, IDENTITY, POSE, SEGMENTS

Schema = dict[str, Any]

KINDS: dict[str, type[Body]] = {
    kind.__name__: kind
    for info in pkgutil.walk_packages(armwright_wire.__path__, "armwright_wire.")
    for _, kind in inspect.getmembers(import_module(info.name), inspect.isclass)
    if issubclass(kind, Body) and not kind.__name__.startswith("_")
}
#: Values where rules ask for more than the schema says, by class and field or by field alone.
VALUES: dict[str, list[Any]] = {
    "rotation_matrix": [IDENTITY],
    "transform": [np.eye(4).tolist()],
    "quaternion_xyzw": [[0.0, 0.0, 0.0, 1.0]],
    "stl_base64": ["AAAA"],
    "meshes": [{"a.stl": "AAAA"}],
    "part": ["seam", "approach"],
    "operation": ["POST /v1/plan"],
    "BatchRequest.problems": [[BRIEF]],
    "ConvertRequest.trajectory": [SEGMENTS],
    "DefaultLimits.acceleration": ["10 x velocity"],
    "DefaultLimits.jerk": ["10 x acceleration"],
    "KeptMotion.answer": [{}],
    "KeptMotion.request": [{}],
    "Refine.objective": ["time", {"time": 1.0}],
    "Segment.t0": [0.0],
    "TimedToolMotion.part": ["seam"],
    "TimedToolMotion.type": ["lin", "circ", "corner"],
    "TimedToolMotions.motions": [[{"type": "lin", "pose": POSE, "part": "seam"}]],
    "ToolCurve.type": ["lin", "circ"],
}
#: Fields that a class has from another and always refuses.
REFUSED = {("SeamStage", "motions"), ("SeamStage", "allow_partial")}
#: Classes whose tag is a field of theirs as well: faults have a path where the tag has been read.
INSIDE = {
    "JointConstraint": ("ValidateRequest", "constraints"),
    "ForEachStage": ("TaskRequest", "stages"),
    "FallbackStage": ("TaskRequest", "stages"),
}
TEXTS = ("tip", "0" * 64, "AAAA", "1.0.0", "x")
BOUNDS = {
    "minimum": operator.ge,
    "exclusiveMinimum": operator.gt,
    "maximum": operator.le,
    "exclusiveMaximum": operator.lt,
}
NUMBERS = (0.5, 1, 0.05, 3, 0.005, 12, 1e-6, 0)


def _text(schema: Schema) -> str:
    short, long = schema.get("minLength", 0), schema.get("maxLength", 1000)
    fits = (
        text
        for text in TEXTS
        if re.search(schema.get("pattern", ""), text) and short <= len(text) <= long
    )
    return next(fits)


def _number(schema: Schema) -> float:
    bounds = {name: schema.get(name) for name in BOUNDS}
    fits = (
        x
        for x in NUMBERS
        if all(bound is None or BOUNDS[name](x, bound) for name, bound in bounds.items())
    )
    if schema["type"] == "integer":
        return next(x for x in fits if isinstance(x, int))
    return float(next(fits))


class Drawing:
    """Draws values of a schema; the parts of a body are as brief as they can be."""

    def __init__(self, definitions: dict[str, Schema]) -> None:
        self.definitions = definitions
        self.briefs: dict[str, list[Any]] = {}

    def forms(self, schema: Schema, default: Any = None) -> list[Any]:
        """Values of a schema: one of each of its forms."""
        kind = schema.get("type")
        if "$ref" in schema:
            return self._class_forms(schema["$ref"].split("/")[-1])
        for union in ("anyOf", "oneOf"):
            if union in schema:
                parts = [part for part in schema[union] if part.get("type") != "null"]
                return [form for part in parts for form in self.forms(part, default)]
        if kind == "array" or "properties" in schema:
            return self._lists(schema)
        by_pattern = schema.get("patternProperties", {}).values()
        named = [schema.get("additionalProperties"), *by_pattern][-1]
        if isinstance(named, dict):  # an object by names of the caller's own
            return [{"hand": form} for form in self.forms(named)]
        if values := schema.get("enum", [schema["const"]] if "const" in schema else []):
            return [next((value for value in reversed(values) if value != default), default)]
        if kind in ("number", "integer"):
            return [_number(schema)]
        if kind == "string":
            return [_text(schema)]
        return [default is not True] if kind == "boolean" else [{"range": 0.5}]

    def _lists(self, schema: Schema) -> list[Any]:
        if "properties" in schema:  # an object without a class: a stage under its own name
            return [{name: self.forms(part)[0] for name, part in schema["properties"].items()}]
        if "prefixItems" in schema:
            columns = [self.forms(part) for part in schema["prefixItems"]]
            return [[column[0] for column in columns]]
        items = self.forms(schema["items"])
        if not items:  # the class that is being drawn, inside itself
            return []
        least = max(schema.get("minItems", 0), len(items) if isinstance(items[0], dict) else 1)
        count = min(least, schema.get("maxItems", least))
        if isinstance(items[0], dict):
            rows = list(itertools.islice(itertools.cycle(items), count))
            return [[row | {"id": f"o{i}"} if "id" in row else row for i, row in enumerate(rows)]]
        return [[item] * count for item in items]

    def _class_forms(self, name: str) -> list[Any]:
        if name not in self.briefs:
            self.briefs[name] = []  # inside itself
            schema = self.definitions[name]
            if name in KINDS:
                body = _least(KINDS[name], self._fields(name, schema), needed(name, schema), {})
                self.briefs[name] = [body]
            else:
                self.briefs[name] = self.forms(schema)
        return self.briefs[name]

    def _fields(self, name: str, schema: Schema) -> dict[str, list[Any]]:
        drawn = {
            field: VALUES.get(f"{name}.{field}")
            or VALUES.get(field)
            or self.forms(part, part.get("default"))
            for field, part in schema["properties"].items()
        }
        return {field: forms for field, forms in drawn.items() if forms}

    def bodies(self, kind: type[BaseModel], schema: Schema) -> Iterator[dict[str, Any]]:
        """Bodies of a class that together hold each form of each field."""
        fields = self._fields(kind.__name__, schema)
        missing = {
            (name, i): form
            for name, forms in fields.items()
            if (kind.__name__, name) not in REFUSED
            for i, form in enumerate(forms)
        }
        while missing:
            (name, i), form = next(iter(missing.items()))
            body = _least(kind, fields, needed(kind.__name__, schema), {name: form})
            missing.pop((name, i))
            for other, forms in fields.items():
                open_forms = [forms[k] for k in range(len(forms)) if (other, k) in missing]
                for value in (*open_forms, forms[0]) if other not in body else ():
                    if _is_valid(kind, body | {other: value}):
                        body[other] = value
                        break
            for other, value in body.items():
                for k, one in enumerate(fields[other]):
                    if one is value:
                        missing.pop((other, k), None)
            yield body


def needed(name: str, schema: Schema) -> list[str]:
    """Fields that bodies of a class have to have where they stand among others."""
    tag = KINDS[name].tag
    required: list[str] = schema.get("required", [])
    return required if tag is None or tag in required else [tag, *required]


def _is_valid(kind: type[BaseModel], body: dict[str, Any]) -> bool:
    try:
        kind.model_validate(body)
    except ValidationError:
        return False
    return True


def _least(
    kind: type[BaseModel], fields: dict[str, list[Any]], required: list[str], given: dict[str, Any]
) -> dict[str, Any]:
    """A valid body with some fields: the required ones, and as few others as rules ask for."""
    needed = [name for name in required if name not in given]
    others = [name for name in fields if name not in given and name not in required]
    for count in range(3):
        for beside in itertools.combinations(others, count):
            for values in itertools.product(*(fields[name][:3] for name in (*needed, *beside))):
                body = given | dict(zip((*needed, *beside), values, strict=True))
                if _is_valid(kind, body):
                    return body
    raise AssertionError(f"no body of {kind.__name__} holds {given}")


DRAWING = Drawing(models_json_schema([(kind, "validation") for kind in KINDS.values()])[1]["$defs"])


def _draw() -> Iterator[tuple[type[BaseModel], dict[str, Any]]]:
    for name, kind in KINDS.items():
        for body in DRAWING.bodies(kind, DRAWING.definitions[name]):
            if name in INSIDE:
                whole, field = INSIDE[name]
                yield KINDS[whole], DRAWING.forms({"$ref": whole})[0] | {field: [body]}
            else:
                yield kind, body


#: Each class with bodies that together hold each form of each of its fields.
FULL = list(_draw())
NAMES = [f"{kind.__name__}-{i}" for i, (kind, _) in enumerate(FULL)]
