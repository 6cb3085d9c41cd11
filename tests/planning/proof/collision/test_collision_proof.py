"""Collisions of whole motions, and how deep allowed pairs overlap."""

from typing import Any

import coal
import numpy as np
import pinocchio
import pytest
import trimesh

import armwright as aw
from kinematics.arrays import Array
from kinematics.pose import transform
from kinematics.robots import builtin_urdf
from kinematics.trajectory.trajectory import Trajectory
from kinematics.tree.serial_chain import serial_chain
from kinematics.urdf.urdf import parse_urdf
from obstacles.robots.robot_geometry import RobotGeometry, robot_geometry
from obstacles.scenes.scene import Obstacle, Scene
from obstacles.shapes.shape import Sphere
from planning.proof.certificate import Certificate, certify
from planning.proof.collision import collision_proof
from planning.proof.collision.collision_proof import CollisionProof
from planning.proof.collision.pair_table import PairTable
from tests.obstacles.arms import mesh_shape
from tests.obstacles.collision.test_fcl_distance import slide
from tests.obstacles.distance.triangles.test_distance import apart
from tests.obstacles.meshes.test_decomposition import ring
from tests.obstacles.solids import random_transform
from tests.planning.scenes import HOME, builtin

#: A ring whose hole has a radius of 0.398 m at least; what covers it leaves less.
ROBOT = slide(*mesh_shape(ring()).pieces())
#: Radius of a ball that has nearly three centimetres to spare there [m].
RADIUS = 0.37


def along(start: float, end: float) -> Trajectory:
    """A slide along x in a second."""
    rates = np.array([[[start, end - start]]])
    return Trajectory(ROBOT.chain.joint_names, np.array([0.0, 1.0]), rates)


def ball(x: float, y: float, z: float, radius: float = RADIUS) -> Scene:
    return Scene((Obstacle("ball", Sphere(radius), transform(None, [x, y, z])),))


@pytest.fixture
def tables(monkeypatch: pytest.MonkeyPatch) -> list[int | None]:
    """How many covers are opened in each table that is made, None for all."""
    made: list[int | None] = []
    original = PairTable.of

    def recorded(*arguments: Any) -> PairTable:
        opened = arguments[3]
        made.append(None if opened is None else len(opened))
        return original(*arguments)

    monkeypatch.setattr(PairTable, "of", recorded)
    return made


def test_covers_that_stay_apart_prove_all_that_they_cover(tables: list[int | None]) -> None:
    certificate = certify(along(-0.1, 0.1), ROBOT, ball(0.0, 0.0, 3.0))
    assert certificate.verified
    assert tables == [0]
    assert certificate.cells > 0
    assert 0.05 <= certificate.min_clearance <= 3.0 - RADIUS


def test_in_the_hole_of_a_ring_its_triangles_decide(tables: list[int | None]) -> None:
    """The ball is inside of what covers the ring, and moves in the hole."""
    certificate = certify(along(-0.01, 0.01), ROBOT, ball(0.0, 0.0, 0.0))
    assert certificate.verified
    assert tables == [0, None]
    assert 0.0 < certificate.min_clearance <= 0.4 - RADIUS - 0.01


def test_a_ball_led_into_the_ring_is_found_when_it_touches(tables: list[int | None]) -> None:
    certificate = certify(along(0.0, 1.0), ROBOT, ball(0.0, 0.0, 0.0))
    assert tables == [0, None]
    violation = certificate.violation
    assert violation is not None
    assert violation.kind == "collision"
    sphere = trimesh.creation.icosphere(5, RADIUS)
    for before, touches in ((1e-3, False), (-1e-3, True)):
        at = transform(np.eye(3), [violation.time - before, 0.0, 0.0])
        assert (apart(ring(), at, sphere, np.eye(4)) == 0.0) is touches


