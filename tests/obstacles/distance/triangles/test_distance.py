"""Meshes that are not convex against python-fcl on their triangles: distance, depth, motion."""

from dataclasses import replace
from functools import lru_cache
from typing import Any

import fcl
import numpy as np
import pytest
import trimesh

from kinematics.arrays import Array
from kinematics.forward import joint_frames
from kinematics.model.chain import Chain, Limits, Link
from kinematics.pose import from_axis_angle, inverse, transform
from obstacles.collision.checker import Checker, Motion
from obstacles.collision.fcl_distance import FclWorld
from obstacles.convex.piece import Piece
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.scenes.scene import Obstacle, Scene
from obstacles.shapes.shape import (
    Box,
    Capsule,
    Cylinder,
    HalfSpace,
    PointCloud,
    Shape,
    Sphere,
)
from tests.obstacles.arms import mesh_shape
from tests.obstacles.collision.test_fcl_distance import slide
from tests.obstacles.meshes.test_decomposition import (
    ell,
    lower_half,
    ring,
    room,
    spiky,
    table,
    windings,
)
from tests.obstacles.solids import random_transform

UNITS = 1e3


def tube() -> trimesh.Trimesh:
    return trimesh.creation.annulus(0.2, 0.25, 0.8, sections=24)


def bowl() -> trimesh.Trimesh:
    """Half a ball, hollow and open above: a surface without an inside."""
    return lower_half(trimesh.creation.icosphere(3, 0.5))


BODIES = {
    "ell": ell(0.8),
    "ring": ring(),
    "room": room(),
    "spiky": spiky(3),
    "table": table(),
    "tube": tube(),
    "bowl": bowl(),
    "plate": trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0.1, 0.1, 0], [0, 1, 0]],
                             [[0, 1, 3], [1, 2, 3], [0, 3, 4]]),
}  # fmt: skip


def solid_of(body: trimesh.Trimesh, T: Array) -> Any:
    vertices, faces = np.array(body.vertices), np.array(body.faces, dtype=np.int64)
    model = fcl_model(vertices.tobytes(), faces.tobytes())
    return fcl.CollisionObject(model, fcl.Transform(T[:3, :3], UNITS * T[:3, 3]))


