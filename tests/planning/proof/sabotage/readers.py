"""Numbers that the proof is given, beside those that other libraries read from the same bytes.

Planners and proof read robots and scenes by the same code: where it errs, they err alike, and no
lie of a planner shows it. So what the proof's own table holds is compared with what pinocchio and
coal make of the files of a robot, and trimesh, scipy and numpy of those of a scene.
"""

import json
from collections.abc import Iterator, Mapping
from pathlib import Path

import coal
import numpy as np
import pinocchio as pin
import scipy.linalg
import trimesh
from scipy.spatial.transform import Rotation

from kinematics.arrays import Array
from kinematics.forward import joint_frames
from kinematics.pose import from_quaternion, transform
from kinematics.tree.serial_chain import serial_chain
from kinematics.urdf.urdf import parse_urdf
from obstacles.convex.piece import PieceKind
from obstacles.meshes import mesh
from obstacles.robots import robot_geometry
from obstacles.scenes import moveit, scene
from obstacles.shapes import shape as shapes
from planning.proof.collision.pair_table import PairTable
from tests.obstacles.bodies import ell
from tests.obstacles.meshes.test_mesh import written

#: Directions along which solids are compared, and what single precision leaves of a metre.
DIRECTIONS = np.random.default_rng(0).normal(size=(200, 3))
DIRECTIONS /= np.linalg.norm(DIRECTIONS, axis=1)[:, None]
TOLERANCE = 2e-6
_PACKAGE = "package://cell/"


def mesh_files() -> dict[str, bytes]:
    """Bytes of mesh files of each kind, convex and not, in metres."""
    body = ell(0.2)
    ball = trimesh.creation.icosphere(2, radius=0.15)
    ball.apply_translation([0.1, -0.05, 0.2])
    ring = ((0, 0), (0.2, 0), (0.2, 0.3), (0, 0.3))
    corners = "".join(f"v {x} {y} {z}\n" for z in (0, 0.1) for x, y in ring)
    squares = "vt 0 0\nf 4 3 2 1\nf 5 6 7 8\nf 1/1 2/1 6/1 5/1\nf 2 3 7 6\nf 3 4 8 7\nf 4 1 5 8\n"
    return {
        "binary.stl": bytes(body.export(file_type="stl")),
        "text.stl": str(ball.export(file_type="stl_ascii")).encode(),
        "body.obj": str(body.export(file_type="obj")).encode(),
        "squares.obj": (corners + squares).encode(),
        "body.dae": written(),
    }


def _urdf() -> str:
    """An arm of three links with every kind of solid, at oblique places."""
    scales = {"binary.stl": "1 2 -3", "body.obj": ".5 .5 .5", "body.dae": ".02 -.02 .03"}
    solids = [
        f'<mesh filename="{_PACKAGE}{name}" scale="{scales.get(name, "1 1 1")}"/>'
        for name in mesh_files()
    ]
    solids += ['<box size=".1 .2 .3"/>', '<sphere radius=".07"/>']
    solids += ['<cylinder radius=".05" length=".4"/>']
    text, parent = '<robot name="cell"><link name="base"/>', "base"
    for k, kind in enumerate(("revolute", "prismatic", "continuous")):
        own = "".join(
            f'<collision><origin xyz="{0.1 * i} {0.2 - 0.3 * k} {0.05 * i * k}" '
            f'rpy="{0.3 * i} {-0.2 * i} {0.5 + i + k}"/><geometry>{solid}</geometry></collision>'
            for i, solid in enumerate(solids[k::3])
        )
        text += (
            f'<link name="l{k}">{own}</link><joint name="j{k}" type="{kind}">'
            f'<origin xyz=".1 {0.2 * k} .3" rpy="{0.4 - k} {0.1 * k} 1.2"/>'
            f'<axis xyz="{0.6 - 0.6 * k} {0.2 * k} .8"/><parent link="{parent}"/>'
            f'<child link="l{k}"/>'
            '<limit lower="-2" upper="2" velocity="1" effort="1"/></joint>'
        )
        parent = f"l{k}"
    return text + "</robot>"


