"""Motions in turn on one timeline: stays between them, and fingers that move beside them."""

import numpy as np
import pytest

from kinematics.trajectory.trajectory import Trajectory
from obstacles.robots.finger_geometry import with_fingers
from obstacles.scenes.scene import Scene
from service.viewer.timeline import Part, finger_tracks, joined, joined_curves
from tests.planning.sequence import fingers
from tests.service.robots import HOME


def stay(duration: float, q: list[float]) -> Trajectory:
    robot = fingers.robot()
    return Trajectory(robot.chain.joint_names, np.array([0.0, duration]), np.reshape(q, (1, -1, 1)))


def parts() -> list[Part]:
    """The gripper opens, and the arm goes on a second later."""
    robot = with_fingers(fingers.robot(), {fingers.LEADER: 0.0})
    opened = with_fingers(robot, {fingers.LEADER: 0.04})
    moves = np.array([[[0.0, 0.04], [0.0, 0.04]]])
    opens = Trajectory((fingers.LEADER, fingers.MIMIC_JOINT), np.array([0.0, 1.0]), moves)
    return [
        Part("open", 0.0, stay(1.0, HOME), robot, Scene(()), opens, opened),
        Part("wait", 2.0, stay(0.5, HOME), opened, Scene(()), None, opened),
    ]


def test_the_arm_stands_still_between_parts() -> None:
    motion = joined(parts(), 4.0)
    assert motion.duration == pytest.approx(4.0)
    np.testing.assert_allclose(motion.breaks, [0.0, 1.0, 2.0, 2.5, 4.0])
    np.testing.assert_allclose(motion.sample([1.5, 3.9]), [HOME, HOME])


def test_curves_follow_each_other() -> None:
    curves = joined_curves(parts(), 0.3)
    assert curves["tool_speed"]["limit"] == 0.3
    for name in ("torque", "tool_speed", "clearance"):
        times = curves[name]["times"]
        assert times == sorted(times)
        assert (times[0], times[-1]) == (0.0, 2.5)
    assert len(curves["clearance"]["values"]) == len(curves["clearance"]["times"])


def test_fingers_slide_apart_as_their_motion_says() -> None:
    tracks = finger_tracks(with_fingers(fingers.robot(), {fingers.LEADER: 0.0}), parts())
    assert set(tracks) == {"claw_left_plate", "claw_right_plate"}
    left, right = (tracks[f"claw_{side}_plate"] for side in ("left", "right"))
    at_half = left["times"].index(0.5)
    apart = [
        np.subtract(left["frames"][k][12:15], right["frames"][k][12:15])
        for k in (0, at_half, len(left["times"]) - 1)
    ]
    # Along an axis of the hand, twice the way of either finger.
    assert np.linalg.norm(apart, axis=1) == pytest.approx([0.0, 0.04, 0.08])
    assert finger_tracks(fingers.robot(), [parts()[1]._replace(robot=fingers.robot())]) == {}
