"""The shapes obstacles are made of: frozen, validated values that answer their convex pieces."""

import math
from abc import ABC, abstractmethod
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kinematics.arrays import Array, Remade, frozen
from kinematics.errors import InvalidScene
from kinematics.pose import align_z, transform
from obstacles.convex.piece import Piece, PieceKind, Surface, convex_hull
from obstacles.meshes.decomposition import COARSE, ConvexPart, Fineness, convex_pieces
from obstacles.meshes.mesh import checked_mesh
from obstacles.shapes.primitives import Primitive

#: Nothing an arm can meet is thinner than a micrometre or longer than ten kilometres; beyond that
#: the distance iterations would lose their digits.
MIN_SIZE = 1e-6
MAX_SIZE = 1e4
#: More points than this are a job for a coarser cloud.
MAX_POINTS = 200_000
MAX_VERTICES = 100_000
_UNIT_TOLERANCE = 1e-12
_FEW = 16
#: Looked up once: in an enumeration that takes longer than the rest of a box.
_POLYTOPE, _CYLINDER = PieceKind.POLYTOPE, PieceKind.CYLINDER
_HERE = frozen(np.eye(4))
_CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])


class Shape(Remade, ABC):
    """A solid in its own frame."""

    __slots__ = ()
    #: Which ``Primitive`` it is, None where it is none of them.
    primitive: ClassVar[int | None] = None

    def measures(self) -> tuple[float, float, float]:
        """Measures of a primitive, as ``Primitive`` lists them, 0 where it has fewer [m]."""
        raise NotImplementedError

    @abstractmethod
    def pieces(self) -> tuple[Piece, ...]:
        """The convex pieces whose union is the solid, in the shape's frame."""


@dataclass(frozen=True, slots=True, eq=False)
class Box(Shape):
    """A box, centred.

    Args:
        size: Full edge lengths along x, y, z, shape (3,) [m].

    Raises:
        InvalidScene: A size is not finite, not positive or out of range.
    """

    primitive: ClassVar[int] = int(Primitive.BOX)
    size: Array

    if TYPE_CHECKING:  # the constructor takes whatever makes an array

        def __init__(self, size: ArrayLike) -> None: ...

    def __post_init__(self) -> None:
        size = _finite(self.size, (3,), "box size")
        sizes = size.tolist()
        if not (min(sizes) >= MIN_SIZE and max(sizes) <= MAX_SIZE):
            for axis, value in zip("xyz", sizes, strict=True):
                _length(value, f"box size along {axis}")
        object.__setattr__(self, "size", size)

    def measures(self) -> tuple[float, float, float]:
        """Its edges [m]."""
        return tuple(self.size.tolist())

    def pieces(self) -> tuple[Piece, ...]:
        """One polytope of eight corners."""
        corners = 0.5 * self.size * _CORNERS
        corners.setflags(write=False)
        return (Piece(_POLYTOPE, _HERE, corners),)


@dataclass(frozen=True, slots=True, eq=False)
class Sphere(Shape):
    """A ball, centred.

    Args:
        radius: [m].

    Raises:
        InvalidScene: The radius is not finite, not positive or out of range.
    """

    primitive: ClassVar[int] = int(Primitive.BALL)
    radius: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "radius", _length(self.radius, "sphere radius"))

    def measures(self) -> tuple[float, float, float]:
        """Its radius [m]."""
        return (self.radius, 0.0, 0.0)

    def pieces(self) -> tuple[Piece, ...]:
        """One rounded point."""
        return (_rounded([[0.0, 0.0, 0.0]], self.radius),)


@dataclass(frozen=True, slots=True, eq=False)
class _Round(Shape):
    """A solid of revolution about z, centred.

    Args:
        radius: [m].
        height: [m].

    Raises:
        InvalidScene: A size is not finite, not positive or out of range.
    """

    radius: float
    height: float

    def __post_init__(self) -> None:
        for name in ("radius", "height"):
            size = _length(getattr(self, name), f"{type(self).__name__.lower()} {name}")
            object.__setattr__(self, name, size)

    def measures(self) -> tuple[float, float, float]:
        """Radius and height [m]."""
        return (self.radius, self.height, 0.0)


@dataclass(frozen=True, slots=True, eq=False)
class Cylinder(_Round):
    """A cylinder, centred, along z.

    Args:
        radius: [m].
        height: Full height [m].

    Raises:
        InvalidScene: A size is not finite, not positive or out of range.
    """

    primitive: ClassVar[int] = int(Primitive.CYLINDER)

    def pieces(self) -> tuple[Piece, ...]:
        """One cylinder."""
        return (Piece(_CYLINDER, _HERE, _NONE, self.radius, 0.5 * self.height),)