def test_a_margin_inside_the_covers_is_kept_by_the_triangles(tables: list[int | None]) -> None:
    for margin, verified in ((0.01, True), (0.03, False)):
        tables.clear()
        certificate = certify(along(-0.01, 0.01), ROBOT, ball(0.0, 0.0, 0.0), margin=margin)
        assert certificate.verified is verified
        assert tables == [0, None]


def test_convex_robots_are_swept_once(tables: list[int | None]) -> None:
    robot = slide(*Sphere(0.05).pieces())
    assert certify(along(0.0, 1.0), robot, ball(0.0, 1.0, 0.0)).verified
    assert certify(along(0.0, 1.0), robot, ball(0.5, 0.0, 0.0)).violation is not None
    assert tables == [0, 0]


@pytest.mark.parametrize(("y", "made"), [(0.0, [0, None]), (3.0, [0])])
def test_a_mesh_of_the_scene_is_swept_as_a_cover_first(
    y: float, made: list[int | None], tables: list[int | None]
) -> None:
    scene = Scene((Obstacle("ring", mesh_shape(ring()), transform(None, [0.0, y, 0.0])),))
    assert certify(along(0.0, 0.01), slide(*Sphere(RADIUS).pieces()), scene).verified
    assert tables == made


def test_of_many_triangles_only_covers_that_do_not_stay_apart_are_opened(
    monkeypatch: pytest.MonkeyPatch, tables: list[int | None]
) -> None:
    """The ball meets what covers the ring on one side of its hole, and is led past it."""
    monkeypatch.setattr(collision_proof, "_FEW_TRIANGLES", 100)
    covers = len(mesh_shape(ring()).pieces())
    for reach, verified in ((0.36, True), (0.39, False)):
        tables.clear()
        scene = ball(reach * np.cos(0.4), reach * np.sin(0.4), 0.0, 0.02)
        motion = along(-0.01, 0.01)
        certificate = certify(motion, ROBOT, scene)
        assert certificate.verified is verified
        opened = [count for count in tables if count is not None]
        assert opened == sorted(set(opened))
        assert 0 < opened[-1] < covers
        whole = CollisionProof(motion, ROBOT, scene, 0.0, None)
        whole._start(None)
        assert not whole._run_once()
        assert (whole.violation is None) is verified
        if verified:
            assert certificate.min_clearance <= 0.02
            assert 0.5 <= certificate.min_clearance / min(whole.clearances) <= 2.0
        elif whole.violation is not None and certificate.violation is not None:
            assert certificate.violation.time == whole.violation.time


def test_the_last_sweep_opens_all_covers(
    monkeypatch: pytest.MonkeyPatch, tables: list[int | None]
) -> None:
    monkeypatch.setattr(collision_proof, "_FEW_TRIANGLES", 0)
    monkeypatch.setattr(collision_proof, "_MAX_SWEEPS", 2)
    assert certify(along(-0.01, 0.01), ROBOT, ball(0.0, 0.0, 0.0)).verified
    assert tables == [0, None]


PANDA = builtin("panda")


def depths_by_coal(solid: Any, T: Array, configurations: Array) -> dict[str, float]:
    """How deep each link of the Panda is in a solid at most, by pinocchio and coal."""
    urdf = builtin_urdf("panda")
    model = pinocchio.buildModelFromXML(urdf)
    geometry = pinocchio.buildGeomFromUrdfString(model, urdf, pinocchio.GeometryType.COLLISION)
    data, placed = model.createData(), geometry.createData()
    at, request = coal.Transform3s(T[:3, :3], T[:3, 3]), coal.DistanceRequest()
    request.enable_signed_distance = True
    deepest: dict[str, float] = {}
    for q in configurations:
        pinocchio.updateGeometryPlacements(model, data, geometry, placed, q)
        for item, M in zip(geometry.geometryObjects, placed.oMg, strict=True):
            where = coal.Transform3s(M.rotation, M.translation)
            d = coal.distance(item.geometry, where, solid, at, request, coal.DistanceResult())
            name = model.frames[item.parentFrame].name
            deepest[name] = max(deepest.get(name, 0.0), -d)
    return deepest


