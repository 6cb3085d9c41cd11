"""A robot's solid: convex pieces on its joints, and the pairs of them that must not touch."""

import hashlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, partial
from itertools import combinations
from types import MappingProxyType
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from kinematics.arrays import Array, Remade, frozen
from kinematics.caches.bounded_cache import bounded_cache
from kinematics.errors import InvalidRobotDescription, InvalidScene
from kinematics.model.branch import BodyTree
from kinematics.model.chain import Chain, Link
from kinematics.readers.mesh_uri import resolve_mesh
from kinematics.tree.description import (
    BoxGeometry,
    CapsuleGeometry,
    CollisionElement,
    CylinderGeometry,
    Geometry,
    MeshGeometry,
    RobotDescription,
    SphereGeometry,
)
from kinematics.tree.fingers import Fingers
from kinematics.tree.srdf import Semantics
from obstacles.convex.piece import Piece, PieceArrays, PieceKind, convex_hull
from obstacles.meshes.decomposition import COARSE, FINE, Fineness
from obstacles.meshes.mesh import is_bare_header, load_mesh, scaled
from obstacles.robots.touching_pairs import always_touching, overlapping_covers
from obstacles.scenes.scene import Obstacle
from obstacles.shapes.shape import Box, Capsule, Cylinder, Mesh, Shape, Sphere

_NO_SOLIDS = "the robot has no collision geometry: only its kinematics are known, it hits nothing"
#: No link that a joint moves is that long; one in millimetres is, from a centimetre on [m].
_LONG = 10.0
Meshes: TypeAlias = Mapping[str, bytes] | Callable[[str], bytes]
Pair: TypeAlias = tuple[str, str]
#: Convex pieces of a robot, and triangles under their covers: pairs are the square of the pieces.
_MOST_PIECES, _MOST_TRIANGLES = 4_000, 2_000_000


