"""Control points: where they are on the arm, how wide the arm is there, how they move."""

import numpy as np
import pytest

from kinematics.arrays import Array
from kinematics.errors import InvalidOption
from kinematics.forward import forward, joint_frames, link_poses
from kinematics.model.dh import chain_from_dh, dh_from_chain
from kinematics.robots import builtin_names
from obstacles.convex.piece import Piece
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.shapes.shape import Box, Capsule, Cylinder, HalfSpace, Shape, Sphere
from planning.field.control_points import (
    ControlPoints,
    along_links,
    control_points,
    origin_points,
)
from tests.obstacles.solids import random_transform
from tests.planning.scenes import builtin
from tests.planning.slider import slider


def carrying(shape: Shape, T: Array | None = None, joint: int = 1) -> RobotGeometry:
    """The two slides with one solid on a joint."""
    pose = np.eye(4) if T is None else T
    pieces: tuple[Piece, ...] = tuple(piece.placed(pose) for piece in shape.pieces())
    names = ("ball",) * len(pieces)
    joints, solids = np.full(len(pieces), joint), np.zeros(len(pieces), dtype=np.int64)
    return RobotGeometry(slider().chain, pieces, names, joints, solids, {})


@pytest.mark.parametrize("name", builtin_names())
def test_origins_are_those_of_the_table_and_of_the_tip(name: str) -> None:
    chain = builtin(name).chain
    q = np.random.default_rng(1).uniform(*chain.sampling_bounds())
    points, _ = control_points(chain, origin_points(chain), q)
    np.testing.assert_allclose(points[-1], forward(chain, q)[:3, 3], atol=1e-12)
    # The chain of its own table has frame i as link_i.
    table = chain_from_dh("table", dh_from_chain(chain))
    frames = link_poses(table, q, [f"link_{i + 1}" for i in range(chain.n - 1)])
    np.testing.assert_allclose(points[:-1], frames[:, :3, 3], atol=1e-12)
    assert not origin_points(chain).radii.any()


def test_origins_have_the_radii_given() -> None:
    chain = slider().chain
    assert origin_points(chain, 0.2).radii.tolist() == [0.2, 0.2]
    assert origin_points(chain, [0.1, 0.3]).radii.tolist() == [0.1, 0.3]
    with pytest.raises(InvalidOption, match=r"3 value.*2 control points"):
        origin_points(chain, [0.1, 0.2, 0.3])


@pytest.mark.parametrize(
    ("shape", "count", "width"),
    [
        (Sphere(0.1), 1, 0.1),
        (Box(np.full(3, 0.2)), 1, 0.1),
        (Box(np.array([0.2, 0.3, 0.2])), 1, 0.1),
        (Box(np.array([0.2, 0.31, 0.2])), 2, 0.1),
        (Box(np.array([0.2, 0.2, 0.5])), 3, 0.1),
        (Box(np.array([2.0, 0.2, 0.1])), 4, 0.1),
        (Cylinder(0.05, 0.4), 4, 0.05),
        (Capsule(0.1, 0.2), 2, 0.1),
        (Box(np.array([0.4, 0.4, 0.01])), 1, 0.2),
    ],
)
def test_slender_solids_get_several_points(shape: Shape, count: int, width: float) -> None:
    """From 1.5 times as long as wide on; one for each width, and at most four."""
    where = along_links(carrying(shape))
    assert len(where) == count
    np.testing.assert_allclose(where.radii, width)


def test_points_lie_on_the_longest_axis_from_end_to_end() -> None:
    T = random_transform(np.random.default_rng(2), 0.3)
    where = along_links(carrying(Box(np.array([0.1, 0.7, 0.12])), T))
    local = (where.places - T[:3, 3]) @ T[:3, :3]
    np.testing.assert_allclose(local[:, [0, 2]], 0.0, atol=1e-12)
    # The balls of the outermost end where the box does, and all are as far apart.
    np.testing.assert_allclose(local[:, 1], np.linspace(-0.29, 0.29, 4), atol=1e-12)
    assert set(where.joints) == {1}


def test_a_solid_that_is_not_centred_has_its_point_in_its_middle() -> None:
    T = np.eye(4)
    (piece,) = Sphere(0.1).pieces()
    T[:3, 3] = 0.3, 0.0, -0.2
    np.testing.assert_allclose(along_links(carrying(Sphere(0.1), T)).places, [[0.3, 0.0, -0.2]])
    assert piece.vertices.shape == (1, 3)


def test_what_stands_still_and_what_is_endless_has_no_points() -> None:
    """A robot without any solid that moves is pulled by its frame origins."""
    chain = slider().chain
    origins = origin_points(chain)
    still = carrying(Sphere(0.1), joint=-1)
    endless = carrying(HalfSpace(np.array([0.0, 0.0, 1.0]), 0.0))
    none = np.zeros(0, dtype=np.int64)
    bare = RobotGeometry(chain, (), (), none, none, {})
    for robot in (still, endless, bare):
        where = along_links(robot)
        np.testing.assert_array_equal(where.places, origins.places)
        np.testing.assert_array_equal(where.joints, origins.joints)
        assert not where.radii.any()


@pytest.mark.parametrize("name", builtin_names())
def test_every_moving_solid_has_its_points_in_the_order_of_the_solids(name: str) -> None:
    robot = builtin(name)
    where, first = along_links(robot), 0
    for piece, joint in zip(robot.pieces, robot.joints, strict=True):
        if joint < 0:
            continue
        T, box = piece.T_owner_piece, piece.local_box()
        _, width, longest = np.sort(box[3:])
        count = min(int(np.ceil(longest / width)), 4) if longest > 1.5 * width else 1
        local = (where.places[first : first + count] - T[:3, 3]) @ T[:3, :3] - box[:3]
        assert (np.abs(local) <= box[3:] + 1e-12).all()
        np.testing.assert_allclose(
            np.abs(local).max(initial=0.0), longest - width if count > 1 else 0.0, atol=1e-12
        )
        assert set(where.joints[first : first + count]) == {joint}
        np.testing.assert_allclose(where.radii[first : first + count], width)
        first += count
    assert first == len(where)


def test_a_point_moves_with_its_joint_and_those_before_it_only() -> None:
    """Of two slides, x and y: the first one carries its own point along x only."""
    chain = slider().chain
    where = ControlPoints(
        np.array([0, 1]), np.array([[0.1, 0.0, 0.0], [0.0, 0.2, 0.0]]), np.zeros(2)
    )
    points, jacobians = control_points(chain, where, np.array([0.5, -0.3]))
    at_x = joint_frames(chain, np.array([0.5, -0.3]))
    for i, joint in enumerate(where.joints):
        expected = at_x[joint] @ [*where.places[i], 1.0]
        np.testing.assert_allclose(points[i], expected[:3], atol=1e-12)
    np.testing.assert_allclose(jacobians[0], [[1, 0], [0, 0], [0, 0]], atol=1e-12)
    np.testing.assert_allclose(jacobians[1], [[1, 0], [0, 1], [0, 0]], atol=1e-12)


def test_points_can_not_be_written_to_and_are_copies() -> None:
    places = np.zeros((1, 3))
    where = ControlPoints(np.array([0]), places, np.array([0.1]))
    places[0, 0] = 7.0
    assert len(where) == 1
    assert where.places[0, 0] == 0.0
    for array in (where.joints, where.places, where.radii):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1


def test_a_read_only_configuration_is_taken() -> None:
    chain = slider().chain
    q = np.zeros(2)
    q.setflags(write=False)
    points, _ = control_points(chain, origin_points(chain), q)
    assert points.shape == (2, 3)
