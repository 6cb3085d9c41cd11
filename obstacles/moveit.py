"""MoveIt planning scenes: text to a scene."""

import marshal
from collections.abc import Callable, Iterable, Mapping
from itertools import combinations
from typing import NamedTuple

import numpy as np

from kinematics.arrays import Array, frozen
from kinematics.errors import InvalidScene
from kinematics.pose import from_quaternion, transform
from kinematics.yaml_reader import Node, UnreadableYaml, finite_number, read_yaml
from obstacles.error_place import ErrorPlace
from obstacles.moveit_geometry import is_geometry_text, scene_from_geometry
from obstacles.scene import Obstacle, Scene, checked_name
from obstacles.shapes import Box, Cone, Cylinder, HalfSpace, Mesh, Shape, Sphere

#: ``moveit_msgs/CollisionObject.REMOVE``: the object is no longer there.
_REMOVE = 1
#: Numbers of a planning scene are smaller, as a rule; others are looked at more closely.
_USUAL = 1e9
_IDENTITY, _NO_TURN = frozen(np.eye(4)), [0.0, 0.0, 0.0, 1.0]
#: Names of primitives as in the files, numbers as in ``shape_msgs/SolidPrimitive``, and how many
#: dimensions they have.
_NUMBERS = {"box": 1, "sphere": 2, "cylinder": 3, "cone": 4}
_SIZES = {1: 3, 2: 1, 3: 2, 4: 2}
#: What MoveIt enlarges links by, and the value that leaves them as they are.
_SIZES_OF_LINKS = (("link_padding", "padding", 0.0), ("link_scale", "scale", 1.0))
#: Objects that were read, by all that they say and the transforms beside them. An object of this
#: length has some ten solids of a kilobyte each [byte].
_KNOWN: dict[bytes, list[Obstacle]] = {}
_KNOWN_OBJECTS, _KNOWN_LENGTH = 1024, 4000


def scene_from_moveit(text: str | bytes) -> Scene:
    """Read a MoveIt planning scene.

    Boxes, cylinders, spheres, cones, planes (as the half-space behind them) and meshes of
    ``world.collision_objects`` become obstacles; an object of several solids becomes ``id/0``,
    ``id/1``, ... Pairs that are true in ``allowed_collision_matrix`` become allowed collisions.
    An object's frame is looked up in ``fixed_frame_transforms``; any other, "world" for example,
    becomes the frame of its obstacles, for ``obstacles.placement.place`` to find on the robot.

    Args:
        text: YAML, as MoveIt writes ``moveit_msgs/PlanningScene``, or a geometry file (.scene).

    Raises:
        InvalidScene: Not such a text, or it holds what can't be represented (an octomap, attached
            objects, padded links); the message says at which element.
    """
    decoded = text if isinstance(text, str) else text.decode("utf-8", "replace")
    if is_geometry_text(decoded):
        return scene_from_geometry(decoded)
    root = _mapping(_document(text), "planning scene")
    _refuse_unread(root)
    frames = _frames(root)
    obstacles: list[Obstacle] = []
    parts: dict[str, list[str]] = {}
    entries = _sequence(
        _mapping(root.get("world") or {}, "world").get("collision_objects"), "world"
    )
    transforms = _content(root["fixed_frame_transforms"]) if frames else b""
    for i, entry in enumerate(entries):
        where = f"world.collision_objects[{i}]"
        own = _known_obstacles(_mapping(entry, where), frames, where, transforms)
        if own:
            parts[_name(entry.get("id"), f"{where}.id")] = [obstacle.id for obstacle in own]
        obstacles += own
    return Scene(tuple(obstacles), frozenset(_allowed(root, parts)))


def _document(text: str | bytes) -> Node:
    try:
        return read_yaml(text)
    except UnreadableYaml as error:
        raise InvalidScene(f"planning scene: {error}") from None