@dataclass(frozen=True, slots=True, eq=False)
class RobotGeometry(Remade):
    """The convex pieces of a robot and which of them are checked against each other.

    Args:
        chain: The robot they belong to.
        pieces: Pieces in the frame of the joint that carries them, p in all.
        links: Name of the link (or attached object) of each piece.
        joints: Index of the joint that carries each piece, -1 for the base, shape (p,).
        solids: Number of the solid of the description that each piece is a part of, shape (p,).
        allowed: Pairs of names that may touch, sorted, each with the reason: "same body",
            "adjacent", "always", "srdf", "attached" or "suspected: ...".
        lint: Remarks on what is odd, one sentence each.
        states: Named configurations, each of shape (n,) [rad or m].
        suspected: Pairs that touch where the robot surely may stand, each with the reason.
        fingers: Joints off the chain that a gripper moves, and where they stand.
        unseen: Links that are drawn and have no solids: nothing is compared with them.
        groups: Links of each group of the SRDF, by its name.
    """

    chain: Chain
    pieces: tuple[Piece, ...]
    links: tuple[str, ...]
    joints: NDArray[np.int64]
    solids: NDArray[np.int64]
    allowed: Mapping[Pair, str]
    lint: tuple[str, ...] = ()
    states: Mapping[str, Array] = field(default_factory=dict)
    suspected: Mapping[Pair, str] = field(default_factory=dict)
    fingers: Fingers = field(default_factory=Fingers)
    unseen: tuple[str, ...] = ()
    groups: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    #: Links and attached objects that have pieces, each once, in their order.
    names: tuple[str, ...] = field(init=False, repr=False)
    #: Whether links of the robot itself have solids, not only what it holds.
    has_solids: bool = field(init=False, repr=False)
    arrays: PieceArrays = field(init=False, repr=False)
    self_pairs: NDArray[np.int64] = field(init=False, repr=False)
    content_hash: str = field(init=False, repr=False)

    def __post_init__(self) -> None:
        for name in ("joints", "solids"):
            numbers = np.array(getattr(self, name), dtype=np.int64).reshape(len(self.pieces))
            numbers.setflags(write=False)
            object.__setattr__(self, name, numbers)
        object.__setattr__(self, "allowed", MappingProxyType(dict(sorted(self.allowed.items()))))
        states = {name: frozen(q) for name, q in self.states.items()}
        object.__setattr__(self, "states", MappingProxyType(states))
        object.__setattr__(self, "groups", MappingProxyType(dict(self.groups)))
        object.__setattr__(self, "names", tuple(dict.fromkeys(self.links)))
        solid = not self.chain.index.keys().isdisjoint(self.links)
        object.__setattr__(self, "has_solids", solid)
        object.__setattr__(self, "arrays", PieceArrays.pack(self.pieces))
        object.__setattr__(self, "self_pairs", _self_pairs(self))
        object.__setattr__(self, "content_hash", _content_hash(self))

    def __repr__(self) -> str:
        count = f"{self.chain.n} joints, {len(self.pieces)} convex pieces"
        return f"RobotGeometry({self.chain.name}, {count})"

    def __eq__(self, other: object) -> bool:
        return isinstance(other, RobotGeometry) and other.content_hash == self.content_hash

    def __hash__(self) -> int:
        return hash(self.content_hash)

    def attach(
        self, attached: Obstacle, link: str, touch_links: Iterable[str] = ()
    ) -> "RobotGeometry":
        """Robot holding an object.

        Args:
            attached: The object; its pose is in the frame of ``link``, its margin is not used.
            link: The link that holds it.
            touch_links: Links that it may touch, beside the one that holds it.

        Raises:
            InvalidLinkName: No such link.
            InvalidScene: The object's name is a link's already, or it is a half-space.
        """
        holder = self.chain.link(link)
        touched = {self.chain.link(name).name for name in touch_links} | {link}
        if attached.id in self.chain.index or attached.id in self.links:
            raise InvalidScene(
                f"attached object {attached.id!r} has the name of a link or attached object",
                hint="Give it a name of its own.",
            )
        if any(piece.kind == PieceKind.HALFSPACE for piece in attached.pieces()):
            raise InvalidScene(
                f"attached object {attached.id!r} is a half-space: what a link carries has an end",
                hint="Give a box that is as large as the arm reaches.",
            )
        own = [piece.placed(holder.T_joint_link) for piece in attached.pieces()]
        return self.with_solids(holder.joint, {attached.id: [own]}, touched, suspected={})

    def with_solids(
        self,
        joint: int,
        solids: Mapping[str, Sequence[Sequence[Piece]]],
        touched: Iterable[str],
        **changes: Any,
    ) -> "RobotGeometry":
        """Robot with solids on one joint, which can't move towards each other.

        Args:
            joint: The joint that carries them.
            solids: Solids by name, each as its pieces in the frame of the joint.
            touched: Links that all of them may touch.
            changes: Other fields of the robot that change.
        """
        pieces, links, counts = list(self.pieces), list(self.links), list[int]()
        same = {name for name, j in zip(self.links, self.joints, strict=True) if j == joint}
        allowed, touched = dict(self.allowed), tuple(touched)
        for name, own in solids.items():
            for solid in own:
                pieces += solid
                links += [name] * len(solid)
                counts.append(len(solid))
            allowed |= {sorted_pair(name, other): "same body" for other in same}
            allowed |= {sorted_pair(name, other): "attached" for other in touched}
            same.add(name)
        numbers = self.solids.max(initial=-1) + 1 + np.repeat(np.arange(len(counts)), counts)
        return replace(
            self,
            pieces=tuple(pieces),
            links=tuple(links),
            joints=np.append(self.joints, np.full(len(numbers), joint)),
            solids=np.append(self.solids, numbers),
            allowed=allowed,
            **changes,
        )


