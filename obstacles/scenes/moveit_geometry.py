"""MoveIt's geometry files (``.scene``): the text that its planning scene exports and imports.

A name, then each object behind a ``*``, then a full stop. In files of newer versions objects have a
pose and subframes; in older ones the poses of shapes are in the planning frame. Which of the two a
file is, MoveIt tells by the line behind the first name of an object, and so does this. Fields are
in the order of ``PlanningScene::saveGeometryToStream`` and ``shapes::saveAsText``.
"""

import math
import re
from collections.abc import Callable, Mapping

import numpy as np

from kinematics.arrays import Array
from kinematics.errors import ArmwrightError, InvalidScene
from kinematics.pose import from_quaternion, transform
from obstacles.scenes.scene import Obstacle, Scene, checked_name
from obstacles.shapes.shape import Box, Compound, Cone, Cylinder, HalfSpace, Mesh, Shape, Sphere

#: A name, and behind it an object or the end.
_BEGIN = re.compile(r"[^\n]*\n\s*(\*[^\S\n]|\.\s*$)")
_WORD = re.compile(r"\S+")
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")
_COUNT = re.compile(r"\d{1,9}")
_FIELDS_OF_A_COLOUR = 4
#: How places begin in messages.
_FILE = "scene file"


class ErrorPlace:
    """Context in which errors are raised again as ``InvalidScene``, with the place in the file.

    Args:
        begin: How messages begin that tell their place already.
        where: The place, asked for when there is an error; ``begin`` where None.
    """

    __slots__ = ("_begin", "_where")

    def __init__(self, begin: str, where: Callable[[], str] | None = None) -> None:
        self._begin = begin
        self._where = where

    def __enter__(self) -> None:
        """Begin."""

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        """End."""
        if not isinstance(error, ArmwrightError):
            return
        message = error.message
        if not message.startswith(self._begin):
            message = f"{self._begin if self._where is None else self._where()}: {message}"
        raise InvalidScene(message, hint=error.hint) from None


def is_geometry_text(text: str) -> bool:
    """Whether a text is a geometry file; YAML of a planning scene never is."""
    return _BEGIN.match(text) is not None


def scene_from_geometry(text: str) -> Scene:
    """Read a geometry file of MoveIt.

    Each object becomes an obstacle; planes become the half-space behind them. Everything is in the
    planning frame: the obstacles name no frame. Colours and subframes have no meaning here, and are
    left out.

    Args:
        text: Text of the file.

    Raises:
        InvalidScene: It is no such file, or cut short; the message names the line.
    """
    reader = _Reader(text)
    reader.line()
    obstacles: list[Obstacle] = []
    posed: bool | None = None
    while (marker := reader.word("'*' or '.'")) == "*":
        name = checked_name(reader.line(), reader.place("the name of an object"))
        if posed is None:
            posed = len(reader.next_line().split()) > 1
        obstacles.append(_obstacle(reader, name, posed=posed))
    if marker != ".":
        raise InvalidScene(f"{reader.place()}: found is {marker[:40]!r} in place of '*' or '.'")
    if reader.rest().strip():
        raise InvalidScene(f"{reader.place()}: there is text behind the end ('.')")
    return Scene(tuple(obstacles))


def _obstacle(reader: "_Reader", name: str, *, posed: bool) -> Obstacle:
    T_object = _pose(reader) if posed else np.eye(4)
    count = reader.count("the number of shapes")
    if not count:
        raise InvalidScene(f"{reader.place()}: object {name!r} has no shape")
    solids = []
    for _ in range(count):
        solids.append((_shape(reader, name), _pose(reader)))
        reader.numbers(_FIELDS_OF_A_COLOUR, "the colour")
    if posed:
        for _ in range(reader.count("the number of subframes")):
            reader.word("the name of a subframe")
            _pose(reader)
    (shape, T), *more = solids
    if more or (posed and not np.array_equal(T, np.eye(4))):
        shape, T = Compound(*zip(*solids, strict=True)), np.eye(4)
    # No zero is negative: the content hash tells them apart.
    return Obstacle(name, shape, T_object @ T + 0.0)


