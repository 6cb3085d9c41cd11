"""Meshes that are not convex, as robots and as obstacles, against python-fcl on their triangles.

FCL knows surfaces only; what lies inside without touching is found by solid angles, in numpy.
"""

from functools import lru_cache
from typing import Any

import fcl
import numpy as np
import pytest
import trimesh

from kinematics.arrays import Array
from obstacles.collision.checker import Checker
from obstacles.collision.fcl_distance import FclWorld
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
