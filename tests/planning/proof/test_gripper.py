"""The proof of a gripper's motion, against FCL at many instants of it."""

from functools import cache

import fcl
import numpy as np
import pytest
from scipy.spatial import ConvexHull

import armwright as aw
from benchmarks.example_arms import ARMS
from kinematics.arrays import Array
from kinematics.forward import forward
from obstacles.finger_geometry import with_fingers
from obstacles.robot_geometry import RobotGeometry
from planning.deadline import Deadline
from planning.finger_motion import FingerMotion
from planning.proof.certificate import Certificate
from planning.proof.gripper import certify_gripper

_HOME = np.array([0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785])
_JOINT = "panda_finger_joint1"
_BAR = 0.02


@cache
def _panda() -> RobotGeometry:
    return ARMS["panda"].geometry({"acceleration": 10.0})


def _bar(y: float) -> aw.Scene:
    """A cube beside the finger tips, ``y`` along the way of the left one."""
    T = forward(_panda().chain, _HOME, "panda_hand_tcp") @ aw.pose([0.0, y, 0.0])
    return aw.Scene([aw.Obstacle("bar", aw.Box((_BAR,) * 3), T)])


def _motion(first: float, last: float, duration: float = 0.5) -> FingerMotion:
    return FingerMotion(_panda().fingers, {_JOINT: first}, {_JOINT: last}, duration)


def _proved(scene: aw.Scene, motion: FingerMotion, margin: float = 0.0) -> Certificate:
    return certify_gripper(motion, _panda(), scene, _HOME, margin=margin)


def _sampled(scene: aw.Scene, motion: FingerMotion) -> Array:
    """FCL's least distance of both fingers from the bar at 60 instants, shape (60,)."""
    chain, bar = _panda().chain, scene.obstacle("bar").T_world_obstacle
    solid = fcl.CollisionObject(fcl.Box(*(_BAR,) * 3), fcl.Transform(bar[:3, :3], bar[:3, 3]))
    trajectory = motion.trajectory
    least = []
    for values in trajectory.sample(np.linspace(0.0, motion.duration, 60)):
        robot = with_fingers(_panda(), {_JOINT: float(np.clip(values[0], 0.0, 0.04))})
        T_tip = forward(chain, _HOME) @ np.linalg.inv(chain.link(chain.tip_link).T_joint_link)
        distances = []
        for piece, link in zip(robot.pieces, robot.links, strict=True):
            if "finger" not in link:
                continue
            T = T_tip @ piece.T_owner_piece
            points = fcl.BVHModel()
            hull = aw.Mesh(*_hull(piece.vertices))
            points.beginModel(len(hull.faces), len(hull.vertices))
            points.addSubModel(hull.vertices, hull.faces)
            points.endModel()
            finger = fcl.CollisionObject(points, fcl.Transform(T[:3, :3], T[:3, 3]))
            distances.append(fcl.distance(finger, solid))
        least.append(min(distances))
    return np.array(least)


def _hull(vertices: Array) -> tuple[Array, Array]:
    return np.array(vertices), np.array(ConvexHull(vertices).simplices)


@pytest.mark.parametrize("y", [0.065, 0.0625, 0.08])
def test_a_proved_motion_is_clear_at_every_instant_and_by_no_less_than_is_told(y: float) -> None:
    scene, motion = _bar(y), _motion(0.0, 0.035)
    certificate, sampled = _proved(scene, motion), _sampled(scene, motion)
    assert certificate.verified
    assert certificate.proved.collisions
    assert certificate.obstacle_pair is not None
    assert 0.0 < certificate.min_obstacle_clearance <= sampled.min() + 1e-9
    assert "fingers" in certificate.method


@pytest.mark.parametrize(("first", "last"), [(0.0, 0.04), (0.04, 0.0)])
def test_a_finger_that_meets_something_on_its_way_is_told_with_its_time(
    first: float, last: float
) -> None:
    scene, motion = _bar(0.04), _motion(first, last)
    certificate, sampled = _proved(scene, motion), _sampled(scene, motion)
    assert sampled.min() <= 0.0
    violation = certificate.violation
    assert not certificate.verified
    assert violation is not None
    assert violation.kind == "collision"
    assert set(violation.details["pair"]) == {"panda_leftfinger", "bar"}
    touched = float(np.linspace(0.0, motion.duration, 60)[np.argmax(sampled <= 0.0)])
    assert violation.time == pytest.approx(touched, abs=0.03)


def test_margins_and_time_are_held_to() -> None:
    motion = _motion(0.0, 0.035)
    free = _proved(_bar(0.065), motion).min_obstacle_clearance
    assert _proved(_bar(0.065), motion, 0.5 * free).verified
    assert not _proved(_bar(0.065), motion, 0.02).verified
    late = certify_gripper(motion, _panda(), _bar(0.065), _HOME, deadline=Deadline.after(0.0))
    assert late.violation is not None
    assert late.violation.kind == "time"


@pytest.mark.parametrize(
    ("last", "duration", "kind"), [(0.05, 0.5, "position"), (0.04, 0.3, "velocity")]
)
def test_fingers_keep_their_own_limits(last: float, duration: float, kind: str) -> None:
    certificate = _proved(aw.Scene([]), _motion(0.0, last, duration))
    assert not certificate.verified
    assert not certificate.proved.limits
    assert certificate.violation is not None
    assert certificate.violation.kind == kind


def test_the_motion_is_from_rest_to_rest_and_its_time_is_that_of_its_share() -> None:
    motion = _motion(0.01, 0.03)
    trajectory = motion.trajectory
    assert trajectory.joint_names == (_JOINT, "panda_finger_joint2")
    ends = trajectory.sample([0.0, 0.5])
    np.testing.assert_allclose(ends, [[0.01, 0.01], [0.03, 0.03]], atol=1e-15)
    np.testing.assert_allclose(trajectory.sample([0.0, 0.5], 1), 0.0, atol=1e-12)
    for share in (0.0, 0.1, 0.5, 0.9, 1.0):
        at = trajectory.sample([motion.time_of(share)])[0, 0]
        assert at == pytest.approx(0.01 + 0.02 * share, abs=1e-9)