def robot_geometry(
    chain: Chain,
    description: RobotDescription | None = None,
    meshes: Meshes | None = None,
    semantics: Semantics | None = None,
) -> RobotGeometry:
    """Put the collision solids of a description on the joints of its chain.

    Pairs are allowed to touch where the SRDF says so; where there is none, or it names no pair,
    those of links next to each other (links without solids left out), and those that touch in
    every one of 1000 configurations. Parts of one rigid body can't move towards each other and
    are never checked. A pair that merely was apart in every sample stays checked.

    Args:
        chain: The robot.
        description: Description that it was built from; None for a robot that was given by numbers
            alone.
        meshes: Bytes of the mesh files by the name the description uses, or what finds them.
        semantics: SRDF of the robot.

    Raises:
        InvalidRobotDescription: A mesh is missing or can't be read, or a solid is malformed.
    """
    if description is None:
        return geometry_of_solids(chain, (), {})
    # One file may stand for many solids: it is read once.
    shape_of = cache(partial(_shape, meshes=meshes))
    solids = _solids(chain, description, shape_of)
    lint = [line for solid in solids for line in solid_notes(*solid)]
    groups = {} if semantics is None else semantics.group_links(description)
    lint += [
        f"group {name!r} of the SRDF has the name of a link: a pair that may touch means the link"
        for name in groups
        if name in description.links
    ]
    parents = {joint.child: joint.parent for joint in description.joints.values()}
    solids = [solid for solid in solids if solid.pieces]
    placed = [(solid.link, solid.pieces) for solid in solids]
    robot = geometry_of_solids(chain, placed, parents, semantics, lint)
    drawn = (link.name for link in chain.links if description.links[link.name].drawn)
    unseen = tuple(name for name in drawn if name not in robot.links)
    robot = replace(robot, unseen=unseen, groups=groups)
    crowded = overlapping_covers(robot)
    if not crowded:
        return robot
    for number in crowded:
        link, element, _ = solids[number]
        placed[number] = (link, _element_pieces(link, element, shape_of, FINE))
    finer = geometry_of_solids(chain, placed, parents, semantics)
    return replace(finer, allowed=robot.allowed, lint=robot.lint, unseen=unseen, groups=groups)


class _Solid(NamedTuple):
    """A solid of a description: the link that carries it, its element and its pieces."""

    link: Link
    element: CollisionElement
    pieces: list[Piece]


def _solids(
    chain: Chain, description: RobotDescription, shape_of: Callable[[Geometry], Shape | None]
) -> list[_Solid]:
    """The collision solids of all links.

    Raises:
        InvalidRobotDescription: A solid is malformed, or there are more than any robot has.
    """
    found, pieces, triangles = list[_Solid](), 0, 0
    for link in chain.links:
        for element in description.links[link.name].collisions:
            found.append(_Solid(link, element, _element_pieces(link, element, shape_of)))
            pieces += len(found[-1].pieces)
            triangles += sum(len(p.surface.triangles) for p in found[-1].pieces if p.surface)
            if max(len(found), pieces) > _MOST_PIECES or triangles > _MOST_TRIANGLES:
                raise InvalidRobotDescription(
                    f"up to link {link.name!r} there are {len(found)} collision solids of {pieces} "
                    f"convex pieces and {triangles} triangles; at most {_MOST_PIECES} pieces and "
                    f"{_MOST_TRIANGLES} triangles are taken",
                    hint="Use fewer or coarser collision solids.",
                )
    return found


def geometry_of_solids(
    chain: Chain,
    solids: Sequence[tuple[Link, Sequence[Piece]]],
    parents: Mapping[str, str],
    semantics: Semantics | None = None,
    lint: Sequence[str] = (),
) -> RobotGeometry:
    """The geometry of a robot whose solids are made already.

    Args:
        chain: The robot.
        solids: Each with the link that carries it, as pieces in the frame of the link's joint.
        parents: The link that each link hangs on.
        semantics: SRDF of the robot.
        lint: Remarks so far on what is odd.
    """
    counts = [len(pieces) for _, pieces in solids]
    bare = RobotGeometry(
        chain,
        tuple(piece for _, pieces in solids for piece in pieces),
        tuple(link.name for link, pieces in solids for _ in pieces),
        np.repeat([link.joint for link, _ in solids], counts),
        np.repeat(np.arange(len(solids)), counts),
        {},
        tuple(lint),
    )
    if not bare.pieces:
        return replace(bare, lint=(_NO_SOLIDS,))
    return replace(bare, allowed=_allowed(bare, parents, semantics))


