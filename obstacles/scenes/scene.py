"""The scene: named obstacles in the robot's root frame, as one immutable value."""

import hashlib
import struct
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cache
from itertools import groupby
from types import MappingProxyType
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kinematics.arrays import Array, Remade, frozen
from kinematics.errors import InvalidObjectName, InvalidPose, InvalidScene
from kinematics.pose import from_matrix, is_exact_rotation, transform
from obstacles.convex.piece import Piece, PieceArrays
from obstacles.shapes.primitives import Primitive, Primitives, primitive_pieces
from obstacles.shapes.shape import MAX_SIZE, Compound, Mesh, PointCloud, Shape

_FLOAT = struct.Struct("=d")
MAX_OBSTACLES = 10_000
MAX_NAME = 256
#: All pieces of a scene, whose each is, and its margin.
Packed: TypeAlias = tuple[PieceArrays, NDArray[np.int64], Array]
Pair: TypeAlias = tuple[str, str]
_HALFSPACE = int(Primitive.HALFSPACE)
_LAST_ROW = [0.0, 0.0, 0.0, 1.0]


def _shape_content(shape: Shape) -> list[bytes]:
    parts = [f"{type(shape).__name__}\0".encode()]
    if isinstance(shape, Compound):
        for solid, T in zip(shape.solids, shape.poses, strict=True):
            parts += [*_shape_content(solid), T.tobytes()]
        return parts
    for name in _field_names(type(shape)):
        values = getattr(shape, name)
        if type(values) is float:  # as an array of no dimensions has it
            parts.append(f"{name}()".encode() + _FLOAT.pack(values))
        else:
            values = np.asarray(values)
            parts.append(f"{name}{values.shape}".encode() + values.tobytes())
    return parts


@cache
def _field_names(shape: type[Shape]) -> tuple[str, ...]:
    return tuple(item.name for item in fields(shape))  # type: ignore[arg-type]


class AllowedContact(NamedTuple):
    """A contact that is allowed: who allows it, and how deep it may be.

    Args:
        reason: Reason: who allows the contact ("scene", "request", "touch_links" or "support").
        touch_depth: How deep the two may overlap [m]; infinite for any depth.
    """

    reason: str = "scene"
    touch_depth: float = float("inf")


#: Obstacles that the text of a scene names.
_NAMED = 6