def _pose(reader: "_Reader") -> Array:
    """A pose: a line of three numbers, and one of a quaternion (x, y, z, w)."""
    position = reader.numbers(3, "a position")
    quaternion = reader.numbers(4, "a quaternion")
    if not any(quaternion):
        return transform(position=position)  # as MoveIt's matrix of it
    with ErrorPlace(_FILE, reader.place):
        return transform(from_quaternion(quaternion), position)


def _shape(reader: "_Reader", name: str) -> Shape:
    kind = reader.word("a shape")
    if kind not in _SHAPES:
        raise InvalidScene(
            f"{reader.place()}: object {name!r} has a shape {kind[:40]!r}",
            hint=f"Read are: {', '.join(_SHAPES)}.",
        )
    with ErrorPlace(_FILE, reader.place):
        return _SHAPES[kind](reader)


def _plane(reader: "_Reader") -> Shape:
    *normal, d = reader.numbers(4, "the coefficients of a plane")
    return HalfSpace(np.array(normal), -d)


def _mesh(reader: "_Reader") -> Shape:
    vertices = reader.count("the number of vertices")
    triangles = reader.count("the number of triangles")
    if not vertices or not triangles:
        raise InvalidScene(f"{reader.place()}: the mesh is empty")
    points = [reader.numbers(3, "a vertex") for _ in range(vertices)]
    corners = [[reader.count("a vertex's number") for _ in range(3)] for _ in range(triangles)]
    return Mesh(np.array(points), np.array(corners))


_SHAPES: Mapping[str, Callable[["_Reader"], Shape]] = {
    "box": lambda reader: Box(reader.numbers(3, "the size of a box")),
    "sphere": lambda reader: Sphere(*reader.numbers(1, "the radius of a sphere")),
    "cylinder": lambda reader: Cylinder(*reader.numbers(2, "radius and length of a cylinder")),
    "cone": lambda reader: Cone(*reader.numbers(2, "radius and length of a cone")),
    "plane": _plane,
    "mesh": _mesh,
}


class _Reader:
    """Words and lines of a text, from its beginning on.

    Args:
        text: The text.
    """

    __slots__ = ("_at", "_text")

    def __init__(self, text: str) -> None:
        self._text = text
        self._at = 0

    def place(self, what: str = "") -> str:
        """Place of the reader, for messages."""
        line = self._text.count("\n", 0, self._at) + 1
        return f"{_FILE}, line {line}{': ' if what else ''}{what}"

    def line(self) -> str:
        """The rest of the line, which is passed."""
        line = self.next_line()
        self._at += len(line) + 1
        return line.strip()

    def next_line(self) -> str:
        """The rest of the line, which is read again."""
        end = self._text.find("\n", self._at)
        return self._text[self._at : end if end >= 0 else len(self._text)]

    def rest(self) -> str:
        """The rest of the text."""
        return self._text[self._at :]

    def word(self, what: str) -> str:
        """The next word.

        Raises:
            InvalidScene: There is none.
        """
        found = _WORD.search(self._text, self._at)
        if found is None:
            self._at = len(self._text.rstrip())
            raise InvalidScene(f"{self.place()}: the text ends where {what} is needed")
        self._at = found.end()
        return found[0]

    def numbers(self, count: int, what: str) -> list[float]:
        """The next numbers.

        Raises:
            InvalidScene: They are none, or not finite.
        """
        values = []
        for _ in range(count):
            word = self.word(what)
            value = float(word) if _NUMBER.fullmatch(word) else math.nan
            if not math.isfinite(value):
                raise InvalidScene(f"{self.place(what)}: {word[:40]!r} is no finite number")
            values.append(value)
        return values

    def count(self, what: str) -> int:
        """The next whole number, 0 or more.

        Raises:
            InvalidScene: It is none.
        """
        word = self.word(what)
        if not _COUNT.fullmatch(word):
            raise InvalidScene(f"{self.place(what)}: {word[:40]!r} is no whole number from 0 on")
        return int(word)
