"""Certificates of arms whose links are not convex, against FCL on their very triangles.

The judge shares nothing with the certificate: joints are moved by pinocchio, meshes are read by
trimesh and given to FCL as they are, motions are looked at every three milliradians.
"""

import importlib.metadata
import io
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import fcl
import numpy as np
import pinocchio as pin
import pytest
import trimesh

from kinematics.arrays import Array
from kinematics.pose import transform
from kinematics.trajectory.trajectory import Trajectory
from kinematics.tree.serial_chain import serial_chain
from kinematics.urdf.urdf import parse_urdf
from obstacles.robots.robot_geometry import RobotGeometry, hulled, robot_geometry
from obstacles.scenes.scene import Obstacle, Scene
from obstacles.shapes.shape import Mesh
from planning.proof.certificate import certify
from tests.obstacles.arms import mesh_shape
from tests.obstacles.distance.triangles.test_distance import tube
from tests.obstacles.meshes.test_decomposition import ell, ring, room
from tests.obstacles.solids import random_transform

#: Largest joint change between two looks [rad or m], and FCL's units in a metre.
STEP, UNITS = 3e-3, 1e3


def fork(width: float = 0.12, wall: float = 0.02, tall: float = 0.15) -> trimesh.Trimesh:
    """A U of one body: two prongs along z, open at the top, ``width`` apart on the inside."""
    half = 0.5 * width
    xs, zs = [-half - wall, -half, half, half + wall], [0.0, wall, tall]
    corners = np.array([[x, y, z] for y in (-0.03, 0.03) for z in zs for x in xs])

    def at(x: int, z: int, y: int) -> int:
        return 12 * y + 4 * z + x

    faces: list[list[int]] = []
    for x, z in ((0, 0), (1, 0), (2, 0), (0, 1), (2, 1)):
        a, b, c, d = ((x, z), (x + 1, z), (x + 1, z + 1), (x, z + 1))
        faces += [[at(*a, 0), at(*b, 0), at(*c, 0)], [at(*a, 0), at(*c, 0), at(*d, 0)]]
        faces += [[at(*a, 1), at(*c, 1), at(*b, 1)], [at(*a, 1), at(*d, 1), at(*c, 1)]]
    rim = [(0, 0), (1, 0), (2, 0), (3, 0), (3, 1), (3, 2), (2, 2), (2, 1), (1, 1), (1, 2), (0, 2),
           (0, 1)]  # fmt: skip
    for a, b in zip(rim, rim[1:] + rim[:1], strict=True):
        faces += [[at(*a, 0), at(*b, 1), at(*b, 0)], [at(*a, 0), at(*a, 1), at(*b, 1)]]
    return trimesh.Trimesh(corners, faces, process=False)


def bent(length: float) -> trimesh.Trimesh:
    """An L whose long leg runs along z."""
    bar = ell(length, 0.06)
    bar.apply_transform(transform(np.array([[0.0, 1, 0], [0, 0, 1], [1, 0, 0]]), [-0.03] * 3))
    return bar


FILES = {"fork.stl": fork(), "upper.stl": bent(0.35), "fore.stl": bent(0.3)}


def arm_text() -> str:
    """Three bent links and a fork, four joints without limits."""
    links = ["base", "turn", "upper", "fore", "hand"]
    meshes = {"turn": "upper.stl", "upper": "upper.stl", "fore": "fore.stl", "hand": "fork.stl"}
    text = '<robot name="bent">'
    for name in links:
        file = meshes.get(name)
        body = f'<collision><geometry><mesh filename="{file}"/></geometry></collision>'
        text += f'<link name="{name}">{body if file else ""}</link>'
    spots = [(0.1, "0 0 1"), (0.4, "0 1 0"), (0.4, "0 1 0"), (0.33, "0 0 1")]
    for k, (up, axis) in enumerate(spots):
        text += (
            f'<joint name="j{k}" type="revolute"><origin xyz="0 0 {up}"/><axis xyz="{axis}"/>'
            f'<parent link="{links[k]}"/><child link="{links[k + 1]}"/>'
            '<limit lower="-3.1" upper="3.1" velocity="1e3" effort="1"/></joint>'
        )
    return text + "</robot>"


def own_bytes(name: str) -> bytes:
    return bytes(FILES[name].export(file_type="stl"))


def cart() -> tuple[str, RobotGeometry]:
    """A bent bar on a slide: its URDF, and the robot."""
    text = (
        '<robot name="cart"><link name="rail"/><link name="cart"><collision><geometry>'
        '<mesh filename="upper.stl"/></geometry></collision></link>'
        '<joint name="slide" type="prismatic"><axis xyz="1 0 0"/><parent link="rail"/>'
        '<child link="cart"/><limit lower="-2" upper="2" velocity="9" effort="1"/></joint></robot>'
    )
    description = parse_urdf(text)
    return text, robot_geometry(serial_chain(description), description, own_bytes)


