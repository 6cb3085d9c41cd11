"""Parts of every model on the wire: strictness, numbers, vectors and names."""

import ast
import inspect
import json
import math
import sys
from collections.abc import Mapping, Sequence
from datetime import datetime
from functools import cache
from importlib.resources import files
from itertools import pairwise
from typing import (
    TYPE_CHECKING,
    Annotated,
    Any,
    ClassVar,
    Literal,
    Protocol,
    Self,
    TypeAlias,
    TypeVar,
    get_args,
)

from pydantic import (
    AfterValidator,
    AliasChoices,
    BaseModel,
    ConfigDict,
    Discriminator,
    Field,
    GetCoreSchemaHandler,
    GetJsonSchemaHandler,
    JsonValue,
    PlainSerializer,
    Tag,
    WithJsonSchema,
    model_validator,
)
from pydantic.config import JsonDict
from pydantic.fields import FieldInfo
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema

#: A megametre: nothing an arm can reach is farther, and squares of it stay exact enough.
MAX_COORDINATE = 1e6
#: Far beyond any joint value, rate or gain, and far from where float64 overflows when multiplied.
MAX_NUMBER = 1e12
#: How many configurations one request may carry.
MAX_BATCH = 10_000
#: More joints than any serial chain that can be built here.
MAX_JOINTS = 64

#: A configuration of the built-in Panda, for examples.
JOINTS_EXAMPLE = [0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785]

#: Fields by name, each with those of which one has to stand beside it.
Beside = Mapping[str, tuple[str, ...]]

_T = TypeVar("_T")


class ArrayLike(Protocol):
    """An array of NumPy, by the method used here."""

    def tolist(self) -> Any:
        """The values as lists."""


#: What may be given where joint values, points or other vectors are taken.
VectorLike: TypeAlias = Sequence[float] | ArrayLike
#: What may be given where rows of numbers are taken.
RowsLike: TypeAlias = Sequence[Sequence[float]] | Sequence[ArrayLike] | ArrayLike


@cache
def _all_examples() -> dict[str, list[JsonValue]]:
    text = files("armwright_wire").joinpath("examples.json").read_text("utf-8")
    made: dict[str, list[JsonValue]] = json.loads(text)
    return made


def examples(model: str) -> list[JsonValue]:
    """The examples of a model in its JSON schema, those of ``examples.json``.

    Args:
        model: Name of the class.
    """
    return _all_examples()[model]


def _documented(kind: ast.ClassDef) -> dict[str, str]:
    """Docstrings of the fields of a class, the strings below them; empty for none."""
    found = {}
    for field, below in pairwise([*kind.body, None]):
        if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name):
            match below:
                case ast.Expr(value=ast.Constant(value=str() as text)):
                    found[field.target.id] = " ".join(text.split())
                case _:
                    found[field.target.id] = ""
    return found


@cache
def _docstrings(module: str) -> dict[str, dict[str, str]]:
    """Docstrings of fields by class of a module.

    They are read when a schema is made: ``use_attribute_docstrings`` of pydantic reads the source
    of every class at import.
    """
    nodes = ast.walk(ast.parse(inspect.getsource(sys.modules[module])))
    return {node.name: _documented(node) for node in nodes if isinstance(node, ast.ClassDef)}


def _wire_name(name: str, field: FieldInfo | None) -> str:
    """The name on the wire of a field: type checkers take a plain alias for that in Python."""
    alias = None if field is None else field.validation_alias
    return str(alias.choices[0]) if isinstance(alias, AliasChoices) else name


