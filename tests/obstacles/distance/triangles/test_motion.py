"""Motion of meshes past each other: proved shares hold, and cost no more than intervals do."""

import numpy as np
import pytest
import trimesh

from kinematics.arrays import Array
from kinematics.forward import joint_frames
from kinematics.model.chain import Chain, Limits, Link
from kinematics.pose import from_axis_angle, transform
from obstacles.collision.checker import Checker, Motion
from obstacles.convex.piece import Piece
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.scenes.scene import Obstacle, Scene
from tests.obstacles.arms import mesh_shape
from tests.obstacles.collision.test_fcl_distance import slide
from tests.obstacles.distance.triangles.test_distance import apart, bowl, tube
from tests.obstacles.meshes.test_decomposition import ell, ring, spiky
from tests.obstacles.solids import random_transform


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