def real_bytes(uri: str) -> bytes:
    path = uri.removeprefix("package://example-robot-data/robots/")
    files = importlib.metadata.files("example-robot-data") or []
    found = next(file.locate() for file in files if file.as_posix().endswith(path))
    return Path(str(found)).read_bytes()


def ur5_text() -> str:
    text = real_bytes("ur_description/urdf/ur5_robot.urdf").decode()
    return text.replace('velocity="3.15"', 'velocity="1e3"').replace(
        'velocity="3.2"', 'velocity="1e3"'
    )


def bvh(solid: trimesh.Trimesh) -> Any:
    model = fcl.BVHModel()
    model.beginModel(len(solid.vertices), len(solid.faces))
    model.addSubModel(UNITS * np.array(solid.vertices), np.array(solid.faces))
    model.endModel()
    return fcl.CollisionObject(model)


class Judge:
    """An arm as triangles among others."""

    def __init__(
        self, text: str, read: Callable[[str], bytes], robot: RobotGeometry, scene: Scene
    ) -> None:
        self.model = pin.buildModelFromXML(text)
        self.data = self.model.createData()
        self.bodies = []
        for link in ElementTree.fromstring(text).findall("link"):
            name = link.attrib["name"]
            frame = self.model.getFrameId(name, pin.FrameType.BODY)
            for collision in link.findall("collision"):
                self.bodies.append((name, frame, *self._solid(collision, read)))
        joints = {link.name: link.joint for link in robot.chain.links}
        self.pairs = [
            (a[3], b[3])
            for i, a in enumerate(self.bodies)
            for b in self.bodies[:i]
            if tuple(sorted((a[0], b[0]))) not in robot.allowed and joints[a[0]] != joints[b[0]]
        ]
        self.moving = [body[3] for body in self.bodies if joints[body[0]] >= 0]
        self.around = []
        for obstacle in scene.obstacles:
            assert isinstance(obstacle.shape, Mesh)
            thing = bvh(trimesh.Trimesh(obstacle.shape.vertices, obstacle.shape.faces))
            T = obstacle.T_world_obstacle
            thing.setTransform(fcl.Transform(T[:3, :3], UNITS * T[:3, 3]))
            self.around.append(thing)
        self.pairs += [(body, thing) for body in self.moving for thing in self.around]

    @staticmethod
    def _solid(collision: ElementTree.Element, read: Callable[[str], bytes]) -> tuple[Array, Any]:
        mesh, box, T = collision.find("geometry/mesh"), collision.find("geometry/box"), np.eye(4)
        origin = collision.find("origin")
        if origin is not None:
            rpy, xyz = (
                [float(x) for x in origin.attrib.get(k, "0 0 0").split()] for k in ("rpy", "xyz")
            )
            T = transform(pin.rpy.rpyToMatrix(*rpy), xyz)
        if box is not None:
            sizes = [float(x) for x in box.attrib["size"].split()]
            return T, bvh(trimesh.creation.box(sizes))
        assert mesh is not None
        data = io.BytesIO(read(mesh.attrib["filename"]))
        return T, bvh(trimesh.load(data, file_type="stl", force="mesh"))

    def touches(self, q: Array) -> bool:
        """Whether any triangles meet."""
        pin.framesForwardKinematics(self.model, self.data, q)
        for _, frame, T, body in self.bodies:
            M = self.data.oMf[frame].homogeneous @ T
            body.setTransform(fcl.Transform(M[:3, :3], UNITS * M[:3, 3]))
        request = fcl.CollisionRequest()
        return any(fcl.collide(a, b, request, fcl.CollisionResult()) for a, b in self.pairs)

    def first_touch(self, motion: Trajectory) -> float | None:
        """When triangles meet first, of instants so close that no joint moves more than STEP."""
        fine = np.linspace(0.0, motion.duration, 400)
        fastest = np.abs(np.diff(motion.sample(fine), axis=0)).max() / fine[1]
        times = np.linspace(0.0, motion.duration, int(1.2 * fastest * motion.duration / STEP) + 2)
        return next(
            (float(t) for t, q in zip(times, motion.sample(times), strict=True) if self.touches(q)),
            None,
        )


def hollows(random: np.random.Generator, reach: float) -> Iterator[Obstacle]:
    """Rings, tubes, a room and bent bars about an arm."""
    for k, solid in enumerate(2 * (ring(), tube(), room(), ell(0.8))):
        small = solid.copy()
        small.apply_scale(0.6 / np.linalg.norm(small.extents))
        T = random_transform(random, 0.0)
        turn, away = random.uniform(-np.pi, np.pi), reach * random.uniform(0.5, 1.0)
        T[:3, 3] = away * np.cos(turn), away * np.sin(turn), reach * random.uniform(0.0, 0.8)
        yield Obstacle(f"thing{k}", mesh_shape(small), T)


