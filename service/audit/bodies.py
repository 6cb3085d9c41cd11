"""Bodies of a robot and a scene as they were sent, for FCL: triangles, whatever the shape.

Shapes, poses and joints are read from the documents themselves, by code that shares nothing with
`kinematics` and `obstacles`. Round shapes become polyhedra inside of them, so no distance is
less than the true one.
"""

import base64
import io
import math
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple
from xml.etree.ElementTree import Element

import fcl
import numpy as np
import trimesh
from defusedxml import ElementTree
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]
Json = Mapping[str, Any]
#: Edges about a round shape, and subdivisions of an icosahedron.
_AROUND, _SUBDIVISIONS = 48, 3
#: Edge of the box that stands for a half-space [m].
_WIDE = 100.0
#: Clouds of more points would take the time of a plan each.
_MOST_POINTS = 200
_FORMATS = ("stl", "obj", "ply", "dae")


class Unread(Exception):
    """Error of a description that this reading does not cover."""


class Part(NamedTuple):
    """Triangles that belong to a body, in its frame.

    Args:
        vertices: Corners, shape (v, 3) [m].
        model: The triangles for FCL.
        center: Centre of a ball about them, shape (3,) [m].
        radius: Radius of that ball [m].
    """

    vertices: Array
    model: fcl.BVHModel
    center: Array
    radius: float


class Joint(NamedTuple):
    """A joint of a robot.

    Args:
        name: Name of the joint.
        kind: "revolute", "prismatic" or "fixed".
        parent: Link before it.
        child: Link behind it.
        T_parent_joint: Frame of the joint at zero, shape (4, 4).
        axis: Axis in that frame, of length 1, shape (3,).
        rest: Position where nothing moves the joint [rad or m].
        mimic: The joint that it follows, with factor and offset; None for its own master.
    """

    name: str
    kind: str
    parent: str
    child: str
    T_parent_joint: Array
    axis: Array
    rest: float = 0.0
    mimic: tuple[str, float, float] | None = None


class Robot(NamedTuple):
    """A robot as its document describes it.

    Args:
        root: Link that the others hang on.
        joints: Joints, each behind the one that carries it.
        parts: Solids of each link, in its frame.
        unread: Solids that this reading leaves out.
    """

    root: str
    joints: tuple[Joint, ...]
    parts: dict[str, list[Part]]
    unread: tuple[str, ...] = ()

    def frames(self, positions: Mapping[str, float], base: str) -> dict[str, Array]:
        """T_base_link of all links.

        Args:
            positions: Positions of joints; those that are not named rest [rad or m].
            base: Link whose frame they are in.
        """
        frames = {self.root: np.eye(4)}
        for joint in self.joints:
            leader, factor, offset = joint.mimic or (joint.name, 1.0, 0.0)
            rest = next((other.rest for other in self.joints if other.name == leader), 0.0)
            value = factor * positions.get(leader, rest) + offset
            step = np.eye(4)
            if joint.kind == "revolute":
                step[:3, :3] = Rotation.from_rotvec(value * joint.axis).as_matrix()
            elif joint.kind == "prismatic":
                step[:3, 3] = value * joint.axis
            frames[joint.child] = frames[joint.parent] @ joint.T_parent_joint @ step
        T_base_root = np.linalg.inv(frames[base])
        return {name: T_base_root @ T for name, T in frames.items()}


def read_robot(document: Json) -> Robot:
    """A robot from the request that stored it.

    Raises:
        Unread: Its description has a form that this reading does not cover.
    """
    if document.get("dh") is not None:
        return _table(document["dh"])
    root = ElementTree.fromstring(document["urdf"])
    joints = [_joint(item, document.get("held") or {}) for item in root.findall("joint")]
    children = {joint.child for joint in joints}
    links = [item.attrib["name"] for item in root.findall("link")]
    base = [name for name in links if name not in children]
    if len(base) != 1:
        raise Unread("the description has several roots")
    ordered, known = [], set(base)
    while joints:
        ready = [joint for joint in joints if joint.parent in known]
        if not ready:
            raise Unread("the joints are no tree")
        ordered += ready
        known |= {joint.child for joint in ready}
        joints = [joint for joint in joints if joint.child not in known]
    parts: dict[str, list[Part]] = {}
    unread: list[str] = []
    for link in root.findall("link"):
        solids = link.findall("collision")
        if not solids and document.get("visual_solids"):
            solids = link.findall("visual")
        for solid in solids:
            name = link.attrib["name"]
            try:
                mesh = _urdf_mesh(solid.find("geometry"), document.get("meshes") or {})
            except Unread as reason:
                unread.append(f"{name}: {reason}")
                continue
            parts.setdefault(name, []).append(part(mesh, _origin(solid)))
    return Robot(base[0], tuple(ordered), parts, tuple(unread))


def _numbers(text: str | None, default: str) -> Array:
    return np.array([float(word) for word in (text or default).split()])


def _origin(element: Element) -> Array:
    origin = element.find("origin")
    fields = {} if origin is None else origin.attrib
    T = np.eye(4)
    T[:3, :3] = Rotation.from_euler("xyz", _numbers(fields.get("rpy"), "0 0 0")).as_matrix()
    T[:3, 3] = _numbers(fields.get("xyz"), "0 0 0")
    return T