# A few, for requests that hold one thing or another: they are keyed by identity.
@bounded_cache(maxsize=16)
def hulled(robot: RobotGeometry) -> RobotGeometry:
    """Robot with the convex hull of every solid that was cut into pieces, in their place.

    It holds the robot: what is free of it is free. It has fewer pieces, and no pockets to get
    caught in. A robot all of whose solids are convex is answered as it is.
    """
    members: dict[int, list[int]] = {}
    for i, solid in enumerate(robot.solids):
        members.setdefault(int(solid), []).append(i)
    if len(members) == len(robot.pieces) and all(p.surface is None for p in robot.pieces):
        return robot
    first = [own[0] for own in members.values()]
    pieces = tuple(_hull([robot.pieces[i] for i in own]) for own in members.values())
    return replace(
        robot,
        pieces=pieces,
        links=tuple(robot.links[i] for i in first),
        joints=robot.joints[first],
        solids=robot.solids[first],
    )


def _hull(parts: list[Piece]) -> Piece:
    if len(parts) == 1:
        return parts[0] if parts[0].surface is None else replace(parts[0], surface=None)
    points = [p.vertices @ p.T_owner_piece[:3, :3].T + p.T_owner_piece[:3, 3] for p in parts]
    rounding = max(part.offset_radius for part in parts)
    corners = convex_hull(np.vstack(points)).vertices
    return Piece(PieceKind.POLYTOPE, np.eye(4), corners, offset_radius=rounding)


def _element_pieces(
    link: Link,
    element: CollisionElement,
    shape_of: Callable[[Geometry], Shape | None],
    fineness: Fineness = COARSE,
) -> list[Piece]:
    try:
        shape = shape_of(element.geometry)
        if shape is None:
            return []
        T = link.T_joint_link @ element.T_link_element
        pieces = shape.cut(fineness) if isinstance(shape, Mesh) else shape.pieces()
        return [piece.placed(T) for piece in pieces]
    except InvalidScene as error:
        geometry = element.geometry
        what = f"mesh {geometry.uri!r}" if isinstance(geometry, MeshGeometry) else "collision"
        raise InvalidRobotDescription(
            f"link {link.name!r}, {what}: {error.message}", hint=error.hint, link=link.name
        ) from None


def plain_shape(geometry: Geometry) -> Shape | None:
    """The shape of a solid that is no mesh; None of a mesh."""
    if isinstance(geometry, BoxGeometry):
        return Box(np.array(geometry.size))
    if isinstance(geometry, SphereGeometry):
        return Sphere(geometry.radius)
    if isinstance(geometry, CylinderGeometry):
        return Cylinder(geometry.radius, geometry.length)
    if isinstance(geometry, CapsuleGeometry):
        return Capsule(geometry.radius, geometry.length)
    return None


def _shape(geometry: Geometry, meshes: Meshes | None) -> Shape | None:
    """The shape of a solid; None of a file that holds none."""
    if not isinstance(geometry, MeshGeometry):
        return plain_shape(geometry)
    uri = geometry.uri
    data = meshes(uri) if callable(meshes) else resolve_mesh(uri, meshes or {})
    kind = uri.rpartition(".")[2]
    if is_bare_header(data, kind):
        return None
    vertices, faces = load_mesh(data, kind)
    return Mesh(*scaled(vertices, faces, geometry.scale))


def sorted_pair(a: str, b: str) -> Pair:
    """A pair of names in their order."""
    return (a, b) if a < b else (b, a)


