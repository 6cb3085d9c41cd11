"""MoveIt planning scenes: text to a scene.

Each field means what MoveIt's own ``PlanningScene`` takes it for. What of a text is not obeyed is
refused, or told in the notes of the scene.
"""

import marshal
from collections.abc import Callable, Iterable, Mapping
from difflib import get_close_matches
from typing import NamedTuple

import numpy as np

from kinematics.arrays import Array, frozen, typed
from kinematics.errors import InvalidScene
from kinematics.pose import from_quaternion, transform
from kinematics.readers.yaml_reader import Node, UnreadableYaml, finite_number, read_yaml
from kinematics.root_frame import TOOL
from obstacles.scenes.moveit_geometry import ErrorPlace, is_geometry_text, scene_from_geometry
from obstacles.scenes.moveit_matrix import Permissions, permissions
from obstacles.scenes.scene import Obstacle, Scene, checked_name
from obstacles.shapes.shape import Box, Compound, Cone, Cylinder, HalfSpace, Mesh, Shape, Sphere

#: Operations of ``moveit_msgs/CollisionObject``.
_ADD, _REMOVE, _APPEND = 0, 1, 2
#: Numbers of a planning scene are smaller, as a rule; others are looked at more closely.
_USUAL = 1e9
_IDENTITY, _NO_TURN = frozen(np.eye(4)), [0.0, 0.0, 0.0, 1.0]
#: Shorter quaternions name no rotation; longer or shorter ones than these are told [1].
_SHORTEST, _UNIT = 1e-9, 1e-3
#: Names of primitives as in the files, numbers as in ``shape_msgs/SolidPrimitive``, and how many
#: dimensions they have.
_NUMBERS = {"box": 1, "sphere": 2, "cylinder": 3, "cone": 4}
_SIZES = {1: 3, 2: 1, 3: 2, 4: 2}
#: What MoveIt enlarges links by, and the value that leaves them as they are.
_SIZES_OF_LINKS = (("link_padding", "padding", 0.0), ("link_scale", "scale", 1.0))
#: Fields of the messages, and those that nothing of a scene depends on.
_SCENE_FIELDS = (
    "name", "robot_state", "robot_model_name", "fixed_frame_transforms",
    "allowed_collision_matrix", "link_padding", "link_scale", "object_colors", "world", "is_diff",
)  # fmt: skip
_STATE_FIELDS = ("joint_state", "multi_dof_joint_state", "attached_collision_objects", "is_diff")
_WORLD_FIELDS = ("collision_objects", "octomap")
_OBJECT_FIELDS = (
    "header", "pose", "id", "type", "primitives", "primitive_poses", "meshes", "mesh_poses",
    "planes", "plane_poses", "subframe_names", "subframe_poses", "operation",
)  # fmt: skip
_UNREAD = (("object_colors",), ("is_diff",), ("robot_state", "joint_state", "position"))
#: Objects that were read, by all that they say. An object of this length has some ten solids of a
#: kilobyte each [byte].
_KNOWN: dict[bytes, "_Object"] = {}
_KNOWN_OBJECTS, _KNOWN_LENGTH = 1024, 4000
#: What is told of objects, once for all that it is true of.
_NO_FRAME = "no frame (header.frame_id): taken in the robot's root frame, where MoveIt refuses it"
_EMPTY = "an orientation of zeros: no rotation, as MoveIt takes it"
_LONG = "an orientation that is no unit quaternion: normalised, as MoveIt does"
_EXTRA = "more dimensions than its type has: the first ones count, as in MoveIt"
_TYPE = "a type, which nothing here depends on"