@dataclass(frozen=True, slots=True, eq=False)
class Capsule(_Round):
    """A cylinder with half-balls on its ends, centred, along z.

    Args:
        radius: [m].
        height: Height of the cylinder alone; the capsule is height + 2 radius long [m].

    Raises:
        InvalidScene: A size is not finite, not positive or out of range.
    """

    def pieces(self) -> tuple[Piece, ...]:
        """One rounded segment."""
        half = 0.5 * self.height
        return (_rounded([[0.0, 0.0, -half], [0.0, 0.0, half]], self.radius),)


@dataclass(frozen=True, slots=True, eq=False)
class Cone(_Round):
    """A cone, centred, along z: the apex at z = +height/2, the base at z = -height/2.

    Args:
        radius: Radius of the base [m].
        height: Full height [m].

    Raises:
        InvalidScene: A size is not finite, not positive or out of range.
    """

    primitive: ClassVar[int] = int(Primitive.CONE)

    def pieces(self) -> tuple[Piece, ...]:
        """One cone."""
        return (Piece(PieceKind.CONE, np.eye(4), _NONE, self.radius, 0.5 * self.height),)


@dataclass(frozen=True, slots=True, eq=False)
class HalfSpace(Shape):
    """All points x with n.x <= o, for instance a floor.

    Args:
        normal: n, out of the solid, of any length but 0; kept normalised, shape (3,).
        offset: o, divided by the length of the normal as given [m].

    Raises:
        InvalidScene: Not finite, or the normal has no direction.
    """

    primitive: ClassVar[int] = int(Primitive.HALFSPACE)
    normal: Array
    offset: float

    if TYPE_CHECKING:  # the constructor takes whatever makes an array

        def __init__(self, normal: ArrayLike, offset: float = 0.0) -> None: ...

    def __post_init__(self) -> None:
        normal = _finite(self.normal, (3,), "halfspace normal")
        offset = _finite(self.offset, (), "halfspace offset")
        # The largest entry first: the square of a tiny or huge normal would leave the number range.
        largest = float(np.abs(normal).max())
        if largest == 0.0:
            raise InvalidScene("halfspace normal is [0, 0, 0], which has no direction")
        norm = largest * float(np.linalg.norm(normal / largest))
        if abs(norm - 1.0) > _UNIT_TOLERANCE:
            normal, offset = frozen(normal / norm), frozen(offset / norm)
        if not abs(float(offset)) <= MAX_SIZE:
            raise InvalidScene(f"halfspace lies {float(offset):.6g} m away; at most {MAX_SIZE:g} m")
        object.__setattr__(self, "normal", normal)
        object.__setattr__(self, "offset", float(offset))

    def measures(self) -> tuple[float, float, float]:
        """None."""
        return (0.0, 0.0, 0.0)

    def pieces(self) -> tuple[Piece, ...]:
        """One half-space."""
        T = transform(align_z(self.normal), self.normal * self.offset)
        return (Piece(PieceKind.HALFSPACE, T, _NONE),)


@dataclass(frozen=True, slots=True, eq=False)
class Convex(Shape):
    """The convex hull of points; a flat or segment-like set is a solid without inside.

    Args:
        vertices: Shape (k, 3), k >= 1 [m].

    Raises:
        InvalidScene: Not finite, empty, too many or out of range.
    """

    vertices: Array

    if TYPE_CHECKING:  # the constructor takes whatever makes an array

        def __init__(self, vertices: ArrayLike) -> None: ...

    def __post_init__(self) -> None:
        vertices = _points(self.vertices, "convex vertices", MAX_VERTICES)
        object.__setattr__(self, "vertices", vertices)

    def pieces(self) -> tuple[Piece, ...]:
        """One polytope: the hull."""
        return (Piece(PieceKind.POLYTOPE, np.eye(4), convex_hull(self.vertices).vertices),)


@dataclass(frozen=True, slots=True, eq=False)
class Mesh(Shape):
    """A triangle mesh with what it encloses; an open one is its surface alone.

    Args:
        vertices: Shape (k, 3) [m].
        faces: Triangles as indices into ``vertices``, shape (f, 3).

    Raises:
        InvalidScene: Not finite, empty, indices out of range, too many or out of range.
    """

    vertices: Array
    faces: NDArray[np.int64]

    if TYPE_CHECKING:  # the constructor takes whatever makes an array

        def __init__(self, vertices: ArrayLike, faces: ArrayLike) -> None: ...

    def __post_init__(self) -> None:
        vertices, faces = checked_mesh(self.vertices, self.faces)
        _points(vertices, "mesh vertices", len(vertices))
        object.__setattr__(self, "vertices", vertices)
        object.__setattr__(self, "faces", faces)

    def pieces(self) -> tuple[Piece, ...]:
        """The hulls that cover it, each with the triangles inside it that decide."""
        return self.cut(COARSE)

    def cut(self, fineness: Fineness) -> tuple[Piece, ...]:
        """As ``pieces``, cut as finely as is asked for.

        Args:
            fineness: Fineness at which cutting stops.
        """
        parts = convex_pieces(self.vertices, self.faces, fineness)
        filled = sum(part.filled for part in parts)
        given = frozen(self.vertices[self.faces]) if any(len(p.triangles) for p in parts) else _NONE
        return tuple(_covering(part, given, place, filled) for place, part in enumerate(parts))