def _allowed(
    bare: RobotGeometry, parents: Mapping[str, str], semantics: Semantics | None
) -> dict[Pair, str]:
    allowed: dict[Pair, str] = {}
    if semantics is not None and semantics.names_allowed_pairs:
        # Names that the robot has no solids for are no fault: one SRDF serves several variants.
        allowed |= dict.fromkeys(semantics.allowed_pairs(bare.names), "srdf")
    else:
        allowed |= dict.fromkeys(_adjacent(bare, parents), "adjacent")
        allowed |= dict.fromkeys(always_touching(bare, allowed), "always")
        for pair in () if semantics is None else semantics.enabled_collisions:
            allowed.pop(pair, None)
    joint = dict(zip(bare.links, bare.joints, strict=True))
    fixed = (sorted_pair(a, b) for a, b in combinations(bare.names, 2) if joint[a] == joint[b])
    return allowed | dict.fromkeys(fixed, "same body")


def _adjacent(bare: RobotGeometry, parents: Mapping[str, str]) -> set[Pair]:
    names = set(bare.names)
    pairs = set()
    for name in names:
        parent = parents.get(name)
        while parent is not None and parent not in names:
            parent = parents.get(parent)
        if parent is not None:
            pairs.add(sorted_pair(name, parent))
    return pairs


def touch_matrix(
    links: Sequence[str], allowed: Iterable[Pair]
) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Numbers of the links of pieces, and which of these links may touch."""
    names, numbers = np.unique(links, return_inverse=True)
    of_name = {str(name): k for k, name in enumerate(names)}
    may_touch = np.zeros((len(names), len(names)), dtype=np.bool_)
    for a, b in allowed:
        if a in of_name and b in of_name:
            may_touch[of_name[a], of_name[b]] = may_touch[of_name[b], of_name[a]] = True
    return numbers, may_touch


def _self_pairs(geometry: RobotGeometry) -> NDArray[np.int64]:
    number, may_touch = touch_matrix(geometry.links, geometry.allowed)
    i, j = np.triu_indices(len(geometry.pieces), 1)
    chosen = (geometry.joints[i] != geometry.joints[j]) & ~may_touch[number[i], number[j]]
    array = np.column_stack([i[chosen], j[chosen]]).astype(np.int64)
    array.setflags(write=False)
    return array


def _content_hash(geometry: RobotGeometry) -> str:
    digest = hashlib.sha256(geometry.chain.content_hash.encode())
    arrays = geometry.arrays
    for array in (arrays.kinds, arrays.starts, arrays.vertices, arrays.sizes, arrays.poses):
        digest.update(array.tobytes())
    for piece in geometry.pieces:
        if piece.surface is not None:
            digest.update(piece.surface.triangles.tobytes())
            digest.update(f"{piece.surface.place}/{piece.surface.count}".encode())
    digest.update(geometry.joints.tobytes())
    for name in geometry.links:
        digest.update(name.encode() + b"\0")
    for (a, b), reason in geometry.allowed.items():
        digest.update(f"{a}\0{b}\0{reason}\0".encode())
    digest.update("".join(f"unseen {name}\0" for name in geometry.unseen).encode())
    return digest.hexdigest()


def solid_notes(link: Link, element: CollisionElement, pieces: list[Piece]) -> list[str]:
    """Tell a mesh that is empty, open or cut, and a solid that may be in millimetres.

    Args:
        link: The link.
        element: One of its solids.
        pieces: The convex pieces that make it up.
    """
    geometry = element.geometry
    if isinstance(geometry, MeshGeometry) and not pieces:
        name = f"mesh {geometry.uri!r} of link {link.name!r}"
        return [f"{name} is the header of an STL file without a triangle: it is left out"]
    notes = _length_note(link, element, pieces) if pieces and link.joint >= 0 else []
    count = sum(len(piece.surface.triangles) for piece in pieces if piece.surface is not None)
    if isinstance(geometry, MeshGeometry) and (len(pieces) > 1 or count):
        what = f"link {link.name!r}: mesh {geometry.uri!r} is not convex"
        told = f", where they touch {count} triangles decide" if count else ""
        notes.append(f"{what}: {len(pieces)} convex pieces make it up{told}")
    if isinstance(geometry, MeshGeometry) and any(map(_is_open, pieces)):
        what = f"link {link.name!r}: mesh {geometry.uri!r} is open"
        notes.append(f"{what}: what lies inside of it without touching it is not seen there")
    return notes


def _is_open(piece: Piece) -> bool:
    """Whether a piece is of a body of a mesh that bounds no solid."""
    if piece.surface is not None:
        return piece.surface.count == 0
    return not convex_hull(piece.vertices).solid


def _length_note(link: Link, element: CollisionElement, pieces: Iterable[Piece]) -> list[str]:
    corners = np.vstack([_corners(piece) for piece in pieces])
    length = float(np.max(np.ptp(corners, axis=0)))
    if length < _LONG:
        return []
    geometry = element.geometry
    if isinstance(geometry, MeshGeometry):
        what, cure = f"mesh {geometry.uri!r}", 'it needs scale="0.001 0.001 0.001"'
    else:
        what, cure = "solid", "URDF has metres"
    return [
        f"link {link.name!r}: its {what} is {length:.4g} m long: if that is in millimetres, {cure}"
    ]


def _corners(piece: Piece) -> Array:
    """Points that a piece extends to along the axes of what owns it, shape (k, 3) [m]."""
    R, center = piece.T_owner_piece[:3, :3], piece.T_owner_piece[:3, 3]
    points = piece.vertices @ R.T if len(piece.vertices) else np.zeros((1, 3))
    z = R[:, 2]
    # A disc of a radius about z extends along an axis by the radius times the sine of their angle.
    reach = piece.half_height * np.abs(z) + piece.radius * np.sqrt(np.maximum(0.0, 1.0 - z * z))
    reach += piece.offset_radius
    return center + np.vstack([points - reach, points + reach])


def lever_arms(robot: RobotGeometry) -> Array:
    """R_k of each joint, shape (n,): [m], 1 for a slide; infinite before a slide without stops.

    A joint that others follow has theirs added, times their multipliers.
    """
    tree = BodyTree.of(robot.chain)
    return _of_joints(robot.chain, tree, pieces_beyond(robot))


def link_arms(chain: Chain, link_name: str) -> Array:
    """The same of a link's origin alone, shape (n,)."""
    tree, link = BodyTree.of(chain), chain.link(link_name)
    beyond = np.zeros(len(tree.parents))
    beyond[link.joint] = float(np.linalg.norm(link.T_joint_link[:3, 3]))
    return _of_joints(chain, tree, beyond)