@typed
def scene_from_moveit(text: str | bytes) -> Scene:
    """Read a MoveIt planning scene.

    Boxes, cylinders, spheres, cones, planes (as the half-space behind them) and meshes of
    ``world.collision_objects`` become obstacles, one for each object. Pairs that are true in
    ``allowed_collision_matrix`` become allowed collisions. The frame of an object is that of its
    obstacle, for ``obstacles.scenes.placement.place`` to find on the robot or among the scene's
    ``fixed_frames``: those are the ``fixed_frame_transforms``.

    Args:
        text: YAML, as MoveIt and ROS's tools write ``moveit_msgs/PlanningScene`` or its ``world``,
            or a geometry file (.scene).

    Raises:
        InvalidScene: Not such a text, or it holds what can't be represented (an octomap, attached
            objects, padded links); the message says at which element.
    """
    decoded = text if isinstance(text, str) else text.decode("utf-8", "replace")
    if is_geometry_text(decoded):
        return scene_from_geometry(decoded)
    root = _message(text)
    _refuse_unread(root)
    notes = _unread(root)
    fixed_frames = _fixed_frames(root, notes)
    world = _mapping(root.get("world") or {}, "world", _WORLD_FIELDS)
    objects = _objects(_sequence(world.get("collision_objects"), "world"), notes)
    obstacles = tuple(item.obstacle for item in objects.values())
    for frame in {obstacle.frame for obstacle in obstacles} - fixed_frames.keys():
        _check_frame(frame)
    allowed = permissions(root.get("allowed_collision_matrix"))
    return Scene(
        obstacles,
        allowed.pairs,
        fixed_frames,
        allowed.free,
        (*notes, *_told(objects.values()), *_matrix_notes(allowed)),
    )


def _message(text: str | bytes) -> Mapping[str, Node]:
    """The message of a text: a scene, the answer of a service that holds one, or a world."""
    try:
        root = read_yaml(text)
    except UnreadableYaml as error:
        raise InvalidScene(f"planning scene: {error}") from None
    if isinstance(root, dict) and set(root) == {"scene"}:
        root = root["scene"]
    if isinstance(root, dict) and root and root.keys() <= set(_WORLD_FIELDS):
        root = {"world": root}
    return _mapping(root, "planning scene", _SCENE_FIELDS)


def _refuse_unread(root: Mapping[str, Node]) -> None:
    state = _mapping(root.get("robot_state") or {}, "robot_state", _STATE_FIELDS)
    if state.get("attached_collision_objects"):
        raise InvalidScene(
            "robot_state.attached_collision_objects: attached objects are no part of a scene",
            hint='Give them as "attached" when planning.',
        )
    _refuse_moved_root(state)
    world = _mapping(root.get("world") or {}, "world", _WORLD_FIELDS)
    octomap = _mapping(world.get("octomap") or {}, "world.octomap")
    tree = _mapping(octomap.get("octomap") or {}, "world.octomap.octomap")
    if tree.get("data"):
        raise InvalidScene(
            "world.octomap: octomaps are not read",
            hint="Give its voxels as a point_cloud obstacle.",
        )
    for key, field, plain in _SIZES_OF_LINKS:
        for i, entry in enumerate(_sequence(root.get(key), key)):
            fields = _mapping(entry, f"{key}[{i}]", ("link_name", field))
            value = _number(fields.get(field, 0.0), f"{key}[{i}].{field}")
            if value != plain:
                raise InvalidScene(
                    f"{key}[{i}] ({fields.get('link_name')!r}): a {field} of {value:g} is not read",
                    hint=f"Take {key} out, and ask for a margin: that holds for all links.",
                )


def _refuse_moved_root(state: Mapping[str, Node]) -> None:
    """Refuse a state in which a joint of several freedoms has moved the robot."""
    where = "robot_state.multi_dof_joint_state"
    joints = _mapping(state.get("multi_dof_joint_state") or {}, where)
    names = _sequence(joints.get("joint_names"), f"{where}.joint_names")
    for i, entry in enumerate(_sequence(joints.get("transforms"), f"{where}.transforms")):
        T, _ = _pose(entry, f"{where}.transforms[{i}]", "translation", "rotation")
        if T is not _IDENTITY:
            joint = names[i] if i < len(names) else i
            raise InvalidScene(
                f"{where}: joint {joint!r} has moved the robot, which stands at its root here",
                hint="Save the scene with the joint at its origin, or take multi_dof_joint_state "
                "out where the objects are meant in the frame of the robot's root.",
            )


def _unread(root: Mapping[str, Node]) -> list[str]:
    """A note on the fields that say something which is not obeyed."""
    found = []
    for path in _UNREAD:
        node: Node = root
        for key in path:
            node = node.get(key) if isinstance(node, dict) else None
        if node:
            found.append(".".join(path))
    return (
        [f"fields of the planning scene that are not obeyed: {', '.join(found)}"] if found else []
    )


def _matrix_notes(allowed: Permissions) -> list[str]:
    if not allowed.halves:
        return []
    pairs = "; ".join(" and ".join(pair) for pair in allowed.halves)
    return [f"allowed_collision_matrix allows in one of its halves alone: not allowed are {pairs}"]