def _refuse_unread(root: Mapping[str, Node]) -> None:
    state = _mapping(root.get("robot_state") or {}, "robot_state")
    if state.get("attached_collision_objects"):
        raise InvalidScene(
            "robot_state.attached_collision_objects: attached objects are no part of a scene",
            hint='Give them as "attached" when planning.',
        )
    octomap = _mapping(root.get("world") or {}, "world").get("octomap") or {}
    tree = _mapping(octomap, "world.octomap").get("octomap") or {}
    if _mapping(tree, "world.octomap.octomap").get("data"):
        raise InvalidScene(
            "world.octomap: octomaps are not read",
            hint="Give its voxels as a point_cloud obstacle.",
        )
    for key, field, plain in _SIZES_OF_LINKS:
        for i, entry in enumerate(_sequence(root.get(key), key)):
            fields = _mapping(entry, f"{key}[{i}]")
            value = _number(fields.get(field, plain), f"{key}[{i}].{field}")
            if value != plain:
                raise InvalidScene(
                    f"{key}[{i}] ({fields.get('link_name')!r}): a {field} of {value:g} is not read",
                    hint=f"Take {key} out, and ask for a margin: that holds for all links.",
                )


class _Frame(NamedTuple):
    """A frame by its pose in another one; None for the other means the robot's root frame.

    A pose that is None means that both are the same.
    """

    parent: str | None
    T_parent_frame: Array | None


def _frames(root: Mapping[str, Node]) -> dict[str, _Frame]:
    frames = {}
    where = "fixed_frame_transforms"
    for i, entry in enumerate(_sequence(root.get(where), where)):
        here = f"{where}[{i}]"
        fields = _mapping(entry, here)
        name = _name(fields.get("child_frame_id"), f"{here}.child_frame_id")
        pose = _mapping(fields.get("transform"), f"{here}.transform")
        T = _pose(pose, f"{here}.transform", "translation", "rotation")
        frames[name] = _Frame(_frame_id(fields, here), T)
    return frames


def _frame_id(fields: Mapping[str, Node], where: str) -> str | None:
    """The frame that a header names; None where it names none."""
    header = _mapping(fields.get("header") or {}, f"{where}.header")
    name = header.get("frame_id")
    return None if name in (None, "") else _name(name, f"{where}.header.frame_id").removeprefix("/")


def _locate(name: str | None, frames: Mapping[str, _Frame], where: str) -> _Frame:
    """A frame by its pose in one that no transform leads to, or in the root frame."""
    T: Array | None = None
    seen: set[str] = set()
    while name is not None and name in frames:
        if name in seen:
            raise InvalidScene(f"{where}: the transforms of frame {name!r} form a circle")
        seen.add(name)
        T = _product(frames[name].T_parent_frame, T)
        # The planning frame stands at itself: its transform is there for completeness.
        name = None if frames[name].parent == name else frames[name].parent
    return _Frame(name, T)


def _product(first: Array | None, second: Array | None) -> Array | None:
    """The product of two transforms, of which None is the identity."""
    if first is None:
        return second
    return first if second is None else first @ second


def _known_obstacles(
    entry: Mapping[str, Node], frames: Mapping[str, _Frame], where: str, transforms: bytes
) -> list[Obstacle]:
    """The obstacles of an object, those of an equal one in an earlier text where there was one.

    Of a scene that is sent again and again a few objects have moved, and all others have not.
    """
    if "meshes" in entry:
        return _obstacles(entry, frames, where)
    key = _content(entry) + transforms
    known = _KNOWN.get(key)
    if known is None:
        known = _obstacles(entry, frames, where)
        if len(key) <= _KNOWN_LENGTH:
            if len(_KNOWN) >= _KNOWN_OBJECTS:
                _KNOWN.clear()
            _KNOWN[key] = known
    return known


def _content(node: Node) -> bytes:
    """All that values consist of, as bytes that equal ones have."""
    # Of this version nothing in it depends on what else refers to a value; `repr` takes thrice as
    # long, most of it for numbers.
    try:
        return marshal.dumps(node, 2)
    except ValueError:  # a date, say
        return repr(node).encode("utf-8", "surrogatepass")