def told(certificate: Certificate) -> dict[tuple[str, str], float]:
    found = certificate.allowed_collisions
    return {item.pair: item.overlap for item in found if item.overlap is not None}


@pytest.mark.parametrize("seed", range(12))
def test_no_link_is_deeper_than_told_and_hardly_less_deep(seed: int) -> None:
    random = np.random.default_rng(seed)
    limits = PANDA.chain.limits
    start = random.uniform(limits.lower, limits.upper)
    goal = np.clip(start + random.uniform(-0.4, 0.4, 7), limits.lower, limits.upper)
    motion = aw.retime([start, goal], PANDA).trajectory
    size = random.uniform(0.05, 0.5, 3)
    shape, solid = [
        (aw.Box(size), coal.Box(*size)),
        (aw.Sphere(size[0]), coal.Sphere(size[0])),
        (aw.Cylinder(size[0], size[1]), coal.Cylinder(size[0], size[1])),
    ][seed % 3]
    T = random_transform(random)
    hand = aw.fk(PANDA, motion.sample([0.5 * motion.duration])[0])[:3, 3]
    T[:3, 3] = hand + random.uniform(-0.2, 0.2, 3)
    scene = aw.Scene([aw.Obstacle("thing", shape, T)], [(name, "thing") for name in PANDA.names])
    bounds = told(certify(motion, PANDA, scene))
    times = np.linspace(0.0, motion.duration, 150)
    judged = depths_by_coal(solid, T, motion.sample(times))
    touched = 0
    for name, depth in judged.items():
        bound = bounds[tuple(sorted((name, "thing")))]  # type: ignore[index]
        assert bound >= depth - 1e-6
        # Between two instants it may be a little deeper than at them.
        assert bound <= 1.1 * depth + 2e-4
        touched += depth > 1e-3
    assert touched


def sunk(depth: float, touch_depth: float) -> tuple[RobotGeometry, aw.Scene]:
    """The Panda holding a ball whose lowest point at HOME is a depth below a floor."""
    at = aw.fk(PANDA, HOME, "panda_hand") @ aw.pose([0.0, 0.0, 0.2])
    floor = aw.Obstacle("floor", aw.HalfSpace([0, 0, 1], at[2, 3] - 0.05 + depth))
    ball = aw.Obstacle("ball", aw.Sphere(0.05), aw.pose([0.0, 0.0, 0.2]))
    held = aw.Attachment(ball, "panda_hand", ("floor",), touch_depth)
    still = {(name, "floor"): aw.AllowedContact("request") for name in PANDA.names}
    holding = aw.hold(PANDA, aw.Scene([floor]), [held], still)
    return holding.robot, holding.scene


@pytest.mark.parametrize("seed", range(20))
def test_a_ball_may_be_as_deep_in_a_floor_as_touch_depth_says(seed: int) -> None:
    random = np.random.default_rng(seed)
    depth, limit = random.uniform(0.0, 0.04), random.uniform(0.0, 0.04)
    robot, scene = sunk(depth, limit)
    turned = HOME + np.array([0.7, 0, 0, 0, 0, 0, 0])
    # The arm turns about the vertical: the ball is as deep all along.
    motion = aw.retime([HOME, turned], PANDA).trajectory
    certificate = certify(motion, robot, scene)
    assert certificate.verified == (depth <= limit)
    bound = told(certificate)["ball", "floor"]
    assert depth - 1e-9 <= bound <= 1.05 * depth + 1e-4
    if depth > limit:
        assert certificate.violation is not None
        assert certificate.violation.details["pair"] == ["ball", "floor"]
        assert certificate.violation.details["depth"] == pytest.approx(depth, abs=1e-6)
        assert certificate.violation.details["touch_depth"] == limit
        assert not certificate.proved.collisions