# ------------------------------------------------------------------------------------- frames


def _fixed_frames(root: Mapping[str, Node], notes: list[str]) -> dict[str, tuple[str, Array]]:
    """Frames by their names, each with the planning frame and its pose there.

    MoveIt writes the planning frame as ``child_frame_id`` and the frame as ``header.frame_id``
    (``Transforms::copyTransforms``), the reverse of tf.
    """
    frames = {}
    where = "fixed_frame_transforms"
    for i, entry in enumerate(_sequence(root.get(where), where)):
        here = f"{where}[{i}]"
        fields = _mapping(entry, here, ("header", "child_frame_id", "transform"))
        pose = _mapping(fields.get("transform"), f"{here}.transform")
        T, _ = _pose(pose, f"{here}.transform", "translation", "rotation")
        name = _frame_id(fields, here)
        child = fields.get("child_frame_id")
        parent = None if child in (None, "") else _name(child, f"{here}.child_frame_id")
        if name is None or parent is None:
            if T is not _IDENTITY:
                notes.append(f"{here} lacks a name of a frame: left out, as in MoveIt")
        elif name != parent:
            frames[name] = parent, T
        elif T is not _IDENTITY:
            notes.append(f"{here} puts {name!r} elsewhere than where it is: left out, as in MoveIt")
    return frames


def _frame_id(fields: Mapping[str, Node], where: str) -> str | None:
    """The frame that a header names; None where it names none."""
    header = _mapping(fields.get("header") or {}, f"{where}.header", ("seq", "stamp", "frame_id"))
    name = header.get("frame_id")
    return None if name in (None, "") else _name(name, f"{where}.header.frame_id").removeprefix("/")


def _check_frame(name: str | None) -> None:
    if name == TOOL:
        raise InvalidScene(
            f"a collision object is in the frame {TOOL!r}, which means the tip of a chain here",
            hint="Give the object in the planning frame.",
        )


# ------------------------------------------------------------------------------------ objects


class _Object(NamedTuple):
    """A collision object.

    Attributes:
        obstacle: Obstacle of the object.
        subframes: Poses of subframes by name, in the object's frame.
        told: Remarks on what is odd about the object.
    """

    obstacle: Obstacle
    subframes: Mapping[str, Array]
    told: frozenset[str]


def _objects(entries: list[Node], notes: list[str]) -> dict[str, _Object]:
    """The objects that are there when all entries were processed in their order."""
    objects: dict[str, _Object] = {}
    for i, node in enumerate(entries):
        where = f"world.collision_objects[{i}]"
        entry = _mapping(node, where, _OBJECT_FIELDS)
        operation = _operation(entry.get("operation"), f"{where}.operation")
        if operation == _REMOVE and not entry.get("id"):
            objects.clear()
            continue
        name = _name(entry.get("id"), f"{where}.id")
        if operation == _REMOVE:
            if objects.pop(name, None) is None:
                notes.append(f"{where} removes {name!r}, which is not there")
            continue
        if operation != _ADD and not (operation == _APPEND and name not in objects):
            raise InvalidScene(
                f"{where} ({name!r}): an operation {operation} (append or move) is not obeyed",
                hint="Send each object whole, as MoveIt saves scenes.",
            )
        if name in objects:
            notes.append(f"{where} gives {name!r} once more: the last one counts, as in MoveIt")
        objects[name] = _in_scene(_read_object(entry, name, f"{where} ({name!r})"), objects)
    return objects


def _operation(node: Node, where: str) -> int:
    """The number of an operation, which ROS 2 writes as the byte it is."""
    if isinstance(node, str) and len(node) == 1 and not node.isdigit():
        node = ord(node)
    number = 0 if node is None else finite_number(node)
    if number is None or number not in range(4):
        raise InvalidScene(f"{where}: {str(node)[:40]!r} is none of 0, 1, 2, 3")
    return int(number)


def _in_scene(item: _Object, objects: Mapping[str, _Object]) -> _Object:
    """An object whose frame may be another object, or a subframe of one."""
    own, frame = item.obstacle, item.obstacle.frame or ""
    ways: list[tuple[str, str | None]] = [(frame, None)]
    ways += [(frame[:k], frame[k + 1 :]) for k, letter in enumerate(frame) if letter == "/"]
    for name, inner in ways:
        other = objects.get(name)
        if other is None or (inner is not None and inner not in other.subframes):
            continue
        T = _IDENTITY if inner is None else other.subframes[inner]
        T = other.obstacle.T_world_obstacle @ T @ own.T_world_obstacle
        moved = Obstacle(own.id, own.shape, T, frame=other.obstacle.frame)
        return item._replace(obstacle=moved)
    return item


