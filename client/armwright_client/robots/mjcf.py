"""MJCF, the models of MuJoCo, as URDF and SRDF: compiled by MuJoCo itself, on this machine.

Links are bodies with MuJoCo's names, frames and mass properties; sites are links of nothing. The
root is ``world``. What hangs on it without a hinge or slide belongs to the scene, not the robot.
Meshes collide as their convex hulls, as in MuJoCo. Pairs that MuJoCo never lets collide (masks,
<exclude>, bodies welded together, a body and its parent) are those that the SRDF disables.
"""

import struct
from base64 import b64encode
from collections.abc import Iterator, Sequence
from math import cos, sin
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree import ElementTree as ET

from armwright_client.robots.sources import UrdfFile
from armwright_wire.errors import InvalidArgument

_INSTALL = "pip install 'mujoco>=4', which the extra [mujoco] of Armwright names"
_ROOT = "world"
_DEFAULT_NAME = "MuJoCo Model"
#: Joints of MuJoCo by number.
_FREE, _BALL, _SLIDE, _HINGE = range(4)
_SHAPES = {2: "sphere", 3: "capsule", 5: "cylinder", 6: "box", 7: "mesh"}
_MESH = 7
#: Equalities of two joints, by number.
_JOINT_EQUALITY = 2
_OTHER_SHAPES = {0: "plane", 1: "hfield", 4: "ellipsoid", 8: "sdf"}
#: Bytes of an STL file before its triangles, and of each triangle.
_STL_HEAD, _STL_TRIANGLE = 84, 50

Vector = Sequence[float]


class Pose(NamedTuple):
    """A frame in another one.

    Args:
        position: x, y, z [m].
        quaternion: w, x, y, z, as MuJoCo writes them.
    """

    position: Vector
    quaternion: Vector = (1.0, 0.0, 0.0, 0.0)

    def then(self, other: "Pose") -> "Pose":
        """The frame that is ``other`` seen from this one."""
        moved = turned(self.quaternion, other.position)
        position = [a + b for a, b in zip(self.position, moved, strict=True)]
        return Pose(position, product(self.quaternion, other.quaternion))


def read_mjcf(path: Path, max_visual_bytes: int) -> UrdfFile:
    """Compile an MJCF file and describe its robot as URDF and SRDF.

    Args:
        path: Path of the file; files that it includes and meshes are found as MuJoCo finds them.
        max_visual_bytes: Largest size of meshes that only show [byte]; small ones go first.

    Raises:
        InvalidArgument: mujoco is not installed, the file can't be compiled, or the robot has a
            joint or shape that URDF has no words for.
    """
    model = compiled(path)
    name = bytes(model.names).split(b"\0")[0].decode()
    robot = _Writer(model, path.stem if name in ("", _DEFAULT_NAME) else name)
    return robot.written(max_visual_bytes)


def compiled(path: Path) -> Any:
    """The compiled model of an MJCF file.

    Raises:
        InvalidArgument: mujoco is not installed, or can't compile it.
    """
    try:
        import mujoco  # noqa: PLC0415
    except ImportError:
        raise InvalidArgument(
            f"{path} is a model of MuJoCo (MJCF), which mujoco compiles on this machine, and that "
            "is not installed",
            hint=_INSTALL,
        ) from None
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(lambda _: None)  # else they go to a file in the folder at hand
    try:
        return mujoco.MjModel.from_xml_path(str(path))
    except ValueError as error:
        raise InvalidArgument(f"MuJoCo can't compile {path}: {error}") from None
    finally:
        mujoco.set_mju_user_warning(before)


def bodies_of_robot(model: Any) -> list[int]:
    """Bodies of the subtrees of the world that have a hinge or a slide."""
    movable = {
        int(model.body_rootid[model.jnt_bodyid[joint]])
        for joint in range(model.njnt)
        if model.jnt_type[joint] in (_SLIDE, _HINGE)
    }
    return [body for body in range(1, model.nbody) if int(model.body_rootid[body]) in movable]