@lru_cache(maxsize=32)
def fcl_model(vertices: bytes, faces: bytes) -> Any:
    """FCL's triangles of a body, by its vertices (k, 3) [m] and faces (m, 3): built once."""
    corners, rows = np.frombuffer(vertices).reshape(-1, 3), np.frombuffer(faces, dtype=np.int64)
    model = fcl.BVHModel()
    model.beginModel(len(corners), len(rows) // 3)
    model.addSubModel(UNITS * corners, rows.reshape(-1, 3))
    model.endModel()
    return model


def apart(a: trimesh.Trimesh, T_a: Array, b: trimesh.Trimesh, T_b: Array) -> float:
    """Distance of two surfaces by FCL, 0 where they touch or a body of one is inside the other."""
    one, other = solid_of(a, T_a), solid_of(b, T_b)
    if fcl.collide(one, other, fcl.CollisionRequest(), fcl.CollisionResult()):
        return 0.0
    for outer, T_o, inner, T_i in ((a, T_a, b, T_b), (b, T_b, a, T_a)):
        if outer.is_watertight:
            points = trimesh.transform_points(
                np.array(inner.vertices)[::7], np.linalg.inv(T_o) @ T_i
            )
            # Outside its box nothing winds about a point.
            low, high = outer.bounds
            points = points[((points > low) & (points < high)).all(axis=1)]
            if (np.abs(windings(points, np.array(outer.triangles))) > 0.5).any():
                return 0.0
    distance = fcl.distance(one, other, fcl.DistanceRequest(), fcl.DistanceResult())
    return max(float(distance), 0.0) / UNITS


def small(random: np.random.Generator) -> tuple[Shape, trimesh.Trimesh]:
    size = float(random.uniform(0.02, 0.4))
    kind = int(random.integers(3))
    if kind == 0:
        return Box(np.array([size, 0.5 * size, 0.2])), trimesh.creation.box([size, 0.5 * size, 0.2])
    if kind == 1:
        return mesh_shape(spiky(5)), spiky(5)
    body = ell(size)
    return mesh_shape(body), body


@pytest.mark.parametrize("name", BODIES)
def test_verdict_and_distance_are_those_of_the_triangles(name: str) -> None:
    body = BODIES[name]
    random = np.random.default_rng(7)
    touched = free = 0
    for k in range(24):
        shape, other = small(random)
        T = random_transform(random, 0.5)
        inner, outer = (mesh_shape(body), shape) if k % 2 else (shape, mesh_shape(body))
        robot, scene = slide(*inner.pieces()), Scene((Obstacle("it", outer, T),))
        at = np.zeros(1)
        own, still = (body, other) if k % 2 else (other, body)
        truth = apart(own, np.eye(4), still, T)
        checker, world = Checker.of(robot, scene), FclWorld(robot, scene)
        clearance, _ = checker.clearance(at)
        if truth > 1e-6:
            free += 1
            assert checker.valid(at)
            assert clearance == pytest.approx(truth, abs=2e-5)
            assert world.clearance(at).distance == pytest.approx(truth, abs=2e-5)
            assert not world.collisions(at)
        elif truth == 0.0:
            touched += 1
            assert not checker.valid(at)
            assert clearance <= 0.0
            assert world.collisions(at)
    assert touched > 2
    assert free > 1


def clearance_at(robot: RobotGeometry, obstacle: Obstacle, x: float) -> float:
    checker = Checker.of(robot, Scene((obstacle,)))
    at = np.array([x])
    clearance, _ = checker.clearance(at)
    assert checker.valid(at) is (clearance > 0.0)
    return clearance


@pytest.mark.parametrize("peg", [
    Sphere(0.05), Capsule(0.05, 0.3), Cylinder(0.05, 2.0), Box(np.array([0.05, 0.05, 3.0])),
    PointCloud(np.array([[0.0, 0.0, 0.1 * k] for k in range(-5, 6)]), 0.05),
    mesh_shape(ell(0.1, 0.03)),
])  # fmt: skip
def test_a_peg_in_a_ring_is_free_until_it_meets_the_ring(peg: Shape) -> None:
    for body, half in ((ring(), 0.4), (tube(), 0.2)):
        robot = slide(*mesh_shape(body).pieces())
        obstacle = Obstacle("peg", peg)
        assert clearance_at(robot, obstacle, 0.0) > 0.0
        assert clearance_at(robot, obstacle, half) <= 0.0
        checker = Checker.of(robot, Scene((obstacle,)))
        assert checker.free(np.array([-0.03]), np.array([0.03]))
        assert not checker.free(np.array([-2.0]), np.array([2.0]))
        motion = checker.segment(np.array([0.0]), np.array([2.0]))
        assert not motion.free


@pytest.mark.parametrize("inner", [
    Sphere(0.01), Box(np.array([0.02, 0.02, 0.02])), PointCloud(np.zeros((1, 3)), 1e-3),
    mesh_shape(ell(0.02)), Cylinder(0.01, 0.01),
])  # fmt: skip
def test_what_is_inside_without_touching_collides(inner: Shape) -> None:
    body = spiky(3)
    robot = slide(*mesh_shape(body).pieces())
    assert clearance_at(robot, Obstacle("in", inner), 0.0) <= 0.0
    assert FclWorld(robot, Scene((Obstacle("in", inner),))).collisions(np.zeros(1))
    held = slide(*inner.pieces())
    assert clearance_at(held, Obstacle("around", mesh_shape(body)), 0.0) <= 0.0
    assert FclWorld(held, Scene((Obstacle("around", mesh_shape(body)),))).collisions(np.zeros(1))
    checker = Checker.of(robot, Scene((Obstacle("in", inner),)))
    assert not checker.free(np.array([-1e-3]), np.array([1e-3]))


def test_a_room_is_free_inside() -> None:
    robot = slide(*Sphere(0.2).pieces())
    walls = Obstacle("room", mesh_shape(room()))
    for x in (0.0, 0.3, -0.69):
        assert clearance_at(robot, walls, x) == pytest.approx(0.7 - abs(x), abs=1e-7)
    assert clearance_at(robot, walls, 0.71) <= 0.0
    assert clearance_at(robot, walls, 0.95) <= 0.0
    assert clearance_at(robot, walls, 3.0) == pytest.approx(1.8, abs=1e-7)
    checker = Checker.of(robot, Scene((walls,)))
    assert checker.free(np.array([-0.6]), np.array([0.6]))
    assert not checker.free(np.array([0.0]), np.array([3.0]))


def test_margins_are_kept_from_triangles() -> None:
    robot = slide(*mesh_shape(ring()).pieces())
    for margin in (0.0, 0.1, 0.3):
        for asked in (0.0, 0.05):
            peg = Obstacle("peg", Sphere(0.05), margin=margin)
            checker = Checker.of(robot, Scene((peg,)), asked)
            clearance, _ = checker.clearance(np.zeros(1))
            left = 0.35 - margin - asked
            assert clearance == pytest.approx(left, abs=5e-3)
            assert checker.valid(np.zeros(1)) is (clearance > 0.0)


def test_a_floor_is_met_by_the_triangles_of_a_bowl() -> None:
    robot = slide(*mesh_shape(bowl()).pieces())
    for height in (-0.6, -0.51, -0.49, 0.1):
        floor = Obstacle("floor", HalfSpace(np.array([0.0, 0.0, 1.0]), height))
        clearance = clearance_at(robot, floor, 0.0)
        lowest = float(np.array(bowl().vertices)[:, 2].min())
        assert (clearance > 0.0) is (lowest > height)
        if clearance > 0.0:
            assert clearance == pytest.approx(lowest - height, abs=1e-7)


def test_gradients_are_those_of_the_nearest_triangles() -> None:
    robot = slide(*mesh_shape(ring()).pieces())
    checker = Checker.of(robot, Scene((Obstacle("peg", Sphere(0.05)),)))
    for x in (0.1, -0.2):
        near = checker.gradient(np.array([x]), 1.0)
        least = int(near.distances.argmin())
        assert near.distances[least] == pytest.approx(checker.clearance(np.array([x]))[0], abs=1e-7)
        step = 1e-6
        ahead = checker.clearance(np.array([x + step]))[0]
        behind = checker.clearance(np.array([x - step]))[0]
        slope = (ahead - behind) / (2.0 * step)
        assert near.gradients[least, 0] == pytest.approx(slope, abs=1e-3)


def depth(body: Shape, obstacle: Obstacle) -> float:
    """Of a body that stands at the origin."""
    pieces = body.pieces()
    robot = replace(slide(*pieces), solids=np.zeros(len(pieces), dtype=np.int64))
    world = FclWorld(robot, Scene((obstacle,)))
    (found,) = world.collisions(np.zeros(1))
    nearest = world.clearance(np.zeros(1))
    assert nearest.distance == -found.depth
    assert nearest.pair == found.pair
    return found.depth


def apart_once_moved(body: trimesh.Trimesh, by: Array, other: trimesh.Trimesh, T: Array) -> bool:
    return apart(body, transform(None, by), other, T) > 0.0


def directions(random: np.random.Generator, count: int) -> Array:
    u = random.normal(size=(count, 3))
    return np.asarray(u / np.linalg.norm(u, axis=1, keepdims=True))


@pytest.mark.parametrize("name", ["ell", "ring", "tube", "bowl", "plate"])
def test_no_random_way_out_is_much_shorter(name: str) -> None:
    body, random = BODIES[name], np.random.default_rng(17)
    looked = shorter = 0
    while looked < 4:
        shape, other = small(random)
        T = random_transform(random, 0.5)
        if apart(body, np.eye(4), other, T) > 0.0:
            continue
        looked += 1
        found = depth(mesh_shape(body), Obstacle("it", shape, T))
        for u in directions(random, 8):
            assert not apart_once_moved(body, 0.4 * found * u, other, T)
            shorter += apart_once_moved(body, 0.8 * found * u, other, T)
    assert shorter <= 1


def test_the_wall_of_a_bowl_is_not_as_deep_as_its_hollow() -> None:
    ball = trimesh.creation.icosphere(3, 0.1)
    for sunk in (1e-4, 0.004, 0.03):
        at = transform(None, [0.0, 0.0, -(0.4 + sunk)])
        told = depth(mesh_shape(bowl()), Obstacle("ball", Sphere(0.1), at))
        assert told == pytest.approx(sunk, rel=0.05, abs=2e-3)
        told = depth(mesh_shape(ball), Obstacle("bowl", mesh_shape(bowl()), inverse(at)))
        assert told == pytest.approx(sunk, rel=0.05, abs=2e-3)


def test_a_peg_against_the_inside_of_a_ring() -> None:
    inner = 0.4  # of a torus of radii 0.6 and 0.2, whose facets reach a little further out
    for sunk in (0.002, 0.02):
        at = transform(None, [inner + sunk - 0.05, 0.0, 0.0])
        assert depth(mesh_shape(ring()), Obstacle("peg", Sphere(0.05), at)) < sunk + 0.01


def test_what_lies_inside_has_to_come_out() -> None:
    body = spiky(3)
    told = depth(mesh_shape(body), Obstacle("in", Sphere(0.01)))
    assert told > 0.01
    for u in directions(np.random.default_rng(0), 40):
        ball = trimesh.creation.icosphere(2, 0.01)
        assert not apart_once_moved(body, 0.5 * told * u, ball, np.eye(4))


def torus() -> trimesh.Trimesh:
    """A ring of many triangles about the x axis."""
    body = trimesh.creation.torus(0.5, 0.1, major_sections=128, minor_sections=64)
    body.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2.0, [0.0, 1.0, 0.0]))
    return body


