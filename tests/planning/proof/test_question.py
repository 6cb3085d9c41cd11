"""Questions that are none, and premises of proofs."""

import hashlib
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import armwright as aw
from kinematics.arrays import Array
from kinematics.trajectory.trajectory import Trajectory, interpolate
from obstacles.robots.attachment import Attachment, hold
from obstacles.robots.finger_geometry import with_fingers
from obstacles.scenes.scene import Obstacle, Scene
from obstacles.shapes.shape import Box, Sphere
from planning.constraints.constraint_set import ConstraintSet
from planning.proof.certificate import certify, certify_limits
from planning.proof.premises import Premises
from planning.values.limits import EffortLimits, MotionLimits
from tests.planning.scenes import builtin
from tests.planning.sequence.fingers import LEADER, robot

ROBOT = aw.load_robot("panda")
NAMES = ROBOT.chain.joint_names
HOME = np.array([0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785])


def motion(names: tuple[str, ...], q: Array, way: float = 0.1) -> aw.Trajectory:
    """A motion by ``way`` of each joint within 2 s, from rest to rest."""
    c = np.zeros((1, len(q), 6))
    c[0, :, 0] = q
    c[0, :, 3:] = way * np.array([10.0 / 2.0**3, -15.0 / 2.0**4, 6.0 / 2.0**5])
    return aw.Trajectory(names, np.array([0.0, 2.0]), c)


RIGHT = motion(NAMES, HOME)
UR = aw.load_robot("ur5e")


@pytest.mark.parametrize(
    ("names", "q"),
    [
        ((*NAMES, "extra"), np.append(HOME, 0.0)),
        (NAMES[:-1], HOME[:-1]),
        (NAMES[::-1], HOME),
        (tuple("abcdefg"), HOME),
    ],
)
def test_a_motion_of_other_joints_is_refused(names: tuple[str, ...], q: Array) -> None:
    with pytest.raises(aw.ArmwrightError, match="the trajectory is of the joints") as told:
        aw.certify(motion(names, q), ROBOT, aw.Scene())
    assert told.value.hint is not None
    assert ", ".join(NAMES) in told.value.hint


@pytest.mark.parametrize(
    "asked",
    [
        {"margin": -0.05},
        {"margin": np.nan},
        {"margin": np.inf},
        {"limits": aw.MotionLimits({"velocity": np.ones(6)})},
        {"limits": aw.MotionLimits({"jerk": np.ones(8)})},
        {"limits": aw.MotionLimits({}, EffortLimits(UR.chain, np.ones(6)))},
        {"constraints": ConstraintSet(UR.chain, (aw.ToolSpeedConstraint(1.0),))},
    ],
)
def test_limits_constraints_and_margins_of_no_such_robot_are_refused(asked: dict[str, Any]) -> None:
    assert aw.certify(RIGHT, ROBOT, aw.Scene()).verified
    with pytest.raises(aw.ArmwrightError):
        aw.certify(RIGHT, ROBOT, aw.Scene(), **asked)


@pytest.mark.parametrize(
    "bounds",
    [
        {"velocities": np.ones(7)},
        {"velocity": -np.ones(7)},
        {"velocity": np.ones((1, 7))},
        {"velocity": 1.0},
        {"velocity": ["1"] * 7},
    ],
)
def test_limits_that_are_none_can_not_be_made(bounds: dict[str, Any]) -> None:
    with pytest.raises(aw.ArmwrightError, match="limit"):
        aw.MotionLimits(bounds)
    with pytest.raises(aw.ArmwrightError, match="torque limits must be 7 positive numbers"):
        EffortLimits(ROBOT.chain, np.ones(6))


@pytest.mark.parametrize(
    ("position", "wrong", "cure"),
    [(1, "panda", "aw.load_robot('panda')"), (1, None, "load_robot"), (2, None, "aw.Scene()"),
     (0, HOME, "aw.retime")],
)  # fmt: skip
def test_arguments_of_another_type_are_named_with_what_to_give(
    position: int, wrong: Any, cure: str
) -> None:
    arguments: list[Any] = [RIGHT, ROBOT, aw.Scene()]
    arguments[position] = wrong
    with pytest.raises(aw.ArmwrightError, match="has to be a") as told:
        aw.certify(*arguments)
    assert cure in (told.value.hint or "")


def test_a_motion_out_of_all_limits_is_refused_at_once() -> None:
    """A million radians took ten minutes, though the limits were broken from the first instant."""
    certificate = aw.certify(motion(NAMES, HOME, 1e6), ROBOT, aw.Scene())
    assert not certificate.verified
    assert not certificate.proved.collisions
    assert certificate.min_clearance == -np.inf
    assert certificate.violation is not None
    assert certificate.violation.kind in ("position", "velocity", "acceleration", "jerk")
    assert "farther than 1000 rad" in certificate.proved.reasons[-1]


