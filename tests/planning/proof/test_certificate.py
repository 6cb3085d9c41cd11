"""The certificate: what it proves holds, on convex links and on meshes, and what it refuses."""

import importlib.metadata
import io
import re
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
from kinematics.forward import forward
from kinematics.pose import transform
from kinematics.trajectory.trajectory import Trajectory, interpolate
from kinematics.tree.serial_chain import serial_chain
from kinematics.urdf.urdf import parse_urdf
from obstacles.collision.fcl_distance import FclWorld
from obstacles.robots.robot_geometry import RobotGeometry, hulled, robot_geometry
from obstacles.scenes.scene import Obstacle, Scene
from obstacles.shapes.shape import HalfSpace, Mesh, PointCloud
from planning.proof.certificate import certify
from planning.proof.limits.limits import check_limits
from planning.values.deadline import Deadline
from planning.values.limits import EffortLimits, MotionLimits
from tests.obstacles.arms import mesh_shape
from tests.obstacles.distance.triangles.test_distance import tube
from tests.obstacles.meshes.test_decomposition import ell, ring, room
from tests.obstacles.solids import random_transform
from tests.planning.dense import least_clearance
from tests.planning.scenes import HOME, box, builtin, pillar, shelf

NO_LIMITS = MotionLimits({q: np.full(2, np.inf) for q in ("velocity", "acceleration", "jerk")})


def cubic(robot: RobotGeometry, start: Array, end: Array, duration: float = 2.0) -> Trajectory:
    """Rest to rest along a straight line."""
    step = (end - start) / duration**2
    rows = [start, np.zeros_like(start), 3.0 * step, -2.0 * step / duration]
    coefficients = np.stack(rows, axis=-1)[None]
    return Trajectory(robot.chain.joint_names, np.array([0.0, duration]), coefficients)


@pytest.mark.parametrize("name", ["panda", "ur5e", "stanford", "scara", "planar_rr"])
def test_clearance_is_a_sharp_lower_bound(name: str) -> None:
    robot = builtin(name)
    lower, upper = robot.chain.sampling_bounds()
    random = np.random.default_rng(1)
    proved = refused = 0
    for _ in range(25):
        scene = pillar(random.uniform(-3.0, 3.0), random.uniform(0.3, 0.8))
        a, b = lower + random.uniform(0.1, 0.9, (2, robot.chain.n)) * (upper - lower)
        trajectory = cubic(robot, a, a + (b - a) * random.uniform(0.05, 0.5), 5.0)
        certificate = certify(trajectory, robot, scene)
        dense = least_clearance(trajectory, robot, scene, samples=400)
        if certificate.violation is None or certificate.violation.kind != "collision":
            proved += 1
            assert 0.0 < certificate.min_clearance <= dense + 1e-7
            assert certificate.min_clearance >= min(0.9 * dense, 0.179)
        else:
            refused += 1
            at = trajectory.sample([certificate.violation.time])[0]
            distance = FclWorld(robot, scene).clearance(at).distance
            assert distance <= 1e-6
    assert proved > 2


def test_points_of_a_cloud_take_no_more_cells_than_spheres() -> None:
    """Wherever the cloud's frame is: a witness is looked for where the points are."""
    robot = builtin("panda")
    lower, upper = robot.chain.sampling_bounds()
    random = np.random.default_rng(3)
    cells = np.zeros((2, 12))
    for k in range(12):
        points = random.uniform([0.2, -0.3, 0.2], [0.8, 0.3, 0.8], (20, 3))
        T = transform(None, random.uniform(-0.5, 0.5, 3))
        cloud = Scene((Obstacle("cloud", PointCloud(points - T[:3, 3], 0.01), T),))
        spheres = Scene(
            tuple(
                Obstacle(f"{i}", PointCloud(np.zeros((1, 3)), 0.01), transform(None, p))
                for i, p in enumerate(points)
            )
        )
        a, b = lower + random.uniform(0.1, 0.9, (2, robot.chain.n)) * (upper - lower)
        trajectory = cubic(robot, a, a + 0.3 * (b - a), 5.0)
        proofs = [certify(trajectory, robot, scene) for scene in (cloud, spheres)]
        cells[:, k] = [proof.cells for proof in proofs]
        assert proofs[0].min_obstacle_clearance == pytest.approx(
            proofs[1].min_obstacle_clearance, rel=0.25, abs=1e-6
        )
    assert cells.max() < 3000.0
    assert np.all(cells[0] <= 1.5 * cells[1] + 20.0)