@dataclass(frozen=True, slots=True, eq=False)
class Obstacle:
    """A shape with a name and a place.

    Args:
        id: Name of the obstacle, unique in its scene.
        shape: Shape of the obstacle.
        T_world_obstacle: Pose in ``frame``, shape (4, 4).
        margin: Distance to be kept from it beyond that asked for everywhere [m].
        frame: A link of the robot that stands still, or "tool"; None for the robot's root frame.
            ``obstacles.scenes.placement.place`` puts a scene into the root frame, where all checks
            are.

    Raises:
        InvalidScene: The name is empty or too long, the pose no rigid motion, the margin negative.
    """

    id: str
    shape: Shape
    T_world_obstacle: Array = field(default_factory=lambda: np.eye(4))
    margin: float = 0.0
    frame: str | None = None
    _pieces: tuple[Piece, ...] | None = field(default=None, init=False, repr=False)
    _content: bytes | None = field(default=None, init=False, repr=False)
    _in_root: "Obstacle | None" = field(default=None, init=False, repr=False)

    if TYPE_CHECKING:  # the constructor takes whatever makes an array

        def __init__(
            self,
            id: str,  # noqa: A002
            shape: Shape,
            T_world_obstacle: ArrayLike = ...,
            margin: float = 0.0,
            frame: str | None = None,
        ) -> None: ...

    def __post_init__(self) -> None:
        checked_name(self.id, "obstacle id")
        if self.frame is not None:
            checked_name(self.frame, f"frame of obstacle {self.id!r}")
        if not isinstance(self.shape, Shape):
            raise InvalidScene(f"obstacle {self.id!r}: {type(self.shape).__name__} is not a shape")
        object.__setattr__(self, "T_world_obstacle", _rigid(self.T_world_obstacle, self.id))
        known = isinstance(self.margin, int | float | np.number)
        margin = float(self.margin) if known else np.nan
        if not 0.0 <= margin <= MAX_SIZE:
            raise InvalidScene(
                f"obstacle {self.id!r}: margin is {margin:g} m",
                hint=f"It must be from 0 to {MAX_SIZE:g} m.",
            )
        object.__setattr__(self, "margin", margin)

    def __reduce__(self) -> tuple[object, ...]:
        # Not by the constructor: orthonormalising a rotation once more changes its last bits.
        values = (self.id, self.shape, self.T_world_obstacle, self.margin, self.frame)
        return _restored, values

    def pieces(self) -> tuple[Piece, ...]:
        """Its convex pieces in the robot's root frame, without the margin."""
        if self._pieces is None:
            T = self.T_world_obstacle
            pieces = tuple(p.placed(T) for p in self.shape.pieces())
            object.__setattr__(self, "_pieces", pieces)
        return self._pieces or ()

    def content(self) -> bytes:
        """All that tells it from other obstacles, as hashes of scenes have it."""
        if self._content is not None:
            return self._content
        parts = [f"{self.id}\0".encode(), *_shape_content(self.shape)]
        parts += [self.T_world_obstacle.tobytes(), _FLOAT.pack(self.margin)]
        if self.frame is not None:
            parts.append(f"frame\0{self.frame}\0".encode())
        content = b"".join(parts)
        if self.is_primitive:  # of meshes it is as large as they are
            object.__setattr__(self, "_content", content)
        return content

    def in_root(self) -> "Obstacle":
        """The obstacle with the same pose, meant in the robot's root frame."""
        if self._in_root is None:
            object.__setattr__(self, "_in_root", meant_in(self, None))
        assert self._in_root is not None
        return self._in_root

    def solids(self) -> "tuple[Obstacle, ...]":
        """Its solids, each as an obstacle: ``id/0``, ``id/1``, ... where there are several."""
        if not isinstance(self.shape, Compound):
            return (self,)
        parts = list(zip(self.shape.solids, self.shape.poses, strict=True))
        names = [f"{self.id}/{k}" for k in range(len(parts))] if len(parts) > 1 else [self.id]
        return tuple(
            Obstacle(name, solid, self.T_world_obstacle @ T, self.margin, self.frame)
            for name, (solid, T) in zip(names, parts, strict=True)
        )

    @property
    def is_mesh(self) -> bool:
        """Whether any of it is made of triangles."""
        solids = self.shape.solids if isinstance(self.shape, Compound) else (self.shape,)
        return any(isinstance(solid, Mesh) for solid in solids)

    @property
    def is_cloud(self) -> bool:
        """Whether it is made of balls about points."""
        return isinstance(self.shape, PointCloud)

    @property
    def is_primitive(self) -> bool:
        """Whether it is one of the ``Primitive`` solids."""
        return self.shape.primitive is not None

    @property
    def count(self) -> int:
        """How many pieces it has."""
        shape = self.shape
        if shape.primitive is not None:
            return 1
        return len(shape.points) if isinstance(shape, PointCloud) else len(self.pieces())

    def balls(self) -> PieceArrays:
        """Balls of a point cloud, packed without a piece for each of them."""
        assert isinstance(self.shape, PointCloud)
        return PieceArrays.balls(self.shape.points, self.shape.radius, self.T_world_obstacle)

    def piece(self, k: int) -> Piece:
        """Piece ``k`` of them."""
        if isinstance(self.shape, PointCloud):
            return self.shape.piece(k).placed(self.T_world_obstacle)
        return self.pieces()[k]