@dataclass(frozen=True, slots=True, eq=False)
class PointCloud(Shape):
    """A ball about each of many points.

    Args:
        points: Shape (k, 3), k >= 1 [m].
        radius: Radius of every ball [m].

    Raises:
        InvalidScene: Not finite, empty, too many, or the radius is not positive.
    """

    points: Array
    radius: float

    if TYPE_CHECKING:  # the constructor takes whatever makes an array

        def __init__(self, points: ArrayLike, radius: float) -> None: ...

    def __post_init__(self) -> None:
        object.__setattr__(self, "points", _points(self.points, "point cloud", MAX_POINTS))
        object.__setattr__(self, "radius", _length(self.radius, "point cloud radius"))

    def pieces(self) -> tuple[Piece, ...]:
        """One rounded point each."""
        return tuple(self.piece(k) for k in range(len(self.points)))

    def piece(self, k: int) -> Piece:
        """The ball about point ``k``."""
        return _rounded(self.points[k], self.radius)


@dataclass(frozen=True, slots=True, eq=False)
class Compound(Shape):
    """Several solids that are one object.

    Args:
        solids: Solids of any shape but this and point clouds.
        poses: Poses of each in the object's frame, rigid motions of shape (4, 4).

    Raises:
        InvalidScene: There is none, one has no pose, or is a point cloud or compound itself.
    """

    solids: tuple[Shape, ...]
    poses: tuple[Array, ...]

    def __post_init__(self) -> None:
        if not self.solids or len(self.solids) != len(self.poses):
            raise InvalidScene(f"compound: {len(self.solids)} solids, {len(self.poses)} poses")
        for solid in self.solids:
            if isinstance(solid, Compound | PointCloud):
                raise InvalidScene(f"compound: a {type(solid).__name__} can't be a part of one")
        object.__setattr__(self, "solids", tuple(self.solids))
        object.__setattr__(self, "poses", tuple(frozen(T) for T in self.poses))

    def pieces(self) -> tuple[Piece, ...]:
        """The pieces of all solids; those that enclose the inside of a mesh come first."""
        parts = zip(self.solids, self.poses, strict=True)
        pieces = [piece.placed(T) for solid, T in parts for piece in solid.pieces()]
        return tuple(sorted(pieces, key=lambda piece: not (piece.surface and piece.surface.count)))


_NONE = frozen(np.zeros((0, 3)))


def _rounded(vertices: ArrayLike, rounding: float) -> Piece:
    return Piece(PieceKind.POLYTOPE, np.eye(4), np.asarray(vertices), offset_radius=rounding)


def _covering(part: ConvexPart, given: Array, place: int, filled: int) -> Piece:
    surface = None
    if len(part.triangles):
        group = (place, filled) if part.filled else (0, 0)
        surface = Surface(part.triangles, part.anchors, given, *group)
    return replace(_rounded(part.vertices, part.offset_radius), surface=surface)


def _length(value: float, name: str) -> float:
    number = value if type(value) is float else float(_finite(value, (), name))
    if not math.isfinite(number):
        raise InvalidScene(f"{name}: not finite")
    if not MIN_SIZE <= number <= MAX_SIZE:
        raise InvalidScene(
            f"{name} is {number:.6g} m",
            hint=f"It must be positive, from {MIN_SIZE:g} m to {MAX_SIZE:g} m.",
            value=number,
        )
    return number


def _points(values: ArrayLike, name: str, most: int) -> Array:
    points = _finite(values, None, name)
    if points.ndim != 2 or points.shape[1] != 3 or not len(points):
        raise InvalidScene(f"{name}: shape {points.shape}, needed are one or more rows [x, y, z]")
    if len(points) > most:
        raise InvalidScene(f"{name}: {len(points)} points, at most {most} are taken")
    if np.abs(points).max() > MAX_SIZE:
        raise InvalidScene(f"{name}: a coordinate lies beyond {MAX_SIZE:g} m")
    return points


def _finite(values: ArrayLike | Iterable[Any], shape: tuple[int, ...] | None, name: str) -> Array:
    try:
        array = frozen(values)  # type: ignore[arg-type]
    except (TypeError, ValueError, OverflowError):
        raise InvalidScene(f"{name}: not an array of numbers") from None
    if shape is not None and array.shape != shape:
        raise InvalidScene(f"{name}: shape {array.shape}, needed is {shape}")
    # Of a few numbers Python is quicker than numpy is at a call.
    few = array.size <= _FEW
    if not (all(map(math.isfinite, array.ravel().tolist())) if few else np.isfinite(array).all()):
        raise InvalidScene(f"{name}: not finite")
    return array