PREMISES_ROBOT = robot()
AT = np.array([[1, 0, 0, 0.6], [0, 1, 0, 0.4], [0, 0, 1, 0.3], [0, 0, 0, 1]], dtype=float)
TABLE = Obstacle("table", Box([0.3, 0.3, 0.05]), AT)
CRATE = Obstacle("crate", Box([0.04, 0.04, 0.04]), np.eye(4))
SCENE = Scene([TABLE])


def premises_motion() -> Trajectory:
    q = np.array([HOME, np.add(HOME, 0.1)])
    zero = np.zeros_like(q)
    return interpolate(PREMISES_ROBOT.chain.joint_names, [0.0, 2.0], q, "quintic", zero, zero)


def holding(touches: tuple[str, ...] = (), size: float = 0.04) -> Premises:
    crate = Obstacle("crate", Box([size, 0.04, 0.04]), np.eye(4))
    grasped = hold(PREMISES_ROBOT, SCENE, [Attachment(crate, "panda_hand", touches)])
    return Premises.of_cell(grasped.robot, grasped.scene, 0.0)


def test_a_certificate_tells_what_it_was_proved_against() -> None:
    certificate = certify(premises_motion(), PREMISES_ROBOT, SCENE, margin=0.01)
    assert certificate.verified
    premises = certificate.premises
    assert (premises.robot, premises.tool) == (
        PREMISES_ROBOT.chain.name,
        PREMISES_ROBOT.chain.tip_link,
    )
    assert (premises.obstacles, premises.attached, premises.margin) == (1, (), 0.01)
    assert premises.scene_hash == hashlib.sha256(TABLE.content()).hexdigest()
    assert f"a scene of 1 obstacle (hash {premises.scene_hash[:12]})" in premises.against()
    alone = certify(premises_motion(), PREMISES_ROBOT, Scene()).premises
    assert alone.against().startswith("against the robot itself only")


def test_limits_alone_say_that_no_scene_was_looked_at() -> None:
    premises = certify_limits(premises_motion(), PREMISES_ROBOT.chain, MotionLimits()).premises
    assert premises.scene_hash is None
    assert "collisions not looked at" in premises.against()
    without = certify_limits(premises_motion(), None, MotionLimits()).premises
    assert without.robot is None
    assert "without a robot" in without.against()


def changed_cells() -> dict[str, Premises]:
    """Premises that differ from those of the robot at SCENE in one respect each."""
    nearer = AT.copy()
    nearer[0, 3] -= 1e-6
    apart = with_fingers(PREMISES_ROBOT, {LEADER: 0.013})
    slower = replace(
        PREMISES_ROBOT.chain.limits, velocity=PREMISES_ROBOT.chain.limits.velocity * 0.99
    )
    cells = {
        "no scene": (PREMISES_ROBOT, Scene()),
        "one more": (PREMISES_ROBOT, Scene([TABLE, Obstacle("ball", Sphere(0.1), AT)])),
        "moved": (PREMISES_ROBOT, Scene([Obstacle("table", TABLE.shape, nearer)])),
        "margin of its own": (PREMISES_ROBOT, Scene([replace(TABLE, margin=0.001)])),
        "another pair may touch": (PREMISES_ROBOT, Scene([TABLE], [("table", "panda_hand")])),
        "fingers": (apart, SCENE),
        "limits": (
            replace(PREMISES_ROBOT, chain=replace(PREMISES_ROBOT.chain, limits=slower)),
            SCENE,
        ),
        "allowed": (
            replace(PREMISES_ROBOT, allowed={**PREMISES_ROBOT.allowed, ("a", "b"): "srdf"}),
            SCENE,
        ),
        "robot": (builtin("ur5e"), SCENE),
    }
    found = {name: Premises.of_cell(*cell, 0.0) for name, cell in cells.items()}
    return found | {"held": holding(), "touching": holding(("table",)), "size": holding(size=0.05)}


@pytest.mark.parametrize("name", changed_cells())
def test_every_change_is_told_both_ways(name: str) -> None:
    premises, other = Premises.of_cell(PREMISES_ROBOT, SCENE, 0.0), changed_cells()[name]
    assert not premises.differences(premises)
    assert premises.differences(other)
    assert other.differences(premises)


def test_held_objects_differ_by_their_shape_and_by_what_they_may_touch() -> None:
    assert not holding().differences(holding())
    assert holding().differences(holding(size=0.041))
    assert holding().differences(holding(("table",)))


def test_a_margin_and_limits_alone_are_no_difference() -> None:
    premises = Premises.of_cell(PREMISES_ROBOT, SCENE, 0.0)
    assert not premises.differences(replace(premises, margin=0.02, scene="stored"))
    assert not premises.differences(Premises.of_limits(None))