def motion_from(robot: RobotGeometry, q: Array, random: np.random.Generator) -> Trajectory:
    """A cubic that goes away from q by up to 0.9 rad in every joint."""
    c = np.zeros((1, robot.chain.n, 4))
    c[0, :, 0] = q
    c[0, :, 1:] = random.uniform(-0.3, 0.3, (robot.chain.n, 3))
    return Trajectory(robot.chain.joint_names, np.array([0.0, 1.0]), c)


ARMS = {
    "bent": (arm_text, own_bytes, "hand", 0.9, 6),
    "ur5": (ur5_text, real_bytes, "tool0", 0.7, 4),
}


@pytest.mark.parametrize("name", ARMS)
def test_what_is_certified_is_free_by_the_triangles(name: str) -> None:
    """And what collides by them at any instant that is looked at is never certified."""
    write, read, tip, reach, scenes = ARMS[name]
    text, random = write(), np.random.default_rng(23)
    description = parse_urdf(text)
    robot = robot_geometry(serial_chain(description, tip_link=tip), description, read)
    certified = refused = 0
    for _ in range(scenes):
        scene = Scene(tuple(hollows(random, reach)))
        judge = Judge(text, read, robot, scene)
        tried = random.uniform(-2.1, 2.1, (40, robot.chain.n))
        for q in [q for q in tried if not judge.touches(q)][:4]:
            motion = motion_from(robot, q, random)
            proof, met = certify(motion, robot, scene), judge.first_touch(motion)
            assert proof.verified is (met is None)
            certified += proof.verified
            if met is None:
                continue
            refused += 1
            assert proof.violation is not None
            assert proof.violation.kind == "collision"
            assert proof.violation.time <= met + 1e-9
            # What was touched before the instants that are looked at, was so just before.
            assert met - proof.violation.time < 0.05
    assert certified > 4
    assert refused > 1


@pytest.mark.parametrize("spare", [2e-3, 2e-4, 2e-5])
def test_a_fork_that_grazes_along_a_rail_is_certified(spare: float) -> None:
    """Its prongs reach around a bar, all of which is in the fork's hull."""
    text = (
        '<robot name="cart"><link name="rail"/><link name="cart"><collision><geometry>'
        '<mesh filename="fork.stl"/></geometry></collision></link>'
        '<joint name="slide" type="prismatic"><axis xyz="0 1 0"/><parent link="rail"/>'
        '<child link="cart"/><limit lower="-2" upper="2" velocity="9" effort="1"/></joint></robot>'
    )
    description = parse_urdf(text)
    robot = robot_geometry(serial_chain(description), description, own_bytes)
    bar = trimesh.creation.box([0.12 - 2.0 * spare, 1.0, 0.1])
    for aside, floor in ((0.0, 0.02), (0.9 * spare, 0.02), (1.1 * spare, 0.02), (0.0, 0.0)):
        T = transform(None, [aside, 0.0, 0.05 + floor + (spare if floor else -spare)])
        scene = Scene((Obstacle("bar", mesh_shape(bar), T),))
        along = Trajectory(("slide",), np.array([0.0, 1.0]), np.array([[[-0.4, 0.8]]]))
        judge = Judge(text, own_bytes, robot, scene)
        proof = certify(along, robot, scene)
        assert proof.verified is (aside < spare and floor > 0.0)
        assert proof.verified is (judge.first_touch(along) is None)
        assert not certify(along, hulled(robot), scene).verified
        if proof.verified:
            least = spare - aside
            # Where covers keep a millimetre, that may be told.
            assert min(0.7 * least, 8e-4) <= proof.min_clearance <= least + 1e-7


def test_a_wall_thinner_than_a_step_is_not_passed() -> None:
    """A tube of a tenth of a millimetre: a peg inside moves in it, and never through it."""
    text, robot = cart()
    sheet = trimesh.creation.annulus(0.5, 0.5001, 1.5, sections=48)
    open_sheet = trimesh.Trimesh(sheet.vertices, sheet.faces[::2], process=False)
    for solid in (sheet, open_sheet):
        scene = Scene((Obstacle("tube", mesh_shape(solid), transform(None, [0.0, 0.0, 0.2])),))
        for ends, free in (((-0.1, 0.1), True), ((0.9, 1.9), True), ((0.0, 1.5), False)):
            line = np.array([[[ends[0], ends[1] - ends[0]]]])
            motion = Trajectory(("slide",), np.array([0.0, 1.0]), line)
            proof = certify(motion, robot, scene)
            if solid is sheet:
                assert proof.verified is free
            judge = Judge(text, own_bytes, robot, scene)
            assert proof.verified is (judge.first_touch(motion) is None)
