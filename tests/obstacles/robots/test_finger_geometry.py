"""Fingers elsewhere and their covers, against pinocchio's placements and sampled motions."""

from functools import cache

import numpy as np
import pytest

from benchmarks.problems.example_arms import ARMS
from kinematics.arrays import Array
from kinematics.errors import InvalidOption
from obstacles.robots.finger_geometry import moved_links, swept_cover, with_fingers
from obstacles.robots.robot_geometry import RobotGeometry

_LEADER = {"panda": "panda_finger_joint1", "pr2": "r_gripper_l_finger_joint"}
_LAST = {"panda": 0.04, "pr2": 0.5}


@cache
def _robot(name: str) -> RobotGeometry:
    return ARMS[name].geometry({"acceleration": 10.0})


def _corners(robot: RobotGeometry, i: int) -> Array:
    """Corners of a piece in the frame of its joint, shape (k, 3)."""
    piece = robot.pieces[i]
    return piece.vertices @ piece.T_owner_piece[:3, :3].T + piece.T_owner_piece[:3, 3]


@pytest.mark.parametrize("name", ["panda", "pr2"])
def test_solids_go_with_their_links_and_all_else_stays(name: str) -> None:
    robot = _robot(name)
    moved = with_fingers(robot, {_LEADER[name]: _LAST[name]})
    links = moved_links(robot, frozenset([_LEADER[name]]))
    assert len(links) >= 2
    for i, link in enumerate(robot.links):
        T, T_new = (r.chain.link(link).T_joint_link for r in (robot, moved))
        own = np.linalg.inv(T) @ robot.pieces[i].T_owner_piece
        assert np.allclose(T_new @ own, moved.pieces[i].T_owner_piece, atol=1e-12)
        assert np.allclose(T, T_new) == (link not in links)
    assert moved.content_hash != robot.content_hash
    back = with_fingers(moved, dict(robot.fingers.positions))
    for one, other in zip(robot.pieces, back.pieces, strict=True):
        np.testing.assert_allclose(one.T_owner_piece, other.T_owner_piece, atol=1e-12)
    assert with_fingers(robot, dict(robot.fingers.positions)) is robot


@pytest.mark.parametrize("name", ["panda", "pr2"])
@pytest.mark.parametrize("share", [(0.0, 1.0), (0.25, 0.5), (0.7, 0.71)])
def test_a_cover_holds_every_corner_on_its_way(name: str, share: tuple[float, float]) -> None:
    robot, leader = _robot(name), _LEADER[name]
    first = dict(robot.fingers.positions)
    last = {**first, leader: _LAST[name]}
    cover, growth = swept_cover(robot, first, last, share)
    farthest = 0.0
    for s in np.linspace(*share, 23):
        at = first[leader] + s * (last[leader] - first[leader])
        there = with_fingers(robot, {leader: at})
        for i, piece in enumerate(cover.pieces):
            if not len(piece.vertices):
                continue
            off = np.linalg.norm(_corners(there, i) - _corners(cover, i), axis=1).max()
            added = piece.offset_radius - robot.pieces[i].offset_radius
            # A corner that moves by no more than the ball added is inside the cover.
            assert off <= added + 1e-12
            farthest = max(farthest, off)
    # The bound is not idle: something moves by a good part of it.
    assert growth >= farthest >= 0.3 * growth > 0.0


def test_joints_that_are_no_fingers_are_refused() -> None:
    with pytest.raises(InvalidOption, match="no joint of a gripper"):
        with_fingers(_robot("panda"), {"panda_joint7": 0.1})