def robot_differences(folder: Path, q: Array) -> dict[str, float]:
    """How far solids of each link reach another way than pinocchio's [m].

    Args:
        folder: For the robot's files.
        q: Of the three joints, shape (3,) [rad or m].
    """
    files, text = mesh_files(), _urdf()
    (folder / "cell").mkdir(exist_ok=True)
    for name, data in files.items():
        (folder / "cell" / name).write_bytes(data)
    description = parse_urdf(text)
    named = {_PACKAGE + name: data for name, data in files.items()}
    robot = robot_geometry.robot_geometry(serial_chain(description), description, named)
    ours = _reaches_of_table(PairTable.of(robot, scene.Scene(), 0.0), q)
    theirs = _reaches_of_pinocchio(folder, text, q)
    assert ours.keys() == theirs.keys()
    return {name: float(np.abs(ours[name] - theirs[name]).max()) for name in ours}


def _reaches_of_table(table: PairTable, q: Array) -> dict[str, Array]:
    """How far all that belongs to a name reaches along the directions, by the proof's own table."""
    arrays, robot = table.arrays, table.robot
    frames = np.concatenate([np.eye(4)[None], joint_frames(robot.chain, q)])
    found: dict[str, Array] = {}
    for e in np.flatnonzero(np.diff(arrays.below) == 0).tolist():
        name = (robot.links if e < arrays.moving else table.scene.ids)[arrays.parts[e]]
        joint = int(arrays.joints[e]) if e < arrays.moving else -1
        T = frames[joint + 1] @ arrays.poses[e]
        radius, half, rounding = arrays.sizes[e]
        if arrays.kinds[e] == PieceKind.CYLINDER:
            reach = _cylinder_reach(T, radius, half)
        else:
            corners = arrays.columns[:, arrays.starts[e] : arrays.starts[e + 1]].T
            reach = _reach(corners @ T[:3, :3].T + T[:3, 3]) + rounding
        found[name] = np.maximum(found.get(name, -np.inf), reach)
    return found


def _reaches_of_pinocchio(folder: Path, text: str, q: Array) -> dict[str, Array]:
    (folder / "cell.urdf").write_text(text)
    model = pin.buildModelFromXML(text)
    geometry = pin.buildGeomFromUrdf(
        model, str(folder / "cell.urdf"), pin.GeometryType.COLLISION, package_dirs=[str(folder)]
    )
    data, placed = model.createData(), pin.GeometryData(geometry)
    full = np.array([q[0], q[1], np.cos(q[2]), np.sin(q[2])])
    pin.updateGeometryPlacements(model, data, geometry, placed, full)
    found: dict[str, Array] = {}
    for body, pose in zip(geometry.geometryObjects, placed.oMg, strict=True):
        name, T = model.frames[body.parentFrame].name, pose.homogeneous
        solid = body.geometry
        if isinstance(solid, coal.Cylinder):
            reach = _cylinder_reach(T, solid.radius, solid.halfLength)
        elif isinstance(solid, coal.Sphere):
            reach = _reach(T[None, :3, 3]) + solid.radius
        elif isinstance(solid, coal.Box):
            reach = _reach(_corners(2.0 * np.array(solid.halfSide)) @ T[:3, :3].T + T[:3, 3])
        else:
            reach = _reach(np.array(solid.vertices()) @ T[:3, :3].T + T[:3, 3])
        found[name] = np.maximum(found.get(name, -np.inf), reach)
    return found


def _reach(points: Array) -> Array:
    return np.asarray((points @ DIRECTIONS.T).max(axis=0))


def _corners(size: Array) -> Array:
    return np.asarray(
        0.5 * size * np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    )


def _cylinder_reach(T: Array, radius: float, half: float) -> Array:
    along = DIRECTIONS @ T[:3, 2]
    across = np.sqrt(np.maximum(1.0 - along**2, 0.0))
    return np.asarray(DIRECTIONS @ T[:3, 3] + half * np.abs(along) + radius * across)


def scene_differences(seed: int) -> dict[str, float]:
    """How far obstacles reach another way than trimesh, scipy and numpy say [m].

    Args:
        seed: Of their places.
    """
    random = np.random.default_rng(seed)
    obstacles, expected = list[scene.Obstacle](), dict[str, Array]()
    for name, pose, T in _poses(random):
        for kind, shape, points in _solids(random):
            obstacle = f"{kind} at {name}"
            obstacles.append(scene.Obstacle(obstacle, shape, pose))
            expected[obstacle] = _reach(points @ T[:3, :3].T + T[:3, 3])
    read, more = _moveit_scene(random)
    ours = _reaches_of_scene(scene.Scene(obstacles))
    ours |= _reaches_of_scene(moveit.scene_from_moveit(read))
    expected |= more
    assert ours.keys() == expected.keys()
    return {name: float(np.abs(ours[name] - expected[name]).max()) for name in ours}