def test_collision_between_coarse_samples_is_found() -> None:
    """A thin rod that an arm passes at speed: a look every tenth of a second misses it."""
    robot = builtin("planar_rr")
    trajectory = cubic(robot, np.array([-1.0, 0.0]), np.array([1.0, 0.0]), 1.0)
    missed = 0
    for angle in np.linspace(-0.9, 0.9, 40):
        rod = Scene((box("rod", (0.004, 0.5, 0.004), _around(robot, angle)),))
        certificate = certify(trajectory, robot, rod, limits=NO_LIMITS)
        assert certificate.violation is not None
        assert certificate.violation.kind == "collision"
        assert certificate.violation.details["pair"][1] == "rod"
        at = trajectory.sample([certificate.violation.time])[0]
        assert FclWorld(robot, rod).clearance(at).distance <= 1e-6
        missed += least_clearance(trajectory, robot, rod, samples=11) > 0.0
    assert missed > 5


def _around(robot: RobotGeometry, angle: float) -> tuple[float, float, float]:
    """A point that the stretched arm passes when its first joint is at ``angle``."""
    pose = forward(robot.chain, np.array([angle, 0.0]))
    center = robot.chain.offsets[0, :3, 3]
    point = center + 0.85 * (pose[:3, 3] - center)
    return float(point[0]), float(point[1]), float(point[2])


def test_margin_is_held_from_obstacles_not_between_links() -> None:
    robot = builtin("panda")
    trajectory = cubic(robot, HOME, HOME + 0.2)
    free = certify(trajectory, robot, Scene())
    assert free.verified
    floor = Scene((Obstacle("floor", HalfSpace(np.array([0.0, 0.0, 1.0]), 0.0)),))
    near = certify(trajectory, robot, floor)
    distance = near.min_clearance
    # The robot's own links are this close; a larger margin asks nothing of them.
    assert certify(trajectory, robot, Scene(), margin=10.0).verified
    to_floor = least_clearance(trajectory, robot, floor, margin=0.0)
    assert to_floor >= distance - 1e-7
    refused = certify(trajectory, robot, floor, margin=1.0)
    assert refused.violation is not None
    assert refused.violation.kind == "collision"
    assert refused.violation.details["margin"] == 1.0
    assert "m apart, 1 m are asked for" in refused.violation.message


def test_violations_say_overlap_where_solids_overlap() -> None:
    robot = builtin("planar_rr")
    trajectory = cubic(robot, np.array([0.0, 0.0]), np.array([0.1, 0.0]))
    post = Scene((box("post", (0.1, 0.1, 0.5), _around(robot, 0.05)),))
    certificate = certify(trajectory, robot, post, limits=NO_LIMITS)
    assert certificate.violation is not None
    overlap = re.search(r"overlap by ([0-9.]+) m at the start", certificate.violation.message)
    assert overlap is not None
    depth = FclWorld(robot, post).clearance(trajectory.start).distance
    assert float(overlap[1]) == pytest.approx(-depth, abs=1e-4)


def test_clearances_from_obstacles_and_of_the_robot_itself_are_told_apart() -> None:
    robot = builtin("panda")
    trajectory = cubic(robot, HOME, HOME + 0.2)
    alone = certify(trajectory, robot, Scene())
    assert alone.min_obstacle_clearance == np.inf
    assert alone.min_self_clearance == alone.min_clearance
    for height in (-0.3, -0.01):
        floor = Scene((Obstacle("floor", HalfSpace(np.array([0.0, 0.0, 1.0]), height)),))
        both = certify(trajectory, robot, floor)
        assert both.min_self_clearance == pytest.approx(alone.min_self_clearance, rel=0.3)
        least = min(both.min_obstacle_clearance, both.min_self_clearance)
        assert both.min_clearance == least
        assert both.clearance_pair is not None
        with_floor = "floor" in both.clearance_pair
        assert with_floor is (both.min_obstacle_clearance < both.min_self_clearance)


def test_limits_are_decided_by_exact_extrema() -> None:
    robot = builtin("panda")
    names = robot.chain.joint_names
    velocity = robot.chain.limits.velocity[0]
    # A cubic's top speed is 1.5 times its mean speed.
    for excess, expected in ((1e-6, False), (-1e-6, True)):
        duration = 1.5 * 0.5 / (velocity * (1.0 + excess))
        end = HOME.copy()
        end[0] += 0.5
        certificate = certify(
            cubic(robot, HOME, end, duration), robot, Scene(),
            limits=MotionLimits({"acceleration": np.full(7, np.inf), "jerk": np.full(7, np.inf)}),
        )  # fmt: skip
        assert certificate.verified is expected
        assert certificate.limits["velocity"].worst_ratio == pytest.approx(1.0 + excess, abs=1e-9)
        assert certificate.limits["velocity"].joint == names[0]
        assert certificate.limits["velocity"].time == pytest.approx(duration / 2.0)
        if not expected:
            assert certificate.violation is not None
            assert certificate.violation.kind == "velocity"
            assert certificate.violation.details["joint"] == names[0]


