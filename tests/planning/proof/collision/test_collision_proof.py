"""Covers are swept before what they cover: fewer pairs, and never another verdict."""

from typing import Any

import numpy as np
import pytest
import trimesh

from kinematics.pose import transform
from kinematics.trajectory.trajectory import Trajectory
from obstacles.scenes.scene import Obstacle, Scene
from obstacles.shapes.shape import Sphere
from planning.proof.certificate import certify
from planning.proof.collision import collision_proof
from planning.proof.collision.collision_proof import CollisionProof
from planning.proof.collision.pair_table import PairTable
from tests.obstacles.arms import mesh_shape
from tests.obstacles.collision.test_fcl_distance import slide
from tests.obstacles.distance.triangles.test_distance import apart
from tests.obstacles.meshes.test_decomposition import ring

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
