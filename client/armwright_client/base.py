"""Base models: strict requests, tolerant answers, vectors."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Annotated, Any, Protocol, Self, TypeAlias

from pydantic import BaseModel, ConfigDict, Field, GetCoreSchemaHandler, JsonValue
from pydantic_core import core_schema


class ArrayLike(Protocol):
    """An array of NumPy, by the methods used here."""

    def tolist(self) -> Any:
        """The values as lists."""


class Readable(BaseModel):
    """A model that can be read from an answer, whatever a newer service adds to it."""

    # What checks a model is built when it is needed: an import takes half the time.
    model_config = ConfigDict(defer_build=True)

    @classmethod
    def read(cls, content: bytes) -> Self:
        """Read the JSON of an answer; fields that are not known here are passed over.

        Raises:
            pydantic.ValidationError: What is known here is missing or has another type.
        """
        return cls.model_validate_json(content, extra="ignore", strict=False)


class Request(Readable):
    """Part of a request: unknown fields, coerced types, NaN and infinity are refused.

    Raises:
        pydantic.ValidationError: A value is refused.
    """

    model_config = ConfigDict(strict=True, extra="forbid", allow_inf_nan=False, frozen=True)

    @classmethod
    def of(cls, **fields: Any) -> Self:
        """Make it of whatever a caller gave; what does not fit is refused when it is run."""
        return cls(**fields)


class Answer(Readable):
    """Part of an answer; fields that are not known here are passed over."""

    model_config = ConfigDict(extra="ignore", frozen=True)


class InFrame(Answer):
    """An answer whose poses and directions are in a frame.

    Args:
        frame: That they are in: the root link if no other was asked for.
        frame_note: Where the chain begins, if that is not the root frame.
        notes: What was done to the request, say a start moved onto a limit.
    """

    frame: str | None = None
    frame_note: str | None = None
    notes: list[str] = Field(default_factory=list)


#: Types of values that stay as they are.
_PLAIN_TYPES = frozenset({float, int, str, bool, type(None)})


def plain(value: Any) -> Any:
    """Tuples and arrays as lists and mappings as dictionaries, at any depth; the rest as it is."""
    if isinstance(value, list | tuple):
        # Nearly all are numbers: a call for each of them would be most of what it takes.
        return [item if type(item) in _PLAIN_TYPES else plain(item) for item in value]
    if hasattr(value, "tolist"):
        return value.tolist()
    if isinstance(value, Mapping):
        return {name: plain(item) for name, item in value.items()}
    return value


#: What may be given where joint values, points or other vectors are taken.
VectorLike: TypeAlias = Sequence[float] | ArrayLike
#: What may be given where rows of numbers are taken.
RowsLike: TypeAlias = Sequence[Sequence[float]] | Sequence[ArrayLike] | ArrayLike


class Plain:
    """In front of a type: tuples, arrays and mappings are taken too.

    JSON has none of them, so answers are read without looking for them.
    """

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> core_schema.CoreSchema:
        """The schema of the type, behind `plain` for all but JSON."""
        schema = handler(source)
        return core_schema.json_or_python_schema(
            json_schema=schema,
            python_schema=core_schema.no_info_before_validator_function(plain, schema),
        )


PLAIN = Plain()

if TYPE_CHECKING:
    # What is read is a list, but a tuple may be given.
    Vector: TypeAlias = Sequence[float]
    Vector3: TypeAlias = Sequence[float]
    Vector4: TypeAlias = Sequence[float]
    Vector6: TypeAlias = Sequence[float]
    Matrix3: TypeAlias = Sequence[Sequence[float]]
    Matrix4: TypeAlias = Sequence[Sequence[float]]
    Rows: TypeAlias = Sequence[Sequence[float]]
    Points: TypeAlias = Sequence[Sequence[float]]
    Faces: TypeAlias = Sequence[Sequence[int]]
    Names: TypeAlias = Sequence[str]
    Pairs: TypeAlias = Sequence[Sequence[str]]
    Options: TypeAlias = Mapping[str, Any]
    OptionsList: TypeAlias = Sequence[Mapping[str, Any]]
else:
    _Row = Annotated[list[float], Field(min_length=1)]
    _Row3 = Annotated[list[float], Field(min_length=3, max_length=3)]
    _Row4 = Annotated[list[float], Field(min_length=4, max_length=4)]
    _Row6 = Annotated[list[float], Field(min_length=6, max_length=6)]
    _Pair = Annotated[list[str], Field(min_length=2, max_length=2)]
    Vector = Annotated[_Row, PLAIN]
    Vector3 = Annotated[_Row3, PLAIN]
    Vector4 = Annotated[_Row4, PLAIN]
    Vector6 = Annotated[_Row6, PLAIN]
    Matrix3 = Annotated[list[_Row3], Field(min_length=3, max_length=3), PLAIN]
    Matrix4 = Annotated[list[_Row4], Field(min_length=4, max_length=4), PLAIN]
    Rows = Annotated[list[_Row], Field(min_length=1), PLAIN]
    Points = Annotated[list[_Row3], PLAIN]
    Faces = Annotated[list[list[int]], PLAIN]
    Names = Annotated[list[str], PLAIN]
    Pairs = Annotated[list[_Pair], PLAIN]
    #: An object whose fields are the service's to check, such as the options of a planner.
    Options = Annotated[dict[str, JsonValue], PLAIN]
    OptionsList = Annotated[list[dict[str, JsonValue]], PLAIN]

Positive = Annotated[float, Field(gt=0.0)]
NonNegative = Annotated[float, Field(ge=0.0)]
Matrix: TypeAlias = list[list[float]]
