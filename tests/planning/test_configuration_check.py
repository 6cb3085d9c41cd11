"""Checks of configurations, against coal and by hand."""

from collections.abc import Iterator

import coal
import numpy as np
import pinocchio
import pytest

from kinematics.arrays import Array
from kinematics.pose import transform
from kinematics.robots import builtin_urdf
from obstacles.collision.fcl_distance import Clearance, FclWorld
from obstacles.scenes.scene import Obstacle, Scene
from obstacles.shapes.shape import Sphere
from planning.configuration_check import configuration_checker
from tests.planning.scenes import HOME, builtin

BALL = np.array([0.5, 0.1, 0.75])


def ball(radius: float, margin: float = 0.0) -> Scene:
    T = transform(None, BALL)
    return Scene((Obstacle("ball", Sphere(radius), T, margin),))


def links_in_the_ball(q: Array, radius: float) -> set[str]:
    """Moving links that overlap the ball, by pinocchio and coal."""
    urdf = builtin_urdf("panda")
    model = pinocchio.buildModelFromXML(urdf)
    geometry = pinocchio.buildGeomFromUrdfString(model, urdf, pinocchio.GeometryType.COLLISION)
    data, placed = model.createData(), geometry.createData()
    pinocchio.updateGeometryPlacements(model, data, geometry, placed, q)
    at = coal.Transform3s(np.eye(3), BALL)
    hit = set()
    for item, M in zip(geometry.geometryObjects, placed.oMg, strict=True):
        where = coal.Transform3s(M.rotation, M.translation)
        result = coal.CollisionResult()
        request = coal.CollisionRequest()
        coal.collide(item.geometry, where, coal.Sphere(radius), at, request, result)
        if result.isCollision() and item.parentJoint > 0:
            hit.add(model.frames[item.parentFrame].name)
    return hit


@pytest.mark.parametrize("seed", range(40))
def test_obstacle_collisions_are_those_of_coal(seed: int) -> None:
    panda = builtin("panda")
    rng = np.random.default_rng(seed)
    limits = panda.chain.limits
    q = rng.uniform(limits.lower, limits.upper)
    scene = ball(0.15)
    report = configuration_checker(panda, scene).check(q)
    found = {name for c in report.collisions for name in c.pair if "ball" in c.pair} - {"ball"}
    assert found == links_in_the_ball(q, 0.15)


def test_margins_decide_validity_but_not_the_clearance() -> None:
    panda = builtin("panda")
    q = HOME
    free = configuration_checker(panda, ball(0.05)).check(q)
    assert free.valid
    gap = free.clearance
    far = Scene((Obstacle("ball", Sphere(0.05), ball(0.05).obstacles[0].T_world_obstacle, 10.0),))
    near = configuration_checker(panda, far).check(q)
    assert near.clearance == gap
    assert not near.valid
    assert not near.collisions
    assert not configuration_checker(panda, ball(0.05), 10.0).check(q).valid


def test_limits_are_reported_with_the_one_that_is_exceeded() -> None:
    panda = builtin("panda")
    q = panda.chain.limits.upper.copy()
    q[2] += 0.1
    q[3] = panda.chain.limits.lower[3] - 0.2
    report = configuration_checker(panda, Scene()).check(q)
    told = {v.joint: (v.value, v.limit) for v in report.limit_violations}
    assert told == {
        "panda_joint3": (q[2], panda.chain.limits.upper[2]),
        "panda_joint4": (q[3], panda.chain.limits.lower[3]),
    }
    assert not report.valid


@pytest.mark.parametrize("depth", [1e-4, 1e-3, 5e-3])
def test_a_ball_that_is_larger_than_its_gap_is_as_deep_as_the_difference(depth: float) -> None:
    panda = builtin("panda")
    radius = 0.02
    while "ball" not in (
        (small := configuration_checker(panda, ball(radius)).check(HOME)).clearance_pair or ()
    ):
        radius += 0.005
    large = configuration_checker(panda, ball(radius + small.clearance + depth)).check(HOME)
    assert large.collisions[0].pair == small.clearance_pair
    assert large.collisions[0].depth == pytest.approx(depth, abs=1e-6)
    assert large.clearance == -large.collisions[0].depth


def test_what_the_checker_finds_touching_is_not_free_whatever_fcl_says(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    checker = configuration_checker(builtin("panda"), ball(0.15))
    found = next(q for q in _states() if checker.check(q).collisions)
    monkeypatch.setattr(FclWorld, "collisions", lambda *_: [])
    monkeypatch.setattr(FclWorld, "clearance", lambda *_: Clearance(0.05, ("nobody", "nothing")))
    report = checker.check(found)
    assert not report.valid
    assert report.clearance <= 0.0
    assert [collision.pair for collision in report.collisions] == [report.clearance_pair]
    assert report.clearance_pair == checker.bare.clearance(found)[1]


def _states() -> Iterator[Array]:
    limits, random = builtin("panda").chain.limits, np.random.default_rng(5)
    while True:
        yield random.uniform(limits.lower, limits.upper)