def _obstacles(
    entry: Mapping[str, Node], frames: Mapping[str, _Frame], where: str
) -> list[Obstacle]:
    name = _name(entry.get("id"), f"{where}.id")
    where = f"{where} ({name!r})"
    if entry.get("operation") == _REMOVE:
        return []
    frame, T = _locate(_frame_id(entry, where), frames, where)
    if entry.get("pose") is not None:
        T = _product(T, _pose(entry["pose"], f"{where}.pose"))
    solids: list[tuple[Shape, Array | None, str]] = []
    for kind, poses, read in _KINDS:
        if kind in entry or poses in entry:
            solids += _solids(entry, kind, poses, read, where)
    if not solids:
        raise InvalidScene(
            f"{where}: it has no solid",
            hint=f"Needed is one of: {', '.join(kind for kind, _, _ in _KINDS)}.",
        )
    obstacles = []
    for k, (shape, T_object_solid, here) in enumerate(solids):
        with ErrorPlace(here):
            own = f"{name}/{k}" if len(solids) > 1 else name
            placed = _product(T, T_object_solid)
            # No zero is negative: the content hash tells them apart.
            pose = _IDENTITY if placed is None else placed + 0.0
            obstacles.append(Obstacle(own, shape, pose, frame=frame))
    return obstacles


def _solids(
    entry: Mapping[str, Node],
    kind: str,
    poses: str,
    read: Callable[[Mapping[str, Node], str], Shape],
    where: str,
) -> list[tuple[Shape, Array | None, str]]:
    given = _sequence(entry.get(kind), f"{where}.{kind}")
    placed = _sequence(entry.get(poses), f"{where}.{poses}")
    if len(placed) != len(given) and not (entry.get("pose") is not None and not placed):
        raise InvalidScene(f"{where}: {len(given)} {kind}, but {len(placed)} {poses}")
    solids: list[tuple[Shape, Array | None, str]] = []
    for k, fields in enumerate(given):
        here = f"{where}.{kind}[{k}]"
        with ErrorPlace(here):
            shape = read(_mapping(fields, here), here)
        T = _pose(placed[k], f"{where}.{poses}[{k}]") if placed else None
        solids.append((shape, T, here))
    return solids


def _primitive(fields: Mapping[str, Node], where: str) -> Shape:
    name = fields.get("type")
    number = _NUMBERS.get(str(name).lower(), name)
    if isinstance(number, bool) or not isinstance(number, int) or number not in _SIZES:
        raise InvalidScene(f"type {name!r} is none of box, sphere, cylinder, cone")
    size = _vector(fields.get("dimensions"), _SIZES[number], f"{where}.dimensions")
    if number == 1:
        return Box(size)
    if number == 2:
        return Sphere(size[0])
    return (Cylinder if number == 3 else Cone)(radius=size[1], height=size[0])


def _plane(fields: Mapping[str, Node], where: str) -> Shape:
    a, b, c, d = _vector(fields.get("coef"), 4, f"{where}.coef")
    return HalfSpace(np.array([a, b, c]), -d)


def _mesh(fields: Mapping[str, Node], where: str) -> Shape:
    vertices = [
        _vector(point, 3, f"{where}.vertices[{i}]")
        for i, point in enumerate(_sequence(fields.get("vertices"), f"{where}.vertices"))
    ]
    triangles = []
    for i, entry in enumerate(_sequence(fields.get("triangles"), f"{where}.triangles")):
        corners = entry.get("vertex_indices") if isinstance(entry, dict) else entry
        here = f"{where}.triangles[{i}]"
        numbers = _sequence(corners, here)
        if len(numbers) != 3 or not all(type(number) is int for number in numbers):
            raise InvalidScene(f"{here}: needed are three whole numbers")
        triangles.append(numbers)
    if not vertices or not triangles:
        raise InvalidScene(f"{where}: the mesh is empty")
    return Mesh(np.array(vertices), np.array(triangles))


_KINDS = (
    ("primitives", "primitive_poses", _primitive),
    ("meshes", "mesh_poses", _mesh),
    ("planes", "plane_poses", _plane),
)