def _read_object(entry: Mapping[str, Node], name: str, where: str) -> _Object:
    """An object, that of an equal one in an earlier text where there was one.

    Of a scene that is sent again and again a few objects have moved, and all others have not.
    """
    if entry.get("meshes"):
        return _new_object(entry, name, where)
    key = _content(entry)
    known = _KNOWN.get(key)
    if known is None:
        known = _new_object(entry, name, where)
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


def _new_object(entry: Mapping[str, Node], name: str, where: str) -> _Object:
    told: set[str] = {_TYPE} if _is_told(entry.get("type")) else set()
    solids: list[tuple[Shape, Array]] = []
    for kind, poses, read in _KINDS:
        if entry.get(kind) or entry.get(poses):
            solids += _solids(entry, kind, poses, read, where, told)
    if not solids:
        raise InvalidScene(
            f"{where}: it has no solid",
            hint=f"Needed is one of: {', '.join(kind for kind, _, _ in _KINDS)}.",
        )
    T = _told_pose(entry.get("pose"), f"{where}.pose", told, empty=False)
    (shape, T_solid), *more = solids
    if not more and T is _IDENTITY:
        T = T_solid  # the object's frame is that of its one solid where it has no pose
    elif more or T_solid is not _IDENTITY:
        shape = Compound(*zip(*solids, strict=True))
    frame = _frame_id(entry, where)
    if frame is None:
        told.add(_NO_FRAME)
    with ErrorPlace(where):
        # No zero is negative: the content hash tells them apart.
        obstacle = Obstacle(name, shape, T + 0.0, frame=frame)
    return _Object(obstacle, _subframes(entry, where, told), frozenset(told))


def _is_told(node: Node) -> bool:
    """Whether any field of a message is not empty."""
    return any(map(_is_told, node.values())) if isinstance(node, dict) else bool(node)


def _subframes(entry: Mapping[str, Node], where: str, told: set[str]) -> dict[str, Array]:
    names = _sequence(entry.get("subframe_names"), f"{where}.subframe_names")
    poses = _sequence(entry.get("subframe_poses"), f"{where}.subframe_poses")
    if len(names) != len(poses):
        raise InvalidScene(f"{where}: {len(names)} subframe_names, but {len(poses)} subframe_poses")
    return {
        _name(name, f"{where}.subframe_names[{k}]"): _told_pose(
            pose, f"{where}.subframe_poses[{k}]", told
        )
        for k, (name, pose) in enumerate(zip(names, poses, strict=True))
    }


def _told(objects: Iterable[_Object]) -> list[str]:
    """Notes on objects, one for each kind of what is odd."""
    by_kind: dict[str, list[str]] = {}
    for item in objects:
        for kind in sorted(item.told):
            by_kind.setdefault(kind, []).append(item.obstacle.id)
    return [f"{_listed(names)}: {kind}" for kind, names in sorted(by_kind.items())]


def _listed(names: list[str], most: int = 5) -> str:
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return f"collision object(s) {', '.join(map(repr, names[:most]))}{more}"


def _solids(
    entry: Mapping[str, Node],
    kind: str,
    poses: str,
    read: Callable[[Mapping[str, Node], str, set[str]], Shape],
    where: str,
    told: set[str],
) -> list[tuple[Shape, Array]]:
    given = _sequence(entry.get(kind), f"{where}.{kind}")
    placed = _sequence(entry.get(poses), f"{where}.{poses}")
    if len(placed) > len(given):
        raise InvalidScene(f"{where}: {len(given)} {kind}, but {len(placed)} {poses}")
    solids: list[tuple[Shape, Array]] = []
    for k, fields in enumerate(given):
        here = f"{where}.{kind}[{k}]"
        with ErrorPlace(here):
            shape = read(_mapping(fields, here), here, told)
        pose = placed[k] if k < len(placed) else None
        solids.append((shape, _told_pose(pose, f"{where}.{poses}[{k}]", told)))
    return solids