def _reaches_of_scene(around: scene.Scene) -> dict[str, Array]:
    """``_reaches_of_table`` of obstacles alone."""
    text = (
        '<robot name="one"><link name="base"/><link name="tool"><collision><geometry>'
        '<sphere radius=".01"/></geometry></collision></link><joint name="j" type="revolute">'
        '<parent link="base"/><child link="tool"/><limit lower="-1" upper="1" velocity="1" '
        'effort="1"/></joint></robot>'
    )
    description = parse_urdf(text)
    robot = robot_geometry.robot_geometry(serial_chain(description), description)
    reaches = _reaches_of_table(PairTable.of(robot, around, 0.0), np.zeros(1))
    del reaches["tool"]
    return reaches


def _poses(random: np.random.Generator) -> Iterator[tuple[str, Array, Array]]:
    """A pose as it is given, and the rigid motion that it means, each by its name."""
    for digits, of_matrix in ((3, 7), (6, 9), (16, 16)):
        place = random.uniform(-1.0, 1.0, 3)
        given = random.normal(size=4)
        quaternion = np.asarray(np.round(given / np.linalg.norm(given), digits))
        meant = transform(Rotation.from_quat(quaternion).as_matrix(), place)
        yield f"quaternion of {digits} digits", transform(from_quaternion(quaternion), place), meant
        matrix: Array = np.eye(4)
        matrix[:3, :3] = np.round(Rotation.random(random_state=random).as_matrix(), of_matrix)
        matrix[:3, 3] = place
        nearest = scipy.linalg.polar(matrix[:3, :3])[0]
        yield f"matrix of {of_matrix} digits", matrix, transform(nearest, place)


def _solids(random: np.random.Generator) -> Iterator[tuple[str, shapes.Shape, Array]]:
    """Shapes, and points that they reach as far as."""
    size = random.uniform(0.1, 0.5, 3)
    yield "box", shapes.Box(size), _corners(size)
    # Whoever shows robots obeys the unit of a COLLADA file; coal leaves that to the caller.
    thin = {"thin.dae": written('<unit name="mm" meter="0.001"/>')}
    for name, data in (mesh_files() | thin).items():
        kind, scale = name.rpartition(".")[2], random.uniform(0.5, 2.0, 3)
        made = shapes.Mesh(*mesh.scaled(*mesh.load_mesh(data, kind), scale.tolist()))
        yield name, made, scale * _points_of(name, data)


def _points_of(name: str, data: bytes) -> Array:
    """Corners of a mesh file, by trimesh and by coal."""
    kind = name.rpartition(".")[2]
    if kind == "dae":
        metres = 1.0 if name == "body.dae" else 1e-3
        return metres * np.array([[5.0, 0, 0], [5, 2, 0], [3, 0, 0], [5, 0, 2]])
    if name == "squares.obj":
        return np.array([[x, y, z] for x in (0, 0.2) for y in (0, 0.3) for z in (0, 0.1)])
    read = trimesh.load(trimesh.util.wrap_as_stream(data), file_type=kind, force="mesh")
    return np.array(read.vertices)


def _moveit_scene(random: np.random.Generator) -> tuple[str, Mapping[str, Array]]:
    """The text of a planning scene, JSON being YAML, and how far its objects reach."""
    objects, expected = list[object](), dict[str, Array]()
    for k in range(4):
        outer, inner = (_moveit_pose(random) for _ in range(2))
        T = outer[1] @ inner[1]
        size = random.uniform(0.1, 0.4, 3)
        body, name = ell(0.3), f"object {k}"
        solid = {"primitives": [{"type": "box", "dimensions": size.tolist()}]}
        solid["primitive_poses"] = [inner[0]]
        points = _corners(size)
        if k % 2:
            vertices = body.vertices.tolist()
            solid = {"meshes": [{"vertices": vertices, "triangles": body.faces.tolist()}]}
            solid["mesh_poses"] = [inner[0]]
            points = np.array(body.vertices)
        objects.append({"id": name, "pose": outer[0], **solid})
        expected[name] = _reach(points @ T[:3, :3].T + T[:3, 3])
    return json.dumps({"name": "s", "world": {"collision_objects": objects}}), expected


def _moveit_pose(random: np.random.Generator) -> tuple[dict[str, list[float]], Array]:
    """A pose as tools write it, and what it means by scipy."""
    quaternion, place = Rotation.random(random_state=random).as_quat(), random.uniform(-1, 1, 3)
    given = {"position": place.tolist(), "orientation": quaternion.tolist()}
    return given, transform(Rotation.from_quat(quaternion).as_matrix(), place)