def motion_through(body: trimesh.Trimesh, height: float) -> Motion:
    """A ball with bumps is led through a body, that much off its axis."""
    peg = spiky(5)
    peg.apply_scale(0.1)
    scene = Scene((Obstacle("body", mesh_shape(body), transform(np.eye(3), [0.3, 0.0, height])),))
    checker = Checker.of(slide(*mesh_shape(peg).pieces()), scene)
    return checker.segment(np.array([-2.0]), np.array([2.0]))


@pytest.mark.parametrize("height", [0.25, 0.28, 0.3])
def test_a_long_motion_past_fine_meshes_costs_what_its_intervals_do(height: float) -> None:
    """Triangles that a long interval may reach are not searched for the nearest ones."""
    motion = motion_through(torus(), height)
    assert motion.free
    assert motion.intervals < 200


def test_a_long_motion_into_a_fine_mesh_is_refused_as_quickly() -> None:
    motion = motion_through(torus(), 0.36)
    assert motion.colliding
    assert motion.intervals < 200


@pytest.mark.parametrize("name", ["ell", "ring", "tube", "bowl"])
def test_motions_proved_free_keep_the_triangles_apart(name: str) -> None:
    """Edges of any length beside any pose, against FCL on the triangles, densely."""
    body = {"ell": ell(0.8), "ring": ring(), "tube": tube(), "bowl": bowl()}[name]
    peg = spiky(5)
    peg.apply_scale(0.12)
    random = np.random.default_rng(11)
    robot, kinds = slide(*mesh_shape(peg).pieces()), np.zeros(2, dtype=np.int64)
    for _ in range(18):
        T = random_transform(random, 0.25)
        a, b = np.sort(random.uniform(-0.8, 0.8, 2))
        checker = Checker.of(robot, Scene((Obstacle("it", mesh_shape(body), T),)))
        motion = checker.segment(np.array([a]), np.array([b]))
        places = np.linspace(a, b, 24)
        near = [apart(peg, transform(np.eye(3), [x, 0.0, 0.0]), body, T) for x in places]
        if motion.free:
            kinds[0] += 1
            assert min(near) > 0.0
        if motion.colliding:
            kinds[1] += 1
            at = transform(np.eye(3), [a + motion.at * (b - a), 0.0, 0.0])
            assert apart(peg, at, body, T) < 1e-6
        if min(near) == 0.0:
            assert not motion.free
    assert (kinds > 2).all()