def _primitive(fields: Mapping[str, Node], where: str, told: set[str]) -> Shape:
    _mapping(fields, where, ("type", "dimensions", "polygon"))
    name = fields.get("type")
    number = _NUMBERS.get(str(name).lower(), name)
    if isinstance(number, bool) or not isinstance(number, int) or number not in _SIZES:
        raise InvalidScene(f"type {name!r} is none of box, sphere, cylinder, cone")
    given = _sequence(fields.get("dimensions"), f"{where}.dimensions")
    if len(given) > _SIZES[number]:
        told.add(_EXTRA)
    size = _vector(given[: _SIZES[number]], _SIZES[number], f"{where}.dimensions")
    if number == 1:
        return Box(size)
    if number == 2:
        return Sphere(size[0])
    return (Cylinder if number == 3 else Cone)(radius=size[1], height=size[0])


def _plane(fields: Mapping[str, Node], where: str, _told: set[str]) -> Shape:
    _mapping(fields, where, ("coef",))
    a, b, c, d = _vector(fields.get("coef"), 4, f"{where}.coef")
    return HalfSpace(np.array([a, b, c]), -d)


def _mesh(fields: Mapping[str, Node], where: str, _told: set[str]) -> Shape:
    _mapping(fields, where, ("vertices", "triangles"))
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


# ------------------------------------------------------------------------------------- values


def _told_pose(node: Node, where: str, told: set[str], *, empty: bool = True) -> Array:
    """A pose; what is odd about its orientation is told.

    Args:
        node: The message; None where it is left out.
        where: Place in the text.
        told: List that gets remarks on what is odd.
        empty: Whether a pose of zeros is odd.
    """
    if node is None:
        return _IDENTITY
    T, length = _pose(node, where)
    if length == 0.0 and (empty or T is not _IDENTITY):
        told.add(_EMPTY)
    elif length > 0.0 and abs(length - 1.0) > _UNIT:
        told.add(_LONG)
    return T


def _pose(
    node: Node, where: str, position: str = "position", orientation: str = "orientation"
) -> tuple[Array, float]:
    """A pose, and the length of its quaternion: 0 where it is all zeros."""
    fields = _mapping(node, where, (position, orientation))
    p = _vector(fields.get(position, [0, 0, 0]), 3, f"{where}.{position}")
    xyzw = _quaternion(fields.get(orientation, _NO_TURN), f"{where}.{orientation}")
    if not any(xyzw[:3]):
        length = abs(xyzw[3])
        return (transform(position=p) if any(p) else _IDENTITY), length
    length = float(np.linalg.norm(xyzw))
    with ErrorPlace(f"{where}.{orientation}"):
        if not length > _SHORTEST:
            raise InvalidScene(f"a quaternion of length {length:g} names no rotation")
        return transform(from_quaternion(np.divide(xyzw, length)), p), length


def _quaternion(node: Node, where: str) -> list[float]:
    """x, y, z, w; what is left out is 0, and w only where that makes no difference."""
    if isinstance(node, dict) and "w" not in node:
        xyz = _vector(node, 3, where)
        if any(xyz):
            raise InvalidScene(
                f"{where}: w is left out, which ROS 1 takes for 0 and ROS 2 for 1",
                hint="Give x, y, z and w.",
            )
        return [*xyz, 1.0]
    return _vector(node, 4, where)


def _mapping(node: Node, where: str, fields: tuple[str, ...] | None = None) -> Mapping[str, Node]:
    """Named fields, none of them but those of a message."""
    if not isinstance(node, dict):
        raise InvalidScene(f"{where}: needed are named fields, found is {_kind(node)}")
    unknown = [] if fields is None else [str(key) for key in node if key not in fields]
    if unknown:
        near = get_close_matches(unknown[0], fields or (), 1)
        raise InvalidScene(
            f"{where}: unknown {', '.join(sorted(unknown))}",
            hint=f"Is {near[0]} meant?" if near else f"The fields are {', '.join(fields or ())}.",
        )
    return node


def _sequence(node: Node, where: str) -> list[Node]:
    if node is None:
        return []
    if not isinstance(node, list):
        raise InvalidScene(f"{where}: needed is a list, found is {_kind(node)}")
    return node


def _vector(node: Node, count: int, where: str) -> list[float]:
    """Numbers in a list, or by the names x, y, z, w, of which those left out are 0."""
    if isinstance(node, dict) and count <= 4 and node.keys() <= set("xyzw"[:count]):
        node = [node.get(axis, 0.0) for axis in "xyzw"[:count]]
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