def _joint(element: Element, held: Mapping[str, float]) -> Joint:
    name, kind = element.attrib["name"], element.attrib["type"]
    ends = [element.find(end) for end in ("parent", "child")]
    parent, child = (end.attrib["link"] for end in ends if end is not None)
    axis, limit, mimic = (element.find(word) for word in ("axis", "limit", "mimic"))
    direction = _numbers(None if axis is None else axis.attrib.get("xyz"), "1 0 0")
    rest = 0.0
    if limit is not None and kind != "continuous":
        lower, upper = (float(limit.attrib.get(end, 0.0)) for end in ("lower", "upper"))
        rest = min(max(0.0, lower), upper) if lower < upper else 0.0
    if kind not in ("revolute", "continuous", "prismatic"):
        kind, direction = "fixed", np.array([1.0, 0.0, 0.0])
    return Joint(
        name,
        "revolute" if kind == "continuous" else kind,
        parent,
        child,
        _origin(element),
        direction / np.linalg.norm(direction),
        float(held.get(name, rest)),
        None
        if mimic is None
        else (
            mimic.attrib["joint"],
            float(mimic.attrib.get("multiplier", 1.0)),
            float(mimic.attrib.get("offset", 0.0)),
        ),
    )


def _urdf_mesh(geometry: Element | None, files: Mapping[str, str]) -> trimesh.Trimesh:
    shape = None if geometry is None else next(iter(geometry), None)
    if shape is None:
        raise Unread("a solid without a shape")
    sizes = {name: float(shape.attrib.get(name, 0.0)) for name in ("radius", "length")}
    if shape.tag == "mesh":
        mesh = _file(shape.attrib["filename"], files)
        mesh.vertices = mesh.vertices * _numbers(shape.attrib.get("scale"), "1 1 1")
        return mesh
    if shape.tag == "box":
        return trimesh.creation.box(_numbers(shape.attrib["size"], ""))
    return _round(shape.tag, sizes["radius"], sizes["length"])