def test_a_motion_is_refused_where_it_first_is_too_deep() -> None:
    robot, scene = sunk(-0.02, 0.001)
    down = HOME + np.array([0, 0.15, 0, 0, 0, 0, 0])
    motion = aw.retime([HOME, down], PANDA).trajectory
    violation = certify(motion, robot, scene).violation
    assert violation is not None
    q = motion.sample([violation.time])[0]
    lowest = (aw.fk(PANDA, q, "panda_hand") @ aw.pose([0.0, 0.0, 0.2]))[2, 3] - 0.05
    floor = scene.obstacles[0].shape
    assert isinstance(floor, aw.HalfSpace)
    assert floor.offset - lowest > 0.001
    assert certify(motion, *sunk(-0.02, np.inf)).verified


def test_all_pairs_are_told_whoever_allows_them() -> None:
    wall = aw.Obstacle("wall", aw.Box([0.1, 0.1, 0.1]), aw.pose([0.0, 0.9, 0.3]))
    crate = aw.Obstacle("crate", aw.Box([0.05, 0.05, 0.05]), aw.pose([0.0, 0.0, 0.2]))
    scene = aw.Scene([wall], [("panda_link5", "wall"), ("panda_link7", "panda_link4")])
    held = aw.Attachment(crate, "panda_hand", ("panda_link6",))
    holding = aw.hold(PANDA, scene, [held], [("crate", "wall")])
    motion = aw.retime([HOME, HOME + 0.1], PANDA).trajectory
    found = certify(motion, holding.robot, holding.scene).allowed_collisions
    assert {item.pair: item.reason for item in found if item.overlap is not None} == {
        ("panda_link5", "wall"): "scene",
        ("panda_link4", "panda_link7"): "scene",
        ("crate", "panda_link6"): "touch_links",
        ("crate", "wall"): "request",
        ("crate", "panda_hand"): "attached",
        ("crate", "panda_link7"): "same body",
    }
    # All that the robot allows itself are told too, neighbours without a depth.
    unmeasured = {item.pair: item.reason for item in found if item.overlap is None}
    assert unmeasured == dict(PANDA.allowed)


def test_what_stands_in_the_base_and_what_is_only_drawn_is_told_by_name() -> None:
    table = aw.Obstacle("table", aw.Box([1.0, 1.0, 0.1]), aw.pose([0.0, 0.0, -0.049]))
    apart = aw.Obstacle("apart", aw.Box([1.0, 1.0, 0.1]), aw.pose([0.0, 0.0, -0.3]))
    motion = aw.retime([HOME, HOME + 0.1], PANDA).trajectory
    certificate = certify(motion, PANDA, aw.Scene([table, apart]))
    assert certificate.verified
    (reason,) = certificate.proved.reasons
    assert "'table' touches 'panda_link0'" in reason
    # Where the scene allows it, it is told among the allowed pairs, with its depth.
    allowing = aw.Scene([table, apart], [("table", "panda_link0")])
    certificate = certify(motion, PANDA, allowing)
    assert certificate.proved.reasons == ()
    assert told(certificate)["panda_link0", "table"] == pytest.approx(0.001, abs=1e-4)
    text = """<robot name="r"><link name="a"><collision><geometry><box size="1 1 1"/></geometry>
        </collision></link><link name="b"><visual><geometry><box size="1 1 1"/></geometry></visual>
        </link><joint name="j" type="revolute"><parent link="a"/><child link="b"/>
        <limit lower="-1" upper="1" velocity="1" effort="1"/></joint></robot>"""
    assert [link.drawn for link in parse_urdf(text).links.values()] == [False, True]
    drawn = robot_geometry(serial_chain(parse_urdf(text)), parse_urdf(text), {})
    assert drawn.unseen == ("b",)
    motion = aw.retime([[0.0], [0.5]], drawn, limits={"acceleration": [1.0]}).trajectory
    (reason,) = certify(motion, drawn, aw.Scene()).proved.reasons
    assert reason.startswith("'b' is drawn and has no collision geometry")