def turning(*pieces: Piece) -> RobotGeometry:
    """Solids at the end of an arm of two joints, half a metre from each other."""
    two = np.array([1.0, 1.0])
    limits = Limits(-3.0 * two, 3.0 * two, two, two, two, two)
    links = (Link("base", -1, np.eye(4)), Link("hand", 1, np.eye(4)))
    second = transform(from_axis_angle(np.array([0.6, 0.0, 0.8]), 1.2), np.array([0.5, 0.0, 0.1]))
    chain = Chain(
        "turning", ("one", "two"), np.array([0, 0]), np.stack([np.eye(4), second]), links, "base",
        "hand", limits, np.zeros(2, dtype=bool),
    )  # fmt: skip
    own = tuple(p.placed(transform(np.eye(3), [0.5, 0.0, 0.0])) for p in pieces)
    numbers = np.arange(len(own))
    return RobotGeometry(chain, own, ("hand",) * len(own), 1 + 0 * numbers, numbers, {})


def hand_at(robot: RobotGeometry, q: Array) -> Array:
    return np.asarray(joint_frames(robot.chain, q)[1] @ transform(np.eye(3), [0.5, 0.0, 0.0]))


def test_turns_proved_free_keep_the_triangles_apart() -> None:
    """Parts of a mesh go less far than its farthest corner: what is proved of them holds, too."""
    body, peg = ring(), spiky(3)
    peg.apply_scale(0.2)
    robot, random = turning(*mesh_shape(peg).pieces()), np.random.default_rng(12)
    near_ones = colliding = 0
    for _ in range(40):
        q = random.uniform(-1.0, 1.0, 2)
        T = hand_at(robot, q) @ random_transform(random, 0.12)
        checker = Checker.of(robot, Scene((Obstacle("it", mesh_shape(body), T),)))
        end = q + random.uniform(-0.5, 0.5, 2)
        if not checker.valid(q):
            continue
        motion = checker.segment(q, end)
        if motion.free:
            states = q + np.linspace(0.0, 1.0, 16)[:, None] * (end - q)
            near = [apart(peg, hand_at(robot, state), body, T) for state in states]
            assert min(near) >= motion.clearance - 2e-5
            near_ones += min(near) < 0.03
        else:
            colliding += 1
            assert apart(peg, hand_at(robot, q + motion.at * (end - q)), body, T) < 1e-6
    assert near_ones > 2
    assert colliding > 3