def _round(kind: str, radius: float, height: float) -> trimesh.Trimesh:
    create = trimesh.creation
    if kind == "sphere":
        return create.icosphere(subdivisions=_SUBDIVISIONS, radius=radius)
    if kind == "cylinder":
        mesh = create.cylinder(radius, height, sections=_AROUND)
    elif kind == "capsule":
        mesh = create.capsule(height, radius, count=[_AROUND // 2, _AROUND])
    elif kind == "cone":
        mesh = create.cone(radius, height, sections=_AROUND)
    else:
        raise Unread(f"a shape of the kind {kind}")
    mesh.apply_translation(-mesh.bounds.mean(axis=0))  # some begin at z = 0
    return mesh


def _file(uri: str, files: Mapping[str, str]) -> trimesh.Trimesh:
    """The mesh file of a description: the one upload that shares the longest end of its path."""
    words = uri.rsplit("://", maxsplit=1)[-1].split("/")
    for count in range(len(words), 0, -1):
        end = "/" + "/".join(words[-count:])
        found = [name for name in files if ("/" + name.split("://")[-1]).endswith(end)]
        if found:
            break
    kind = uri.rsplit(".", 1)[-1].lower()
    if len(found) != 1 or kind not in _FORMATS:
        raise Unread(f"the mesh {uri}")
    content = base64.b64decode(files[found[0]])
    mesh = _loaded(content, kind)
    if kind == "dae":  # in its own unit and axes
        unit = ElementTree.fromstring(content).find("./{*}asset/{*}unit")
        mesh.apply_scale(1.0 if unit is None else float(unit.attrib.get("meter", 1.0)))
    return mesh


def _loaded(content: bytes, kind: str) -> trimesh.Trimesh:
    mesh = trimesh.load(io.BytesIO(content), file_type=kind, force="mesh", process=False)
    if not isinstance(mesh, trimesh.Trimesh) or not len(mesh.faces):
        raise Unread("a mesh without triangles")
    return mesh


def _table(table: Json) -> Robot:
    """A robot from its Denavit-Hartenberg table, whose links are base, link_1 ... link_n."""
    joints: list[Joint] = []
    parts: dict[str, list[Part]] = {}
    standard, z = table["convention"] == "standard", np.array([0.0, 0.0, 1.0])
    before = pose(table["base"]) if table.get("base") else np.eye(4)
    for i, row in enumerate(table["rows"], start=1):
        bend = np.eye(4)
        bend[:3, :3] = Rotation.from_euler("X", row["alpha"]).as_matrix()
        bend[:3, :3] @= Rotation.from_euler("Y", row.get("beta", 0.0)).as_matrix()
        along, lift = np.eye(4), np.eye(4)
        along[0, 3], lift[2, 3] = row["a"], row["d"]
        lift[:3, :3] = Rotation.from_euler("Z", row["theta"]).as_matrix()
        behind = along @ bend
        parent = "base" if i == 1 else f"link_{i - 1}"
        if standard:
            # The joint turns before its row's fixed part: an axis link between the two.
            joints.append(Joint(f"joint_{i}", row["type"], parent, f".{i}", before, z))
            joints.append(Joint(f".{i}", "fixed", f".{i}", f"link_{i}", lift @ behind, z))
        else:
            turned = before @ behind @ lift
            joints.append(Joint(f"joint_{i}", row["type"], parent, f"link_{i}", turned, z))
        before = np.eye(4)
        for solid in row.get("geometry") or ():
            T = pose(solid["pose"]) if solid.get("pose") else np.eye(4)
            parts.setdefault(f"link_{i}", []).extend(shape_parts(solid["shape"], T))
    end = pose(table["tool"]) if table.get("tool") else np.eye(4)
    joints.append(Joint(".tool", "fixed", f"link_{len(table['rows'])}", "tool", end, z))
    capsules = ("the capsules of the table",) if table.get("geometry") else ()
    return Robot("base", tuple(joints), parts, capsules)


def pose(fields: Json) -> Array:
    """The 4x4 transform of a pose in any of its forms."""
    if fields.get("transform") is not None:
        return np.array(fields["transform"], dtype=np.float64)
    turn = Rotation.identity()
    if fields.get("quaternion_xyzw") is not None:
        turn = Rotation.from_quat(fields["quaternion_xyzw"])
    elif fields.get("rotation_matrix") is not None:
        turn = Rotation.from_matrix(fields["rotation_matrix"])
    elif fields.get("euler_zyz") is not None:
        turn = Rotation.from_euler("ZYZ", fields["euler_zyz"])
    elif fields.get("rpy") is not None:
        turn = Rotation.from_euler("xyz", fields["rpy"])
    elif fields.get("axis_angle") is not None:
        axis = np.array(fields["axis_angle"][:3])
        turn = Rotation.from_rotvec(fields["axis_angle"][3] * axis / np.linalg.norm(axis))
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = turn.as_matrix(), fields.get("position") or (0.0, 0.0, 0.0)
    return T


def shape_parts(shape: Json, T: Array) -> list[Part]:
    """Parts of a shape of a request, placed.

    Args:
        shape: The shape.
        T: Pose of the shape in the frame of its body, shape (4, 4).

    Raises:
        Unread: A point cloud of very many points, say.
    """
    return [part(mesh, T) for mesh in _shape_meshes(shape)]


def _shape_meshes(shape: Json) -> Iterator[trimesh.Trimesh]:
    kind = shape["type"]
    if kind == "box":
        yield trimesh.creation.box(shape["size"])
    elif kind == "convex":
        yield trimesh.convex.convex_hull(np.array(shape["vertices"], dtype=np.float64))
    elif kind == "mesh" and shape.get("stl_base64"):
        yield _loaded(base64.b64decode(shape["stl_base64"]), "stl")
    elif kind == "mesh":
        yield trimesh.Trimesh(shape["vertices"], shape["faces"], process=False)
    elif kind == "point_cloud":
        if shape.get("except"):
            raise Unread("a cloud without what is near an object")
        if len(shape["points"]) > _MOST_POINTS:
            raise Unread(f"a cloud of {len(shape['points'])} points")
        for point in shape["points"]:
            ball = _round("sphere", shape["radius"], 0.0)
            ball.apply_translation(point)
            yield ball
    elif kind == "halfspace":
        normal = np.array(shape["normal"], dtype=np.float64)
        length = math.sqrt(normal @ normal)
        T = trimesh.geometry.align_vectors([0.0, 0.0, 1.0], normal / length)
        T[:3, 3] = normal / length * (shape["offset"] / length - 0.5 * _WIDE)
        yield trimesh.creation.box([_WIDE] * 3, transform=T)
    else:
        yield _round(kind, shape["radius"], shape.get("height", 0.0))


def part(mesh: trimesh.Trimesh, T: Array) -> Part:
    """Triangles of a mesh for FCL, placed by T (4, 4)."""
    vertices = np.asarray(mesh.vertices, dtype=np.float64) @ T[:3, :3].T + T[:3, 3]
    faces = np.asarray(mesh.faces, dtype=np.int64)
    if not np.isfinite(vertices).all() or faces.min() < 0 or faces.max() >= len(vertices):
        raise Unread("a mesh with odd numbers")
    model = fcl.BVHModel()
    model.beginModel(len(vertices), len(faces))
    model.addSubModel(vertices, faces)
    model.endModel()
    center = 0.5 * (vertices.min(axis=0) + vertices.max(axis=0))
    radius = float(np.linalg.norm(vertices - center, axis=1).max())
    return Part(vertices, model, center, radius)


def distance(one: Part, T_one: Array, two: Part, T_two: Array) -> float:
    """Distance of the triangles of two placed parts [m]; negative where they cross."""
    solids = [
        fcl.CollisionObject(item.model, fcl.Transform(T[:3, :3], T[:3, 3]))
        for item, T in ((one, T_one), (two, T_two))
    ]
    return float(fcl.distance(*solids, fcl.DistanceRequest(), fcl.DistanceResult()))