class Wire(BaseModel):
    """A part of a request or answer; the string below a field describes it in the schema."""

    # Validators are built when they are needed: an import takes half the time.
    model_config = ConfigDict(defer_build=True)

    #: Whether a request takes the fields of an object, not the object as it is.
    goes_by_fields: ClassVar[bool] = False
    #: Models whose docstrings describe fields that are taken from them by name.
    documented_by: ClassVar[tuple[type["Wire"], ...]] = ()

    @classmethod
    def read(cls, content: bytes) -> Self:
        """Read JSON; fields that are not known here are passed over, as a newer service has more.

        Raises:
            pydantic.ValidationError: A field that is known here is missing or has another type.
        """
        return cls.model_validate_json(content, extra="ignore", strict=False)

    @classmethod
    def __get_pydantic_json_schema__(
        cls, core_schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> JsonSchemaValue:
        """The JSON schema, with the docstrings of the fields as their descriptions."""
        schema = handler(core_schema)
        fields = handler.resolve_ref_schema(schema).get("properties", {})
        models = (cls, *cls.documented_by)
        kinds = [kind for model in models for kind in model.__mro__ if issubclass(kind, Wire)]
        texts = [_docstrings(kind.__module__).get(kind.__name__, {}) for kind in kinds]
        for name, field in cls.model_fields.items():
            if text := next((known[name] for known in texts if name in known), ""):
                fields[_wire_name(name, field)]["description"] = text
        return schema


def build_at_once() -> None:
    """Build the validators of all models, now and when they are made: no request waits for them."""
    kinds: list[type[Wire]] = [Wire]
    for kind in kinds:
        kind.model_config["defer_build"] = False
        kinds += kind.__subclasses__()
    for kind in kinds:
        kind.model_rebuild()


class Body(Wire):
    """A request: unknown fields, coerced types, NaN and infinity are refused.

    Python code may give tuples and arrays for lists, and parts of answers for parts of requests;
    the field that tells a form from others (`type` or `kind`) may be left out.
    """

    model_config = ConfigDict(strict=True, extra="forbid", allow_inf_nan=False, frozen=True)

    #: Fields of which exactly one is given, in the published schema as well.
    one_of: ClassVar[tuple[str, ...]] = ()
    #: Fields that are given only beside one of others, in the published schema as well.
    only_beside: ClassVar[Beside] = {}
    #: Fields that are given only beside all of others, likewise.
    needs: ClassVar[Beside] = {}
    #: Groups of fields of which at most one is given, likewise.
    at_most_one: ClassVar[tuple[tuple[str, ...], ...]] = ()
    #: Other rules of several fields, as the published schema has them.
    published_rules: ClassVar[tuple[JsonDict, ...]] = ()

    #: The field that tells this form from others, if there are any.
    tag: ClassVar[str | None] = None
    #: Whether it has to be given; not where another field of this form alone tells it.
    tag_is_needed: ClassVar[bool] = True

    def __init__(self, **fields: Any) -> None:
        known = type(self).model_fields
        given = {
            _wire_name(name, known.get(name)): as_json(value) for name, value in fields.items()
        }
        super().__init__(**given)
        if self.tag is not None:
            self.__pydantic_fields_set__.add(self.tag)

    # Only code that makes an object comes by there, not validation.
    __init__.__pydantic_base_init__ = True  # type: ignore[attr-defined]

    @classmethod
    def __pydantic_init_subclass__(cls, **_: Any) -> None:
        """Note the field that tells this form from others."""
        for name in ("type", "kind"):
            field = cls.model_fields.get(name)
            if field is not None and [field.default] == [*get_args(field.annotation)]:
                cls.tag = name

    @classmethod
    def of(cls, **fields: Any) -> Self:
        """The request with the fields that are not None."""
        return cls(**{name: value for name, value in fields.items() if value is not None})

    def to_json(self) -> str:
        """The JSON that is sent: the fields that were given, by their names on the wire.

        Copies with other fields (`model_copy`) may hold a `Pose` where a `FramedPose` is declared.
        """
        return self.model_dump_json(by_alias=True, exclude_unset=True, serialize_as_any=True)

    @classmethod
    def __get_pydantic_json_schema__(
        cls, core_schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> JsonSchemaValue:
        """The JSON schema, with the rules of what is given together.

        The rules stand inside of an allOf: generators of clients take an object beside a oneOf for
        one without fields.
        """
        schema = super().__get_pydantic_json_schema__(core_schema, handler)
        if cls.tag is not None and cls.tag_is_needed:
            publish_as_required(handler.resolve_ref_schema(schema), cls.tag)
        rules: list[JsonDict] = []
        if cls.one_of:
            rules.append({"oneOf": [is_given(name) for name in cls.one_of]})
        rules += [_schema_beside(name, others) for name, others in cls.only_beside.items()]
        rules += [{"anyOf": [_absent(k), is_given(*names)]} for k, names in cls.needs.items()]
        rules += [
            {"oneOf": [_absent(*names), *(is_given(name) for name in names)]}
            for names in cls.at_most_one
        ]
        rules += cls.published_rules
        if rules:
            inner = handler.resolve_ref_schema(schema)
            inner["allOf"] = [*inner.get("allOf", ()), *rules]
        return schema


class BodyWithRules(Body):
    """A request with rules on what is given together; others need no validator of their own."""

    @model_validator(mode="after")
    def _check_rules(self) -> Self:
        """Check what is given together, before the rules of a form of its own."""
        if self.one_of:
            exactly_one(self, self.one_of)
        if self.only_beside or self.needs or self.at_most_one:
            check_company(self)
        return self


class Answer(Wire):
    """An answer, as strict as a request so that a mistake of ours is seen here."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False, frozen=True)

    goes_by_fields: ClassVar[bool] = True


class InFrame(Answer):
    """An answer whose poses and directions are in a frame."""

    frame: str
    """that poses are in: the root link if no other was asked for"""
    frame_note: str | None = None
    """where the chain begins, if that is not the root frame"""
    notes: list[str] = Field(default_factory=list)
    """what was done to the request"""


Number = Annotated[float, Field(ge=-MAX_NUMBER, le=MAX_NUMBER)]
Positive = Annotated[float, Field(gt=0.0, le=MAX_NUMBER)]
NonNegative = Annotated[float, Field(ge=0.0, le=MAX_NUMBER)]
#: A nanometre is the least size or tolerance that is not a slip of the pen.
Length = Annotated[float, Field(ge=1e-9, le=MAX_COORDINATE)]
Coordinate = Annotated[float, Field(ge=-MAX_COORDINATE, le=MAX_COORDINATE)]
Ratio = Annotated[float, Field(gt=0.0, le=1.0)]
Timeout = Annotated[
    float,
    Field(
        gt=0.0,
        le=86_400.0,
        description="longest time for the whole request [s]; the service's default if left out",
    ),
]
#: Random generators of the planners are seeded with 32 bits.
Seed = Annotated[
    int,
    Field(ge=0, le=2**32 - 1, description="of all random choices: the same seed, the same answer"),
]

Matrix: TypeAlias = list[list[float]]


class _AsList:
    """Sequence for type checkers, as tuples and arrays may be given; objects hold lists."""

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        return handler(list[get_args(source)[0]])  # type: ignore[misc]


AS_LIST = _AsList()
Vector3 = Annotated[Sequence[Number], AS_LIST, Field(min_length=3, max_length=3)]
Vector6 = Annotated[Sequence[Number], AS_LIST, Field(min_length=6, max_length=6)]
Point = Annotated[Sequence[Coordinate], AS_LIST, Field(min_length=3, max_length=3)]
Matrix3 = Annotated[Sequence[Vector3], AS_LIST, Field(min_length=3, max_length=3)]

#: A name that can stand in a URL as it is.
NAME_PATTERN = r"^[A-Za-z0-9][A-Za-z0-9_.\-]{0,127}$"
Name = Annotated[str, Field(pattern=NAME_PATTERN)]
#: A name from somebody else's file: anything printable.
Label = Annotated[str, Field(pattern=r"^[^\x00-\x1f\x7f]{1,256}$")]
#: Names of two bodies, in an answer.
NamePair = Annotated[
    tuple[str, str], WithJsonSchema({"type": "array", "items": {"type": "string"}})
]
#: A moment in an answer: ISO 8601.
Instant = Annotated[
    datetime,
    PlainSerializer(datetime.isoformat, return_type=str),
    WithJsonSchema({"type": "string"}),
]

#: What poses are in, beside the robot's root frame.
Frame = Annotated[
    Label,
    Field(
        description="a link that stands still, or tool: the tip where the request begins; the "
        "root frame if left out",
        examples=["tool"],
    ),
]


def _one_or_many(value: Any) -> str:
    return "many" if isinstance(value, list) and value and isinstance(value[0], list) else "one"


JointVector = Annotated[
    Sequence[Number],
    AS_LIST,
    Field(
        min_length=1,
        max_length=MAX_JOINTS,
        description="one number for each joint, in the order of `joint_names`",
    ),
]
_JointRows = Annotated[
    Sequence[JointVector], AS_LIST, Field(min_length=1, max_length=MAX_BATCH), Tag("many")
]
#: A joint vector, or a list of them.
Joints = Annotated[
    Annotated[JointVector, Tag("one")] | _JointRows,
    Discriminator(_one_or_many),
    Field(
        description="one configuration, or a list of them: a number for each joint, in the "
        "order of `joint_names` [rad or m]"
    ),
]


#: Types of values that stay as they are.
_SIMPLE_TYPES = frozenset({float, int, str, bool, type(None)})


def as_json(value: Any) -> Any:
    """Tuples and arrays as lists, mappings and answers as dictionaries, at any depth."""
    if isinstance(value, list | tuple):
        # Nearly all are numbers: a call for each of them would be most of what it takes.
        return [item if type(item) in _SIMPLE_TYPES else as_json(item) for item in value]
    if isinstance(value, Wire):
        return _fields(value) if value.goes_by_fields else value
    if isinstance(value, Mapping):
        return {name: as_json(item) for name, item in value.items()}
    return value.tolist() if hasattr(value, "tolist") else value


def _fields(part: Wire) -> dict[str, Any]:
    """Fields of an answer that has them, or of a part of a request that were given."""
    names = part.model_fields_set if isinstance(part, Body) else type(part).model_fields
    values = vars(part)
    return {name: as_json(values[name]) for name in names if values[name] is not None}


def publish_as_required(schema: JsonSchemaValue, tag: str) -> None:
    """Publish a field with a default as one that is required: the service always gives it."""
    fields = schema["properties"]
    if "default" not in fields[tag]:
        return
    del fields[tag]["default"]
    needed = {*schema.get("required", ()), tag}
    schema["required"] = [name for name in fields if name in needed]


def _finite(value: _T) -> _T:
    pending: list[Any] = [value]
    while pending:
        item = pending.pop()
        if isinstance(item, dict):
            pending.extend(item.values())
        elif isinstance(item, list):
            pending.extend(item)
        elif isinstance(item, float) and not math.isfinite(item):
            raise ValueError("every number must be finite")
    return value


#: An object whose fields only the domain knows.
if TYPE_CHECKING:
    FreeForm: TypeAlias = Mapping[str, Any]
else:
    FreeForm = Annotated[dict[str, JsonValue], Field(max_length=64), AfterValidator(_finite)]


def is_given(*names: str) -> JsonDict:
    """The JSON schema of objects in which fields are given, and not as null."""
    fields: JsonDict = {name: {"not": {"type": "null"}} for name in names}
    return {"required": [*names], "properties": fields}


def _absent(*names: str) -> JsonDict:
    """The JSON schema of objects in which none of some fields is given."""
    return {"properties": {name: {"type": "null"} for name in names}}


def only_where(name: str, **values: JsonValue) -> JsonDict:
    """The JSON schema of objects in which a field is given only where others have these values."""
    fields: JsonDict = {other: {"const": value} for other, value in values.items()}
    return {"anyOf": [_absent(name), {"required": [*values], "properties": fields}]}


def not_where(*names: str, **values: JsonValue) -> JsonDict:
    """The JSON schema of objects in which fields are not all given where others have values."""
    fields: JsonDict = {other: {"const": value} for other, value in values.items()}
    return {"not": {"allOf": [is_given(*names), {"required": [*values], "properties": fields}]}}


def not_both(name: str, *others: str) -> tuple[JsonDict, ...]:
    """The JSON schemas of objects in which a field and any of others are not both given."""
    return tuple({"not": is_given(name, other)} for other in others)


def _schema_beside(name: str, others: Sequence[str]) -> JsonDict:
    """The JSON schema of objects in which a field is given only beside one of others."""
    return {"anyOf": [_absent(name), *(is_given(other) for other in others)]}


Range = Annotated[list[Number], Field(min_length=2, max_length=2)]
Rotation = Literal["rx", "ry", "rz"]


class FreeOrRange(Body):
    """Ranges [least, largest] along axes x to rz, of which none is among the `free` ones too."""

    published_rules: ClassVar[tuple[JsonDict, ...]] = tuple(
        {"not": {"allOf": [is_given(axis, "free"),
                           {"properties": {"free": {"contains": {"const": axis}}}}]}}
        for axis in ("rx", "ry", "rz")
    )  # fmt: skip

    free: Annotated[list[Rotation], Field(max_length=3)] = Field(
        default_factory=list, examples=[["rz"]]
    )
    """axes about which any angle will do"""
    x: Range | None = None
    """[least, largest] deviation along x [m]"""
    y: Range | None = None
    """along y [m]"""
    z: Range | None = Field(None, examples=[[-0.005, 0.005]])
    """along z [m]"""
    rx: Range | None = None
    """about x [rad]"""
    ry: Range | None = None
    """about y [rad]"""
    rz: Range | None = None
    """about z [rad]"""

    @model_validator(mode="after")
    def _check_ranges(self) -> Self:
        for name in ("x", "y", "z", "rx", "ry", "rz"):
            given = getattr(self, name)
            if given is not None and given[0] > given[1]:
                raise ValueError(f"{name}: {given[0]:g} is above {given[1]:g}")
            if given is not None and name in self.free:
                raise ValueError(f"{name} has a range and is free: give one of them")
        return self


def any_given(*forms: tuple[str, ...]) -> JsonDict:
    """The addition to a schema that asks for one of several groups of fields."""
    return {"allOf": [{"anyOf": [is_given(*names) for names in forms]}]}


def exactly_one(body: BaseModel, names: Sequence[str]) -> None:
    """Check that one field of several is given.

    Raises:
        ValueError: None or more than one is given.
    """
    values = vars(body)
    given = [name for name in names if values[name] is not None]
    if len(given) != 1:
        found = " and ".join(given) if given else "none of them"
        raise ValueError(f"give exactly one of {', '.join(names)}; found {found}")


def check_company(body: Body) -> None:
    """Check that fields are given beside those they belong to, and not beside others.

    Raises:
        ValueError: One is.
    """
    values = vars(body)
    for name, others in body.only_beside.items():
        if values[name] is not None and all(values[other] is None for other in others):
            raise ValueError(f"{name} belongs to {' or '.join(others)}: give both or neither")
    for name, others in body.needs.items():
        if values[name] is not None and any(values[other] is None for other in others):
            raise ValueError(f"{name} needs {' and '.join(others)}")
    for names in body.at_most_one:
        given = [name for name in names if values[name] is not None]
        if len(given) > 1:
            raise ValueError(f"give {' or '.join(given)}, not both")


def distinct(labels: Sequence[str], what: str) -> None:
    """Check that no label stands twice.

    Raises:
        ValueError: One does.
    """
    seen: set[str] = set()
    for label in labels:
        if label in seen:
            raise ValueError(f"{what} {label!r} is given twice; each must be unique")
        seen.add(label)


#: The kept plan that an answer became.
PlanId = Annotated[
    str | None, Field(description="of the kept plan (GET /v1/plans/{id}), if it was kept")
]


class Keepable(Body):
    """A request whose answer can be kept, to be looked at or replayed later."""

    keep: bool | None = None
    """keep request and answer, or problem, as a plan (GET /v1/plans); if left out, those of jobs
    are kept
    """
