"""Scenes: obstacles by name, and projections of points onto them."""

from pathlib import Path
from typing import Literal, Self, TypeAlias

from pydantic import model_validator

from armwright_client.base import Answer, NonNegative, Pairs, Points, Request
from armwright_client.pose import AnyPose
from armwright_client.shape import Shape


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
    allowed_collisions: Pairs | None = None

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