@dataclass(frozen=True, slots=True, eq=False)
class Scene(Remade):
    """All obstacles, and the pairs of names that may touch.

    Args:
        obstacles: Obstacles in any order, each id once.
        allowed_collisions: Pairs of obstacle ids and robot links; kept with their names sorted.
        fixed_frames: Frames that a file gives by their pose in its planning frame, each with the
            name of that frame and the pose, shape (4, 4). What the robot has by that name is meant
            in its place.
        free: Names that may touch everything, each with the names that it may not touch all the
            same. ``obstacles.scenes.placement.place`` makes pairs of them, for a robot.
        notes: Remarks on what is odd about the file it was read of, one sentence each.
        contacts: Contacts of these pairs, where they are not the scene's or have a depth.

    Raises:
        InvalidScene: An id occurs twice, there are too many obstacles, or a ``touch_depth`` is
            negative or no number.
    """

    obstacles: tuple[Obstacle, ...] = ()
    allowed_collisions: frozenset[Pair] = frozenset()
    fixed_frames: Mapping[str, tuple[str, Array]] = field(default_factory=dict, repr=False)
    free: Mapping[str, frozenset[str]] = field(default_factory=dict, repr=False)
    notes: tuple[str, ...] = ()
    contacts: Mapping[Pair, AllowedContact] = field(default_factory=dict)
    content_hash: str = field(init=False, repr=False)
    #: Hash of the content of the obstacles alone.
    obstacles_hash: str = field(init=False, repr=False)
    #: Whether any of an obstacle is made of triangles.
    has_meshes: bool = field(init=False, repr=False)
    #: Names of the obstacles, in their order.
    ids: tuple[str, ...] = field(init=False, repr=False)
    #: Frames of obstacles that are not in the root frame yet.
    frames: frozenset[str] = field(init=False, repr=False)
    _packed: Packed | None = field(default=None, init=False, repr=False)
    _primitives: Primitives | None = field(default=None, init=False, repr=False)

    if TYPE_CHECKING:  # the constructor takes any iterables

        def __init__(
            self,
            obstacles: Iterable[Obstacle] = (),
            allowed_collisions: Iterable[Iterable[str]] = frozenset(),
            fixed_frames: Mapping[str, tuple[str, Array]] = ...,
            free: Mapping[str, frozenset[str]] = ...,
            notes: tuple[str, ...] = (),
            contacts: Mapping[Pair, AllowedContact] = ...,
        ) -> None: ...

    def __repr__(self) -> str:
        named = [repr(name) for name in self.ids[:_NAMED]]
        more = [f"{len(self.ids) - _NAMED} more"] if len(self.ids) > _NAMED else []
        return f"Scene({', '.join([*named, *more])})"

    def __post_init__(self) -> None:
        obstacles = tuple(self.obstacles)
        if len(obstacles) > MAX_OBSTACLES:
            raise InvalidScene(f"{len(obstacles)} obstacles, at most {MAX_OBSTACLES} are taken")
        ids = tuple([obstacle.id for obstacle in obstacles])
        if len(set(ids)) < len(ids):
            twice = [name for name, count in Counter(ids).items() if count > 1]
            raise InvalidScene(
                f"obstacle id(s) {', '.join(map(repr, twice))} occur more than once",
                hint="Give every obstacle a name of its own.",
                ids=twice,
            )
        object.__setattr__(self, "obstacles", obstacles)
        named = frozenset(o.frame for o in obstacles if o.frame is not None)
        object.__setattr__(self, "frames", named)
        object.__setattr__(self, "ids", ids)
        contacts = MappingProxyType({(min(p), max(p)): c for p, c in self.contacts.items()})
        for pair, contact in contacts.items():
            if not contact.touch_depth >= 0.0:
                raise InvalidScene(
                    f"touch_depth of {list(pair)} is {contact.touch_depth} m",
                    hint="Give 0 or more [m]; infinite for any depth.",
                )
        object.__setattr__(self, "contacts", contacts)
        pairs = _pairs(self.allowed_collisions).union(contacts)
        object.__setattr__(self, "allowed_collisions", pairs)
        meshes = [obstacle.is_mesh for obstacle in obstacles]
        object.__setattr__(self, "has_meshes", any(meshes))
        digest = hashlib.sha256()
        for obstacle in obstacles:
            digest.update(obstacle.content())
        object.__setattr__(self, "obstacles_hash", digest.hexdigest())
        object.__setattr__(self, "content_hash", _content_hash(self))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Scene) and other.content_hash == self.content_hash

    def __hash__(self) -> int:
        return hash(self.content_hash)

    def check_placed(self) -> None:
        """Refuse obstacles that are not in the root frame.

        Raises:
            InvalidScene: There are some; ``obstacles.scenes.placement.place`` puts them there.
        """
        if self.frames:
            raise InvalidScene(
                f"obstacles are in the frame(s) {', '.join(sorted(self.frames))}, not in the root "
                "frame",
                hint="Put the scene there first: place(scene, chain, joints).",
            )

    def with_margin(self, name: str, margin: float) -> "Scene":
        """The scene with another margin of one obstacle [m].

        Raises:
            InvalidObjectName: There is no such obstacle.
        """
        changed = replace(self.obstacle(name), margin=margin)
        kept = tuple(changed if item.id == name else item for item in self.obstacles)
        return replace(self, obstacles=kept)

    def obstacle(self, name: str) -> Obstacle:
        """The obstacle called ``name``.

        Raises:
            InvalidObjectName: There is none; the message lists those there are.
        """
        for obstacle in self.obstacles:
            if obstacle.id == name:
                return obstacle
        raise InvalidObjectName(
            f"the scene has no obstacle {name!r}",
            hint=f"Its obstacles are: {', '.join(self.ids) or 'none'}.",
            obstacle=name,
            obstacles=list(self.ids),
        )

    def allows(self, a: str, b: str) -> bool:
        """Whether ``a`` and ``b`` (obstacle ids or robot links) may touch."""
        if not self.allowed_collisions:
            return False
        return (min(a, b), max(a, b)) in self.allowed_collisions

    def hash_allowing(self, pairs: Iterable[Pair]) -> str:
        """Hash of the content of the obstacles and of pairs that may touch, whoever lets them."""
        told = "".join(f"{a}\0{b}\0" for a, b in sorted(pairs))
        if not told:
            return self.obstacles_hash
        return hashlib.sha256(f"{self.obstacles_hash}\0{told}".encode()).hexdigest()

    def pieces(self) -> Packed:
        """Every convex piece in the robot's root frame.

        Returns:
            The pieces (p); the index of the obstacle each belongs to, shape (p,); the obstacle's
            margin for each, shape (p,) [m].
        """
        if self._packed is None:
            object.__setattr__(self, "_packed", self._pack())
        assert self._packed is not None
        return self._packed

    @property
    def primitives(self) -> Primitives:
        """Obstacles that are primitives, in their order."""
        if self._primitives is None:
            object.__setattr__(self, "_primitives", _primitives_of(self.obstacles))
        assert self._primitives is not None
        return self._primitives

    def _pack(self) -> Packed:
        # Primitives together, and other solids: a call for each of many small ones costs the most.
        blocks, primitive = list[PieceArrays](), 0
        for (is_primitive, is_cloud), run in groupby(
            self.obstacles, lambda o: (o.is_primitive, o.is_cloud)
        ):
            if is_primitive:
                first, primitive = primitive, primitive + sum(1 for _ in run)
                blocks.append(primitive_pieces(self.primitives.part(first, primitive)))
            elif is_cloud:
                blocks += [obstacle.balls() for obstacle in run]
            else:
                blocks.append(PieceArrays.pack([p for o in run for p in o.pieces()]))
        index = np.arange(len(self.obstacles), dtype=np.int64)
        margins = np.array([o.margin for o in self.obstacles], dtype=np.float64)
        if primitive < len(index):
            index = index.repeat([obstacle.count for obstacle in self.obstacles])
            margins = margins[index]
        for array in (index, margins):
            array.setflags(write=False)
        return PieceArrays.joined(blocks or [PieceArrays.pack(())]), index, margins

    def piece(self, k: int) -> Piece:
        """Piece ``k`` of those that ``pieces`` packs, in the robot's root frame."""
        owners = self.pieces()[1]
        owner = int(owners[k])
        return self.obstacles[owner].piece(k - int(np.searchsorted(owners, owner)))


