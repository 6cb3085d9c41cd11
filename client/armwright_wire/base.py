"""Parts of every model on the wire: strictness, numbers, vectors and names."""

import math
from collections.abc import Mapping, Sequence
from typing import Annotated, Any, ClassVar, TypeVar

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Discriminator,
    Field,
    GetJsonSchemaHandler,
    JsonValue,
    Tag,
)
from pydantic.config import JsonDict
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

#: Fields by name, each with those of which one has to stand beside it.
Beside = Mapping[str, tuple[str, ...]]

_T = TypeVar("_T")


class Body(BaseModel):
    """A request: unknown fields, coerced types, NaN and infinity are refused."""

    model_config = ConfigDict(strict=True, extra="forbid", allow_inf_nan=False, frozen=True)

    #: Fields of which exactly one is given, in the published schema as well.
    one_of: ClassVar[tuple[str, ...]] = ()
    #: Fields that are given only beside one of others, in the published schema as well.
    only_beside: ClassVar[Beside] = {}
    #: Other rules of several fields, as the published schema has them.
    published_rules: ClassVar[tuple[JsonDict, ...]] = ()
    #: Whether the task of a request validates it, and says so where it is malformed.
    is_validated_by_task: ClassVar[bool] = False

    @classmethod
    def __get_pydantic_json_schema__(
        cls, core_schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> JsonSchemaValue:
        """The JSON schema, with the rules of what is given together.

        The rules stand inside of an allOf: generators of clients take an object beside a oneOf for
        one without fields.
        """
        schema = handler(core_schema)
        rules: list[JsonDict] = []
        if cls.one_of:
            rules.append({"oneOf": [is_given(name) for name in cls.one_of]})
        rules += [_schema_beside(name, others) for name, others in cls.only_beside.items()]
        rules += cls.published_rules
        if rules:
            inner = handler.resolve_ref_schema(schema)
            inner["allOf"] = [*inner.get("allOf", ()), *rules]
        return schema


class Answer(BaseModel):
    """An answer, as strict as a request so that a mistake of ours is seen here."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False, frozen=True)


class InFrame(Answer):
    """An answer whose poses and directions are in a frame."""

    frame: str = Field(description="that poses are in: the root link if no other was asked for")
    frame_note: str | None = Field(
        None, description="where the chain begins, if that is not the root frame"
    )
    notes: list[str] = Field(default_factory=list, description="what was done to the request")


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

Vector3 = Annotated[list[Number], Field(min_length=3, max_length=3)]
Vector6 = Annotated[list[Number], Field(min_length=6, max_length=6)]
Point = Annotated[list[Coordinate], Field(min_length=3, max_length=3)]
Matrix3 = Annotated[list[Vector3], Field(min_length=3, max_length=3)]
Matrix = list[list[float]]

#: A name that can stand in a URL as it is.
NAME_PATTERN = r"^[A-Za-z0-9][A-Za-z0-9_.\-]{0,127}$"
Name = Annotated[str, Field(pattern=NAME_PATTERN)]
#: A name from somebody else's file: anything printable.
Label = Annotated[str, Field(pattern=r"^[^\x00-\x1f\x7f]{1,256}$")]

#: What poses are in, beside the robot's root frame.
Frame = Annotated[
    Label,
    Field(
        description="a link that stands still, or tool: the tip where the request begins; the "
        "root frame if left out",
        examples=["tool"],
    ),
]

JointVector = Annotated[
    list[Number],
    Field(
        min_length=1,
        max_length=MAX_JOINTS,
        description="one number for each joint, in the order of `joint_names`",
    ),
]


def _one_or_many(value: Any) -> str:
    return "many" if isinstance(value, list) and value and isinstance(value[0], list) else "one"


#: A joint vector, or a list of them.
Joints = Annotated[
    Annotated[JointVector, Tag("one")]
    | Annotated[list[JointVector], Field(min_length=1, max_length=MAX_BATCH), Tag("many")],
    Discriminator(_one_or_many),
    Field(
        description="one configuration, or a list of them: a number for each joint, in the order "
        "of `joint_names` [rad or m]"
    ),
]


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
FreeForm = Annotated[dict[str, JsonValue], Field(max_length=64), AfterValidator(_finite)]


def is_given(*names: str) -> JsonDict:
    """The JSON schema of objects in which fields are given, and not as null."""
    fields: JsonDict = {name: {"not": {"type": "null"}} for name in names}
    return {"required": [*names], "properties": fields}


def _schema_beside(name: str, others: Sequence[str]) -> JsonDict:
    """The JSON schema of objects in which a field is given only beside one of others."""
    absent: JsonDict = {"properties": {name: {"type": "null"}}}
    return {"anyOf": [absent, *(is_given(other) for other in others)]}


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
    """Check that fields which belong to others are not given without them.

    Raises:
        ValueError: One is.
    """
    values = vars(body)
    for name, others in body.only_beside.items():
        if values[name] is not None and all(values[other] is None for other in others):
            raise ValueError(f"{name} belongs to {' or '.join(others)}: give both or neither")


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