def link_names(model: Any, bodies: Sequence[int]) -> dict[int, str]:
    """Names of the links of bodies, and of the root."""
    return {0: _ROOT} | {body: model.body(body).name or f"body{body}" for body in bodies}


def body_pose(model: Any, body: int) -> Pose:
    """The pose of a body in its parent, where the model puts it: free bodies too."""
    first = int(model.body_jntadr[body])
    if first >= 0 and model.jnt_type[first] == _FREE:
        start = int(model.jnt_qposadr[first])
        held = model.qpos0[start : start + 7]
        return Pose(held[:3], held[3:])
    return Pose(model.body_pos[body], model.body_quat[body])


def turned(quaternion: Vector, vector: Vector) -> list[float]:
    """A vector turned by a quaternion w, x, y, z."""
    inverse = [quaternion[0], *(-part for part in quaternion[1:])]
    return product(product(quaternion, [0.0, *vector]), inverse)[1:]


def product(a: Vector, b: Vector) -> list[float]:
    """The product of two quaternions w, x, y, z."""
    w, x, y, z = (float(value) for value in a)
    s, p, q, r = (float(value) for value in b)
    return [
        w * s - x * p - y * q - z * r,
        w * p + x * s + y * r - z * q,
        w * q - x * r + y * s + z * p,
        w * r + x * q - y * p + z * s,
    ]


def stl(model: Any, mesh: int, *, hull: bool) -> bytes:
    """A mesh of a model, or its convex hull, as binary STL.

    Args:
        model: The compiled model.
        mesh: Number of the mesh.
        hull: Whether the hull is meant, which is what collides.
    """
    first = model.mesh_vertadr[mesh]
    corners = model.mesh_vert[first : first + model.mesh_vertnum[mesh]]
    start = model.mesh_faceadr[mesh]
    faces = model.mesh_face[start : start + model.mesh_facenum[mesh]]
    graph = model.mesh_graphadr[mesh]
    if hull and graph >= 0:
        count, sides = (int(value) for value in model.mesh_graph[graph : graph + 2])
        start = graph + 2 + 2 * count + count + 3 * sides
        faces = model.mesh_graph[start : start + 3 * sides].reshape(-1, 3)
    triangles = corners[faces].reshape(-1, 9).tolist()
    rows = (struct.pack("<12fH", 0.0, 0.0, 0.0, *triangle, 0) for triangle in triangles)
    return b"\0" * 80 + struct.pack("<I", len(triangles)) + b"".join(rows)


