"""Scenes: obstacles by name, and projections of points onto them."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self, TypeAlias

from pydantic import Field, SerializerFunctionWrapHandler, model_serializer, model_validator

from armwright_client.base import PLAIN, Answer, NonNegative, Points, Request
from armwright_client.pose import AnyPose
from armwright_client.shape import Shape


class LimitedPair(Request):
    """A pair that may touch, and how deep the two may overlap [m]; None for any depth."""

    pair: Annotated[list[str], Field(min_length=2, max_length=2), PLAIN]
    touch_depth: NonNegative | None = None


if TYPE_CHECKING:
    AllowedPairs: TypeAlias = Sequence[Sequence[str] | LimitedPair]
else:
    _Pair = Annotated[list[str], Field(min_length=2, max_length=2)]
    AllowedPairs = Annotated[list[_Pair | LimitedPair], PLAIN]


class TouchDepth(Request):
    """How deep bodies may overlap where they may touch [m]; None for any depth."""

    touch_depth: NonNegative | None = 1e-3

    @model_serializer(mode="wrap")
    def _with_any_depth(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        # None asks for something here, and is sent where others are left out.
        dumped: dict[str, Any] = handler(self)
        return dumped if self.touch_depth is not None else {**dumped, "touch_depth": None}


class AllowedPair(Answer):
    """A pair that was not kept apart.

    Args:
        pair: Names of the two bodies.
        reason: Who allows it.
        overlap: How deep they overlap at most [m], for every instant of a motion; None where it is
            not measured.
    """

    pair: tuple[str, str]
    reason: str = ""
    overlap: float | None = None


class Obstacle(Request):
    """A shape at a pose, to be kept away from by its margin [m]."""

    id: str
    shape: Shape
    pose: AnyPose
    margin: NonNegative | None = None


class Scene(Request):
    """Obstacles, or the text of a MoveIt planning scene.

    Args:
        name: Needed to store it.
        obstacles: Each with an id of its own.
        frame: Of obstacles that name none: a link that stands still, or "tool".
        moveit: Planning scene of MoveIt instead of obstacles: its YAML, or its .scene text.
        allowed_collisions: Pairs of links or obstacles that may touch.
    """

    name: str | None = None
    frame: str | None = None
    obstacles: list[Obstacle] | None = None
    moveit: str | None = None
    allowed_collisions: AllowedPairs | None = None

    @model_validator(mode="after")
    def _check_form(self) -> Self:
        if (self.obstacles is None) == (self.moveit is None):
            raise ValueError("give obstacles or moveit, not both")
        return self

    @classmethod
    def from_moveit(cls, path: Path | str, *, name: str | None = None) -> Self:
        """The scene of a MoveIt planning-scene file (YAML).

        Raises:
            OSError: The file can't be read.
        """
        return cls(name=name, moveit=Path(path).read_text(encoding="utf-8"))


#: A stored scene by its name, or a scene.
SceneReference: TypeAlias = str | Scene


class SceneSummary(Answer):
    """Summary of a stored scene, without its obstacles.

    Args:
        name: Of the scene.
        hash: SHA-256 of the stored document.
        version: Counts the replacements, from 1.
        created: ISO 8601.
        updated: ISO 8601.
    """

    name: str
    hash: str | None = None
    version: int | None = None
    created: str | None = None
    updated: str | None = None


class SceneList(Answer):
    """A page of the stored scenes; `next` is the `after` of the next page, if there is one."""

    scenes: list[SceneSummary]
    next: str | None = None


#: What projects points onto obstacles.
Engine = Literal["exact", "fcl"]


class ProjectRequest(Request):
    """Points to be projected onto every obstacle of a scene.

    Args:
        points: [m].
        engine: What finds the nearest points: closed forms ("exact") or FCL's distance query.
    """

    points: Points
    engine: Engine = "exact"


class Projection(Answer):
    """The orthogonal projection of a point onto one obstacle.

    Args:
        obstacle: Its id.
        projection: The nearest point of its surface [m].
        distance: Negative inside [m].
    """

    obstacle: str
    projection: list[float]
    distance: float


class ProjectAnswer(Answer):
    """For each point its projection onto every obstacle, in the frame of the scene."""

    projections: list[list[Projection]]
    frame: str | None = None