def _primitives_of(obstacles: Iterable[Obstacle]) -> Primitives:
    """Primitives among some obstacles, in their order."""
    chosen = [obstacle for obstacle in obstacles if obstacle.shape.primitive is not None]
    listed = [obstacle.shape.primitive for obstacle in chosen]
    kinds = np.array(listed, dtype=np.int64)
    measures = np.array([x for obstacle in chosen for x in obstacle.shape.measures()])
    # No zero of theirs is negative: those of placed pieces are not either.
    joined = b"".join([obstacle.T_world_obstacle.tobytes() for obstacle in chosen])  # at once
    poses = np.frombuffer(joined).reshape(-1, 4, 4) + 0.0
    if _HALFSPACE in listed:
        for k in np.flatnonzero(kinds == _HALFSPACE).tolist():
            poses[k] = chosen[k].pieces()[0].T_owner_piece
    measures = measures.reshape(-1, 3)
    for array in (kinds, measures, poses):
        array.setflags(write=False)
    return Primitives(kinds, measures, poses)


def checked_name(name: str, what: str) -> str:
    """Check a name of an obstacle or link and answer it.

    Raises:
        InvalidScene: Not a text, empty or longer than 256 characters.
    """
    if not isinstance(name, str) or not 0 < len(name) <= MAX_NAME:
        raise InvalidScene(f"{what}: must be a text of 1 to {MAX_NAME} characters")
    return name