def _allowed(root: Mapping[str, Node], parts: Mapping[str, list[str]]) -> Iterable[tuple[str, str]]:
    where = "allowed_collision_matrix"
    matrix = _mapping(root.get(where) or {}, where)
    names = _names(matrix, "entry_names", where)
    rows = [
        _flags(row, len(names), f"{where}.entry_values[{i}]")
        for i, row in enumerate(_sequence(matrix.get("entry_values"), f"{where}.entry_values"))
    ]
    if len(rows) != len(names):
        raise InvalidScene(f"{where}: {len(names)} entry_names, but {len(rows)} entry_values")
    # Both halves must say so: half an allowance is a mistake, and this side of it is the safe one.
    pairs = {
        (names[i], names[j])
        for i, j in combinations(range(len(names)), 2)
        if rows[i][j] and rows[j][i]
    }
    defaults = _names(matrix, "default_entry_names", where)
    flags = _flags(
        matrix.get("default_entry_values") or [], len(defaults), f"{where}.default_entry_values"
    )
    given = dict(zip(defaults, flags, strict=True))
    known = {*names, *parts}
    # Where both have a default, one that is false decides, as in MoveIt.
    pairs |= {
        (name, other)
        for name, flag in given.items()
        for other in known - {name}
        if flag and given.get(other, True) and not (name in names and other in names)
    }
    for a, b in pairs:
        yield from ((x, y) for x in parts.get(a, [a]) for y in parts.get(b, [b]))


def _names(matrix: Mapping[str, Node], key: str, where: str) -> list[str]:
    entries = _sequence(matrix.get(key), f"{where}.{key}")
    return [_name(entry, f"{where}.{key}[{i}]") for i, entry in enumerate(entries)]


def _flags(row: Node, count: int, where: str) -> list[bool]:
    flags = _sequence(row.get("enabled") if isinstance(row, dict) else row, where)
    if len(flags) != count or not all(isinstance(flag, bool) for flag in flags):
        raise InvalidScene(f"{where}: needed are {count} values true or false")
    return flags


def _pose(
    node: Node, where: str, position: str = "position", orientation: str = "orientation"
) -> Array:
    fields = _mapping(node, where)
    unknown = [name for name in fields if name not in (position, orientation)]
    if unknown:
        raise InvalidScene(f"{where}: unknown {', '.join(sorted(map(str, unknown)))}")
    p = _vector(fields.get(position, [0, 0, 0]), 3, f"{where}.{position}")
    xyzw = _vector(fields.get(orientation, _NO_TURN), 4, f"{where}.{orientation}")
    if xyzw == _NO_TURN:
        return transform(position=p)
    with ErrorPlace(f"{where}.{orientation}"):
        return transform(from_quaternion(xyzw), p)


def _mapping(node: Node, where: str) -> Mapping[str, Node]:
    if not isinstance(node, dict):
        raise InvalidScene(f"{where}: needed are named fields, found is {_kind(node)}")
    return node


def _sequence(node: Node, where: str) -> list[Node]:
    if node is None:
        return []
    if not isinstance(node, list):
        raise InvalidScene(f"{where}: needed is a list, found is {_kind(node)}")
    return node


def _vector(node: Node, count: int, where: str) -> list[float]:
    if isinstance(node, dict) and set(node) == set("xyzw"[:count]):
        node = [node[axis] for axis in "xyzw"[:count]]
    if type(node) is list and len(node) == count:
        usual = [float(x) for x in node if type(x) in (float, int) and -_USUAL <= x <= _USUAL]
        if len(usual) == count:
            return usual
    values = _sequence(node, where)
    if len(values) != count:
        raise InvalidScene(f"{where}: needed are {count} numbers, found are {len(values)}")
    return [_number(value, f"{where}[{i}]") for i, value in enumerate(values)]


def _number(node: Node, where: str) -> float:
    number = finite_number(node)
    if number is None:
        raise InvalidScene(f"{where}: {str(node)[:40]!r} is no finite number")
    return number


def _name(node: Node, where: str) -> str:
    if isinstance(node, int) and not isinstance(node, bool):
        node = str(node)
    return checked_name(node, where)


def _kind(node: Node) -> str:
    return {"NoneType": "nothing", "str": "text", "list": "a list", "dict": "named fields"}.get(
        type(node).__name__, type(node).__name__
    )