class _Writer:
    """URDF and SRDF of a compiled model.

    Args:
        model: The compiled model.
        name: Name of the robot.
    """

    def __init__(self, model: Any, name: str) -> None:
        self._model = model
        self._name = name
        self._bodies = bodies_of_robot(model)
        if not self._bodies:
            raise InvalidArgument(f"{name!r} is no robot: no body of it has a hinge or a slide")
        self._links = link_names(model, self._bodies)
        self._taken = {*self._links.values()}
        self._robot = ET.Element("robot", name=name)
        self._meshes: dict[str, bytes] = {}

    def written(self, max_visual_bytes: int) -> UrdfFile:
        """The model as URDF and SRDF."""
        ET.SubElement(self._robot, "link", name=_ROOT)
        shown = self._shown(max_visual_bytes)
        for body in self._bodies:
            self._body(body, shown)
        for site in range(self._model.nsite):
            if int(self._model.site_bodyid[site]) in self._links:
                self._site(site)
        ET.indent(self._robot)
        text = ET.tostring(self._robot, encoding="unicode")
        meshes = {name: b64encode(data).decode("ascii") for name, data in self._meshes.items()}
        return UrdfFile(self._name, text, meshes, self._srdf())

    def _unused(self, name: str) -> str:
        """A name that no link has yet."""
        while name in self._taken:
            name += "_"
        self._taken.add(name)
        return name

    # --------------------------------------------------------------------------------- links

    def _body(self, body: int, shown: set[int]) -> None:
        model, name = self._model, self._links[body]
        link = ET.SubElement(self._robot, "link", name=name)
        if model.body_mass[body] > 0.0:
            inertial = ET.SubElement(link, "inertial")
            origin(inertial, Pose(model.body_ipos[body], model.body_iquat[body]))
            ET.SubElement(inertial, "mass", value=words([model.body_mass[body]]))
            moments = dict(zip(("ixx", "iyy", "izz"), model.body_inertia[body], strict=True))
            zeros = {"ixy": 0.0, "ixz": 0.0, "iyz": 0.0}
            values = {key: words([value]) for key, value in {**moments, **zeros}.items()}
            ET.SubElement(inertial, "inertia", values)
        for geom in geoms_of(model, body):
            if collides(model, geom):
                self._geom(link, geom, "collision")
            elif geom in shown:
                color = ET.SubElement(self._geom(link, geom, "visual"), "material", name=f"c{geom}")
                ET.SubElement(color, "color", rgba=words(model.geom_rgba[geom]))
        self._joints(body)

    def _geom(self, link: ET.Element, geom: int, kind: str) -> ET.Element:
        model, type_ = self._model, int(self._model.geom_type[geom])
        element = ET.SubElement(link, kind)
        origin(element, Pose(model.geom_pos[geom], model.geom_quat[geom]))
        shape = _SHAPES.get(type_)
        if shape is None:
            raise InvalidArgument(
                f"geom {model.geom(geom).name or geom} of body {link.get('name')!r} is of the type "
                f"{_OTHER_SHAPES.get(type_, type_)}, which URDF has no word for",
                hint="Replace it by a capsule, a box or a mesh, or let it not collide.",
            )
        size = [float(value) for value in model.geom_size[geom]]
        if shape == "box":
            sizes = {"size": words([2.0 * half for half in size])}
        elif shape == "mesh":
            sizes = {"filename": self._mesh(int(model.geom_dataid[geom]), kind == "collision")}
        else:
            sizes = {"radius": words(size[:1])}
            if shape != "sphere":
                sizes["length"] = words([2.0 * size[1]])
        ET.SubElement(ET.SubElement(element, "geometry"), shape, sizes)
        return element

    def _mesh(self, mesh: int, hull: bool) -> str:
        name = f"{'hull' if hull else 'mesh'}{mesh}.stl"
        if name not in self._meshes:
            self._meshes[name] = stl(self._model, mesh, hull=hull)
        return name

    def _shown(self, left: int) -> set[int]:
        """Geoms that only show and are sent: shapes that URDF has, meshes as far as they fit."""
        model = self._model
        every = [
            geom
            for body in self._bodies
            for geom in geoms_of(model, body)
            if not collides(model, geom) and int(model.geom_type[geom]) in _SHAPES
        ]
        shown = {geom for geom in every if model.geom_type[geom] != _MESH}
        sizes = {
            int(model.geom_dataid[geom]): int(model.mesh_facenum[model.geom_dataid[geom]])
            for geom in set(every) - shown
        }
        for mesh, faces in sorted(sizes.items(), key=lambda item: item[1]):
            left -= _STL_HEAD + _STL_TRIANGLE * faces
            if left < 0:
                break
            shown |= {
                geom
                for geom in every
                if model.geom_type[geom] == _MESH and model.geom_dataid[geom] == mesh
            }
        return shown

    def _site(self, site: int) -> None:
        model = self._model
        name = self._unused(model.site(site).name or f"site{site}")
        ET.SubElement(self._robot, "link", name=name)
        frame = Pose(model.site_pos[site], model.site_quat[site])
        self._joint(
            f"{name}_mount", "fixed", self._links[int(model.site_bodyid[site])], name, frame
        )

    # -------------------------------------------------------------------------------- joints

    def _joints(self, body: int) -> None:
        """The joints of a body, each on a link of its own before the body's."""
        model, name = self._model, self._links[body]
        parent = self._links[int(model.body_parentid[body])]
        pose = body_pose(model, body)
        first = int(model.body_jntadr[body])
        joints = [*range(first, first + int(model.body_jntnum[body]))]
        if joints and model.jnt_type[joints[0]] == _FREE:
            joints = joints[1:]
        for joint in joints:
            anchor = Pose(model.jnt_pos[joint])
            back = Pose([-value for value in anchor.position])
            last = joint == joints[-1] and not any(anchor.position)
            child = name if last else self._unused(f"{name}_of_{joint_name(model, joint)}")
            if not last:
                ET.SubElement(self._robot, "link", name=child)
            self._moving(joint, parent, child, pose.then(anchor))
            parent, pose = child, back
        if parent != name:
            self._joint(f"{name}_mount", "fixed", parent, name, pose)

    def _moving(self, joint: int, parent: str, child: str, frame: Pose) -> None:
        model, name = self._model, joint_name(self._model, joint)
        if model.jnt_type[joint] not in (_SLIDE, _HINGE):
            raise InvalidArgument(
                f"joint {name!r} is a ball joint, which no chain of the service has",
                hint="Replace it by three hinges, or weld the body.",
            )
        slides, limited = model.jnt_type[joint] == _SLIDE, bool(model.jnt_limited[joint])
        axis = [float(value) for value in model.jnt_axis[joint]]
        # Where the joint stands at 0, which MuJoCo's `ref` puts elsewhere than its body's frame.
        zero = -float(model.qpos0[model.jnt_qposadr[joint]])
        frame = frame.then(Pose([zero * a for a in axis]) if slides else about(axis, zero))
        kind = "prismatic" if slides else "revolute" if limited else "continuous"
        element = self._joint(name, kind, parent, child, frame)
        ET.SubElement(element, "axis", xyz=words(axis))
        values = dict(zip(("lower", "upper"), model.jnt_range[joint], strict=True))
        limits = {key: float(value) for key, value in values.items() if limited}
        effort = effort_of(model, joint)
        limits |= {} if effort is None else {"effort": effort}
        ET.SubElement(element, "limit", {key: words([value]) for key, value in limits.items()})
        dof = int(model.jnt_dofadr[joint])
        losses = {"damping": model.dof_damping[dof], "friction": model.dof_frictionloss[dof]}
        ET.SubElement(element, "dynamics", {key: words([loss]) for key, loss in losses.items()})
        for leader, multiplier, offset in led(model, joint):
            mimic = ET.SubElement(element, "mimic", joint=joint_name(model, leader))
            mimic.attrib |= {"multiplier": words([multiplier]), "offset": words([offset])}

    def _joint(self, name: str, kind: str, parent: str, child: str, frame: Pose) -> ET.Element:
        element = ET.SubElement(self._robot, "joint", name=name, type=kind)
        ET.SubElement(element, "parent", link=parent)
        ET.SubElement(element, "child", link=child)
        origin(element, frame)
        return element

    # ---------------------------------------------------------------------------------- SRDF

    def _srdf(self) -> str:
        root = ET.Element("robot", name=self._name)
        # The root has nothing that collides. An SRDF that disables no pair says nothing of any.
        for a, b in ((0, self._bodies[0]), *filtered(self._model, self._bodies)):
            pair = {"link1": self._links[a], "link2": self._links[b], "reason": "MJCF"}
            ET.SubElement(root, "disable_collisions", pair)
        model = self._model
        joints = [
            joint
            for joint in range(model.njnt)
            if int(model.jnt_bodyid[joint]) in self._links and model.jnt_type[joint] >= _SLIDE
        ]
        for key in range(model.nkey):
            state = ET.SubElement(root, "group_state", name=model.key(key).name or f"key{key}")
            for joint in joints:
                value = model.key_qpos[key][model.jnt_qposadr[joint]]
                ET.SubElement(state, "joint", name=joint_name(model, joint), value=words([value]))
        ET.indent(root)
        return ET.tostring(root, encoding="unicode")