def _of_joints(chain: Chain, tree: BodyTree, beyond: Array) -> Array:
    """Arms of the joints within their limits, with what is so far from the frames of bodies."""
    largest = tree.positions(np.maximum(np.abs(chain.limits.lower), np.abs(chain.limits.upper)))
    return tree.of_leaders(np.where(tree.slides, 1.0, arms(tree, beyond, largest)))


def pieces_beyond(robot: RobotGeometry) -> Array:
    """Distance of a body's own pieces from its joint at most, shape (bodies,) [m]."""
    beyond = np.zeros(len(BodyTree.of(robot.chain).parents))
    for piece, body in zip(robot.pieces, robot.joints.tolist(), strict=True):
        if body >= 0:
            center, radius = piece.bounding_sphere()
            beyond[body] = max(beyond[body], float(np.linalg.norm(center)) + radius)
    return beyond


def arms(tree: BodyTree, beyond: Array, largest: Array) -> Array:
    """Distance of all that a joint carries from it at most, shape (bodies,) [m].

    Args:
        tree: The bodies.
        beyond: The same of each body's own parts, shape (bodies,) [m].
        largest: Largest absolute positions of the joints, shape (bodies,) [rad or m].
    """
    farthest = beyond.copy()
    lengths = tree.lengths + np.where(tree.slides, largest, 0.0)
    for body in range(len(farthest) - 1, -1, -1):
        parent = tree.parents[body]
        if parent >= 0:
            farthest[parent] = max(farthest[parent], farthest[body] + float(lengths[body]))
    return farthest