def test_position_limit_between_samples() -> None:
    robot = builtin("panda")
    upper = robot.chain.limits.upper[0]
    start = HOME.copy()
    start[0] = upper - 0.1
    coefficients = np.zeros((1, 7, 3))
    coefficients[0, :, 0] = start
    coefficients[0, 0, 1:] = [1.0, -1.0]  # out by 0.25 at half a second and back
    trajectory = Trajectory(robot.chain.joint_names, np.array([0.0, 1.0]), coefficients)
    certificate = certify(trajectory, robot, Scene())
    assert certificate.violation is not None
    assert certificate.violation.kind == "position"
    # It goes out where t - t^2 = 0.1.
    assert certificate.violation.time == pytest.approx(0.5 * (1.0 - 0.6**0.5))
    assert certificate.violation.details["value"] == pytest.approx(upper + 0.15)


def test_jumps_are_refused() -> None:
    robot = builtin("panda")
    coefficients = np.zeros((2, 7, 1))
    coefficients[0, :, 0] = HOME
    coefficients[1, :, 0] = HOME + 1e-3
    trajectory = Trajectory(robot.chain.joint_names, np.array([0.0, 1.0, 2.0]), coefficients)
    certificate = certify(trajectory, robot, Scene())
    assert certificate.violation is not None
    assert certificate.violation.kind == "continuity"
    assert certificate.violation.time == 1.0
    assert certificate.continuity["position"] == pytest.approx(1e-3)


def test_first_violation_in_time_is_named() -> None:
    robot = builtin("panda")
    end = HOME.copy()
    end[0] += 2.5
    scene = pillar(1.2, 0.33)
    slow = certify(cubic(robot, HOME, end, 20.0), robot, scene)
    assert slow.violation is not None
    assert slow.violation.kind == "collision"
    first = slow.violation.time
    trajectory = cubic(robot, HOME, end, 20.0)
    before = trajectory.split(first * 0.8)[0]
    assert certify(
        before, robot, scene, limits=MotionLimits({"velocity": np.full(7, np.inf)})
    ).verified


def test_limits_of_tool_speed_are_part_of_the_limits() -> None:
    robot = builtin("panda")
    motion = cubic(robot, HOME, HOME + 0.3)
    tool = forward(robot.chain, motion.sample(np.linspace(0.0, motion.duration, 2001)))[:, :3, 3]
    fastest = float(np.linalg.norm(np.diff(tool, axis=0), axis=1).max()) * 2000 / motion.duration
    for share, is_proved in ((1.01, True), (0.99, False)):
        asked = MotionLimits({}, EffortLimits(robot.chain, tool_speed=share * fastest))
        certificate = certify(motion, robot, Scene(), limits=asked)
        assert certificate.verified is is_proved
        assert certificate.limits["tool_speed"].worst_ratio == pytest.approx(1.0 / share, rel=2e-3)
        violation = certificate.violation
        assert is_proved or (violation is not None and violation.kind == "tool_speed")


def test_time_up_proves_nothing() -> None:
    robot = builtin("panda")
    certificate = certify(
        cubic(robot, HOME, HOME + 0.5), robot, shelf(), deadline=Deadline.after(-1.0)
    )
    assert not certificate.verified
    assert certificate.violation is not None
    assert certificate.violation.kind == "time"


@pytest.mark.parametrize("order", [0, 1, 2])
def test_a_broken_limit_is_told_when_it_is_first_broken(order: int) -> None:
    """Against a dense look at random quintics of several pieces, a later peak notwithstanding."""
    robot = builtin("panda")
    lower, upper = robot.chain.limits.lower, robot.chain.limits.upper
    random = np.random.default_rng(order)
    told = 0
    for _ in range(30):
        via = random.uniform(lower + 0.2, upper - 0.2, (6, 7))
        slopes = random.uniform(-3.0, 3.0, (6, 7))
        times = np.cumsum(random.uniform(0.5, 2.0, 6))
        motion = interpolate(robot.chain.joint_names, times - times[0], via, "cubic", slopes)
        bounds = {name: np.full(7, np.inf) for name in ("velocity", "acceleration", "jerk")}
        name = ("position", "velocity", "acceleration")[order]
        if order:
            bounds[name] = random.uniform(0.5, 1.0) * motion.peaks(order).value
        _, wrong, _ = check_limits(motion, robot.chain.limits, MotionLimits(bounds))
        first = [violation for violation in wrong if violation.kind == name]
        at = np.linspace(0.0, motion.duration, 20001)
        values = motion.sample(at, order)
        low, high = (lower, upper) if not order else (-bounds[name], bounds[name])
        out = ((values < low - 1e-6) | (values > high + 1e-6)).any(axis=1)
        assert bool(first) or not out.any()
        if out.any():
            told += 1
            dense = at[np.argmax(out)]
            assert dense - 2.0 * at[1] <= first[0].time <= dense + 1e-9
    assert told > 5


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