def geoms_of(model: Any, body: int) -> range:
    """Numbers of the geoms of a body."""
    first = int(model.body_geomadr[body])
    return range(first, first + int(model.body_geomnum[body]))


def collides(model: Any, geom: int) -> bool:
    """Whether a geom can collide with anything."""
    masks = model.geom_contype[geom] or model.geom_conaffinity[geom]
    return bool(masks) or geom in (*model.pair_geom1, *model.pair_geom2)


def filtered(model: Any, bodies: Sequence[int]) -> Iterator[tuple[int, int]]:
    """Pairs of bodies that MuJoCo never lets collide, as its collision driver decides."""
    paired = {
        frozenset((int(model.geom_bodyid[a]), int(model.geom_bodyid[b])))
        for a, b in zip(model.pair_geom1, model.pair_geom2, strict=True)
    }
    solid = [body for body in bodies if any(collides(model, g) for g in geoms_of(model, body))]
    for i, a in enumerate(solid):
        for b in solid[i + 1 :]:
            if frozenset((a, b)) in paired:
                continue
            if never_meet(model, a, b, geoms_of(model, b)):
                yield a, b


def never_meet(model: Any, a: int, b: int, geoms: Sequence[int]) -> bool:
    """Whether a body never meets geoms of another one: excluded, related, or by their masks.

    Args:
        model: The compiled model.
        a: Number of the body.
        b: Number of the other body.
        geoms: Numbers of geoms of the other body.
    """
    excluded = {int(signature) for signature in model.exclude_signature}
    if not excluded.isdisjoint(((a << 16) + b, (b << 16) + a)) or _related(model, a, b):
        return True
    kinds, answers = model.geom_contype, model.geom_conaffinity
    return not any(
        kinds[g] & answers[h] or kinds[h] & answers[g] for g in geoms_of(model, a) for h in geoms
    )