def _pairs(pairs: Iterable[Iterable[str]]) -> frozenset[Pair]:
    sorted_pairs = set()
    for pair in pairs:
        names = tuple(pair)
        if len(names) != 2 or isinstance(pair, str):
            raise InvalidScene("allowed_collisions: every entry must be two names")
        a, b = sorted(checked_name(name, "allowed_collisions") for name in names)
        sorted_pairs.add((a, b))
    return frozenset(sorted_pairs)


def _restored(
    name: str, shape: Shape, T_world_obstacle: Array, margin: float, frame: str | None
) -> Obstacle:
    """An obstacle from its pickled values, equal to the pickled one in every bit."""
    obstacle = object.__new__(Obstacle)
    values: dict[str, object] = {"id": name, "shape": shape}
    values["T_world_obstacle"] = frozen(T_world_obstacle)
    values |= {"margin": margin, "frame": frame}
    values |= {"_pieces": None, "_content": None, "_in_root": None}
    for field_name, value in values.items():
        object.__setattr__(obstacle, field_name, value)
    return obstacle


def meant_in(obstacle: Obstacle, frame: str | None) -> Obstacle:
    """An obstacle with the same pose, meant in another frame; None for the root frame.

    Raises:
        InvalidScene: The name of the frame is empty or too long.
    """
    if frame is not None:
        checked_name(frame, f"frame of obstacle {obstacle.id!r}")
    o = obstacle  # its pose was found rigid before
    return _restored(o.id, o.shape, o.T_world_obstacle, o.margin, frame)


def _rigid(T: Array, name: str) -> Array:
    try:
        matrix = frozen(T)
        if _is_exact(matrix):
            return matrix
        if matrix.shape != (4, 4) or matrix[3].tolist() != _LAST_ROW:
            raise InvalidPose("it is no 4x4 matrix whose last row is [0, 0, 0, 1]")
        rotation = from_matrix(matrix[:3, :3])
    except InvalidPose as error:
        message = f"obstacle {name!r}: its pose is not a rigid motion: {error.message}"
        raise InvalidScene(message, hint=error.hint) from None
    except (TypeError, ValueError) as error:
        raise InvalidScene(f"obstacle {name!r}: its pose is not a rigid motion: {error}") from None
    if not all(abs(x) <= MAX_SIZE for x in matrix[:3, 3].tolist()):
        raise InvalidScene(f"obstacle {name!r}: its position must lie within {MAX_SIZE:g} m")
    return frozen(transform(rotation, matrix[:3, 3]))


def _is_exact(matrix: Array) -> bool:
    """Whether a read-only matrix is a rigid motion that needs no rounding, within `MAX_SIZE`."""
    if matrix.shape != (4, 4) or matrix[3].tolist() != _LAST_ROW:
        return False
    x, y, z = matrix[:3, 3].tolist()
    near = abs(x) <= MAX_SIZE and abs(y) <= MAX_SIZE and abs(z) <= MAX_SIZE
    return near and is_exact_rotation(matrix[:3, :3])


def _content_hash(scene: Scene) -> str:
    told = [scene.hash_allowing(scene.allowed_collisions).encode()]
    told += [f"{pair}\0{contact}\0".encode() for pair, contact in sorted(scene.contacts.items())]
    for name in sorted(scene.frames & scene.fixed_frames.keys()):
        parent, T = scene.fixed_frames[name]
        told.append(f"frame\0{name}\0{parent}\0".encode() + T.tobytes())
    for name, others in sorted(scene.free.items()):
        told.append(f"free\0{name}\0{sorted(others)}\0".encode())
    return hashlib.sha256(b"".join(told)).hexdigest() if len(told) > 1 else told[0].decode()
