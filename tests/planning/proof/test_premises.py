"""Premises of proofs: hashes by content, what they tell apart, and what texts say of them."""

import hashlib
from dataclasses import replace

import numpy as np
import pytest

from kinematics.trajectory.interpolation import interpolate
from kinematics.trajectory.trajectory import Trajectory
from obstacles.robots.attachment import Attachment, hold
from obstacles.robots.finger_geometry import with_fingers
from obstacles.scenes.scene import Obstacle, Scene
from obstacles.shapes.shape import Box, Sphere
from planning.proof.certificate import certify, certify_limits
from planning.proof.premises import Premises
from planning.values.limits import MotionLimits
from tests.planning.scenes import HOME, builtin
from tests.planning.sequence.fingers import LEADER, robot

ROBOT = robot()
AT = np.array([[1, 0, 0, 0.6], [0, 1, 0, 0.4], [0, 0, 1, 0.3], [0, 0, 0, 1]], dtype=float)
TABLE = Obstacle("table", Box([0.3, 0.3, 0.05]), AT)
CRATE = Obstacle("crate", Box([0.04, 0.04, 0.04]), np.eye(4))
SCENE = Scene([TABLE])


def motion() -> Trajectory:
    q = np.array([HOME, np.add(HOME, 0.1)])
    zero = np.zeros_like(q)
    return interpolate(ROBOT.chain.joint_names, [0.0, 2.0], q, "quintic", zero, zero)


def holding(touches: tuple[str, ...] = (), size: float = 0.04) -> Premises:
    crate = Obstacle("crate", Box([size, 0.04, 0.04]), np.eye(4))
    grasped = hold(ROBOT, SCENE, [Attachment(crate, "panda_hand", touches)])
    return Premises.of_cell(grasped.robot, grasped.scene, 0.0)


def test_a_certificate_tells_what_it_was_proved_against() -> None:
    certificate = certify(motion(), ROBOT, SCENE, margin=0.01)
    assert certificate.verified
    premises = certificate.premises
    assert (premises.robot, premises.tool) == (ROBOT.chain.name, ROBOT.chain.tip_link)
    assert (premises.obstacles, premises.attached, premises.margin) == (1, (), 0.01)
    assert premises.scene_hash == hashlib.sha256(TABLE.content()).hexdigest()
    assert f"a scene of 1 obstacle (hash {premises.scene_hash[:12]})" in premises.against()
    alone = certify(motion(), ROBOT, Scene()).premises
    assert alone.against().startswith("against the robot itself only")


def test_limits_alone_say_that_no_scene_was_looked_at() -> None:
    premises = certify_limits(motion(), ROBOT.chain, MotionLimits()).premises
    assert premises.scene_hash is None
    assert "collisions not looked at" in premises.against()
    without = certify_limits(motion(), None, MotionLimits()).premises
    assert without.robot is None
    assert "without a robot" in without.against()


def changed_cells() -> dict[str, Premises]:
    """Premises that differ from those of the robot at SCENE in one respect each."""
    nearer = AT.copy()
    nearer[0, 3] -= 1e-6
    apart = with_fingers(ROBOT, {LEADER: 0.013})
    slower = replace(ROBOT.chain.limits, velocity=ROBOT.chain.limits.velocity * 0.99)
    cells = {
        "no scene": (ROBOT, Scene()),
        "one more": (ROBOT, Scene([TABLE, Obstacle("ball", Sphere(0.1), AT)])),
        "moved": (ROBOT, Scene([Obstacle("table", TABLE.shape, nearer)])),
        "margin of its own": (ROBOT, Scene([replace(TABLE, margin=0.001)])),
        "another pair may touch": (ROBOT, Scene([TABLE], [("table", "panda_hand")])),
        "fingers": (apart, SCENE),
        "limits": (replace(ROBOT, chain=replace(ROBOT.chain, limits=slower)), SCENE),
        "allowed": (replace(ROBOT, allowed={**ROBOT.allowed, ("a", "b"): "srdf"}), SCENE),
        "robot": (builtin("ur5e"), SCENE),
    }
    found = {name: Premises.of_cell(*cell, 0.0) for name, cell in cells.items()}
    return found | {"held": holding(), "touching": holding(("table",)), "size": holding(size=0.05)}


@pytest.mark.parametrize("name", changed_cells())
def test_every_change_is_told_both_ways(name: str) -> None:
    premises, other = Premises.of_cell(ROBOT, SCENE, 0.0), changed_cells()[name]
    assert not premises.differences(premises)
    assert premises.differences(other)
    assert other.differences(premises)


def test_held_objects_differ_by_their_shape_and_by_what_they_may_touch() -> None:
    assert not holding().differences(holding())
    assert holding().differences(holding(size=0.041))
    assert holding().differences(holding(("table",)))


def test_a_margin_and_limits_alone_are_no_difference() -> None:
    premises = Premises.of_cell(ROBOT, SCENE, 0.0)
    assert not premises.differences(replace(premises, margin=0.02, scene="stored"))
    assert not premises.differences(Premises.of_limits(None))