def _related(model: Any, a: int, b: int) -> bool:
    """Whether two bodies are welded together, or one is the parent of the other."""
    from mujoco import mjtDisableBit  # noqa: PLC0415

    weld = [int(model.body_weldid[body]) for body in (a, b)]
    above = [int(model.body_weldid[model.body_parentid[body]]) for body in weld]
    if weld[0] == weld[1]:
        return True
    filters = not int(model.opt.disableflags) & int(mjtDisableBit.mjDSBL_FILTERPARENT)
    return filters and all(weld) and (weld[0] == above[1] or weld[1] == above[0])


def led(model: Any, joint: int) -> Iterator[tuple[int, float, float]]:
    """The joint that a joint follows by a linear equality: its number, multiplier and offset."""
    for number in range(model.neq):
        joints = int(model.eq_obj1id[number]), int(model.eq_obj2id[number])
        if model.eq_type[number] != _JOINT_EQUALITY or joints[0] != joint or joints[1] < 0:
            continue
        offset, slope, *higher = (float(value) for value in model.eq_data[number][:5])
        if any(higher) or not model.eq_active0[number]:
            continue
        rest, leader_rest = (float(model.qpos0[model.jnt_qposadr[one]]) for one in joints)
        yield joints[1], slope, offset + rest - slope * leader_rest
        return


def effort_of(model: Any, joint: int) -> float | None:
    """The largest torque or force that the actuators of a joint give, where the model says."""
    bounds = [
        abs(value) for value in model.jnt_actfrcrange[joint] if model.jnt_actfrclimited[joint]
    ]
    for actuator in range(model.nu):
        driven = (
            model.actuator_trntype[actuator] == 0 and model.actuator_trnid[actuator][0] == joint
        )
        if driven and model.actuator_forcelimited[actuator]:
            gear = abs(model.actuator_gear[actuator][0])
            bounds += [gear * abs(value) for value in model.actuator_forcerange[actuator]]
    return float(max(bounds)) if bounds else None


def joint_name(model: Any, joint: int) -> str:
    """The name of a joint, or its number where it has none."""
    return str(model.joint(joint).name) or f"joint{joint}"


def about(axis: Vector, angle: float) -> Pose:
    """A turn about a unit vector [rad]."""
    return Pose((0.0, 0.0, 0.0), (cos(angle / 2), *(sin(angle / 2) * a for a in axis)))


def origin(element: ET.Element, pose: Pose) -> None:
    """Write where something is."""
    w, x, y, z = pose.quaternion
    ET.SubElement(element, "origin", xyz=words(pose.position), quat_xyzw=words((x, y, z, w)))


def words(values: Sequence[float]) -> str:
    """Numbers with all their digits."""
    return " ".join(repr(float(value)) for value in values)
