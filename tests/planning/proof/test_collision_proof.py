"""Covers are swept before what they cover: fewer pairs, and never another verdict."""

from typing import Any

import numpy as np
import pytest
import trimesh

from kinematics.pose import transform
from kinematics.trajectory import Trajectory
from obstacles.scene import Obstacle, Scene
from obstacles.shapes import Sphere
from planning.proof.certificate import certify
from planning.proof.pair_table import PairTable
from tests.obstacles.test_decomposition import ring
from tests.obstacles.test_fcl_distance import slide
from tests.obstacles.test_mesh_distance import apart, mesh

#: A ring whose hole has a radius of 0.398 m at least; what covers it leaves less.
ROBOT = slide(*mesh(ring()).pieces())
#: Radius of a ball that has nearly three centimetres to spare there [m].
RADIUS = 0.37


def along(start: float, end: float) -> Trajectory:
    """A slide along x in a second."""
    rates = np.array([[[start, end - start]]])
    return Trajectory(ROBOT.chain.joint_names, np.array([0.0, 1.0]), rates)


def ball(x: float, y: float, z: float, radius: float = RADIUS) -> Scene:
    return Scene((Obstacle("ball", Sphere(radius), transform(None, [x, y, z])),))


@pytest.fixture
def tables(monkeypatch: pytest.MonkeyPatch) -> list[bool]:
    """Whether each table that is made holds triangles."""
    made: list[bool] = []
    original = PairTable.of

    def recorded(*arguments: Any, surfaces: bool = True) -> PairTable:
        made.append(surfaces)
        return original(*arguments, surfaces=surfaces)

    monkeypatch.setattr(PairTable, "of", recorded)
    return made


def test_covers_that_stay_apart_prove_all_that_they_cover(tables: list[bool]) -> None:
    certificate = certify(along(-0.1, 0.1), ROBOT, ball(0.0, 0.0, 3.0))
    assert certificate.verified
    assert tables == [False]
    assert certificate.cells > 0
    assert 0.05 <= certificate.min_clearance <= 3.0 - RADIUS


def test_in_the_hole_of_a_ring_its_triangles_decide(tables: list[bool]) -> None:
    """The ball is inside of what covers the ring, and moves in the hole."""
    certificate = certify(along(-0.01, 0.01), ROBOT, ball(0.0, 0.0, 0.0))
    assert certificate.verified
    assert tables == [False, True]
    assert 0.0 < certificate.min_clearance <= 0.4 - RADIUS - 0.01


def test_a_ball_led_into_the_ring_is_found_when_it_touches(tables: list[bool]) -> None:
    certificate = certify(along(0.0, 1.0), ROBOT, ball(0.0, 0.0, 0.0))
    assert tables == [False, True]
    violation = certificate.violation
    assert violation is not None
    assert violation.kind == "collision"
    sphere = trimesh.creation.icosphere(5, RADIUS)
    for before, touches in ((1e-3, False), (-1e-3, True)):
        at = transform(np.eye(3), [violation.time - before, 0.0, 0.0])
        assert (apart(ring(), at, sphere, np.eye(4)) == 0.0) is touches


def test_a_margin_inside_the_covers_is_kept_by_the_triangles(tables: list[bool]) -> None:
    for margin, verified in ((0.01, True), (0.03, False)):
        tables.clear()
        certificate = certify(along(-0.01, 0.01), ROBOT, ball(0.0, 0.0, 0.0), margin=margin)
        assert certificate.verified is verified
        assert tables == [False, True]


def test_convex_robots_are_swept_once(tables: list[bool]) -> None:
    robot = slide(*Sphere(0.05).pieces())
    assert certify(along(0.0, 1.0), robot, ball(0.0, 1.0, 0.0)).verified
    assert certify(along(0.0, 1.0), robot, ball(0.5, 0.0, 0.0)).violation is not None
    assert tables == [False, False]


@pytest.mark.parametrize(("y", "made"), [(0.0, [False, True]), (3.0, [False])])
def test_a_mesh_of_the_scene_is_swept_as_a_cover_first(
    y: float, made: list[bool], tables: list[bool]
) -> None:
    scene = Scene((Obstacle("ring", mesh(ring()), transform(None, [0.0, y, 0.0])),))
    assert certify(along(0.0, 0.01), slide(*Sphere(RADIUS).pieces()), scene).verified
    assert tables == made
