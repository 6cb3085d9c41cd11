"""The potential and its control points: closed forms, slopes by differences, where points are."""

import numpy as np
import pytest

from kinematics.arrays import Array
from kinematics.forward import forward, link_poses
from kinematics.model.chain import Chain
from kinematics.model.dh import chain_from_dh, dh_from_chain
from kinematics.pose import transform
from kinematics.robots import builtin_names
from obstacles.convex.piece import Piece
from obstacles.projection.projection import Projector
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.scenes.scene import Obstacle, Scene
from obstacles.shapes.shape import (
    Box,
    Capsule,
    Cylinder,
    HalfSpace,
    Mesh,
    PointCloud,
    Shape,
    Sphere,
)
from planning.field.control_points import along_links, control_points, origin_points
from planning.field.potential import Field
from planning.field.weights import FieldWeights
from tests.obstacles.solids import random_transform
from tests.planning.scenes import HOME, builtin, pillar, shelf
from tests.planning.slider import slider

STEP = 1e-6


def slope(field: Field, q: Array) -> Array:
    ahead = [field.at(q + step).potential for step in STEP * np.eye(len(q))]
    behind = [field.at(q - step).potential for step in STEP * np.eye(len(q))]
    return np.asarray((np.array(ahead) - np.array(behind)) / (2.0 * STEP))


def near_a_kink(field: Field, q: Array, reach: float) -> bool:
    """Second derivatives jump at the rim of the reach; inside, ways out may tie."""
    return bool((np.abs(field.at(q).distances - reach) < 1e-4).any())


@pytest.mark.parametrize("name", ["panda", "stanford", "kr6_sixx", "scara", "planar_rr"])
def test_joint_force_is_minus_the_slope_of_the_potential(name: str) -> None:
    robot = builtin(name)
    chain = robot.chain
    random = np.random.default_rng(0)
    lower, upper = chain.sampling_bounds()
    where = origin_points(chain)
    reach = 0.3
    felt = 0
    for k in range(60):
        goal, q = random.uniform(lower, upper, (2, chain.n))
        points = control_points(chain, where, q)[0]
        obstacles = tuple(
            Obstacle(f"ball{i}", Sphere(0.05), transform(None, point + random.normal(0.0, 0.15, 3)))
            for i, point in enumerate(points[-3:])
        )
        weights = FieldWeights(
            attractive_weights=random.uniform(0.5, 2.0, chain.n).tolist(),
            attractive_cap=0.3,
            repulsive_weights=random.uniform(0.001, 0.01, chain.n).tolist(),
            influence_distance=reach,
        )
        joint_weight = 0.5 * (k % 2)
        field = Field(chain, where, Projector(obstacles), goal, weights, joint_weight)
        value = field.at(q)
        if near_a_kink(field, q, reach) or value.distances.min() < 0.01:
            continue
        felt += int((value.distances < reach).any())
        expected = -slope(field, q)
        assert value.joint_force == pytest.approx(expected, rel=1e-5, abs=1e-5)
    assert felt > 10


def test_slopes_near_every_kind_of_obstacle() -> None:
    chain = builtin("panda").chain
    random = np.random.default_rng(1)
    scene = Scene((*shelf(0.5).obstacles, *pillar().obstacles))
    weights = FieldWeights(influence_distance=0.15, repulsive_weights=1e-3)
    lower, upper = chain.sampling_bounds()
    where = along_links(builtin("panda"))
    near = 0
    for _ in range(60):
        field = Field(chain, where, Projector(scene), HOME, weights)
        q = random.uniform(lower, upper)
        value = field.at(q)
        gaps = value.distances - where.radii
        # Where two faces are as near as each other, or nearly so, the slope jumps.
        if (np.abs(gaps - 0.15) < 1e-4).any() or gaps.min() < 2e-3:
            continue
        near += int((gaps < 0.15).any())
        assert value.joint_force == pytest.approx(-slope(field, q), rel=1e-4, abs=1e-4)
    assert near > 5


def one_point(point: Array, *obstacles: Obstacle, **weights: float) -> tuple[Array, Field, Chain]:
    """The field at the tip of the SCARA, brought to a point by moving the scene instead."""
    chain = builtin("scara").chain
    q = np.array([0.3, 0.4, 0.05, 0.2])
    tip = control_points(chain, origin_points(chain), q)[0][-1]
    moved = tuple(
        Obstacle(o.id, o.shape, transform(None, tip - point) @ o.T_world_obstacle)
        for o in obstacles
    )
    only_tip = [0.0] * (chain.n - 1)
    options = FieldWeights(
        attractive_weights=0.0,
        repulsive_weights=[*only_tip, 1.0],
        influence_distance=weights.get("influence_distance", 0.5),
        least_distance=weights.get("least_distance", 1e-3),
    )
    return q, Field(chain, origin_points(chain), Projector(moved), q, options), chain


@pytest.mark.parametrize(
    ("gap", "potential", "force"),
    [
        (0.6, 0.0, 0.0),
        (0.5, 0.0, 0.0),
        (0.25, 0.5 * (4 - 2) ** 2, (4 - 2) * 16),
        (0.1, 0.5 * (10 - 2) ** 2, (10 - 2) * 100),
        # The tangent at rho_m = 0.05: U = 162, slope -7200.
        (0.05, 162.0, 7200.0),
        (0.01, 162.0 + 7200.0 * 0.04, 7200.0),
        (-0.02, 162.0 + 7200.0 * 0.07, 7200.0),
    ],
)  # fmt: skip
def test_repulsion_in_closed_form(gap: float, potential: float, force: float) -> None:
    wall = Obstacle("wall", HalfSpace(np.array([0.0, 0.0, 1.0]), 0.0), transform(None, [0, 0, 0]))
    q, field, _ = one_point(np.array([0.0, 0.0, gap]), wall, least_distance=0.05)
    value = field.at(q)
    assert value.potential == pytest.approx(potential, abs=1e-9)
    assert value.repulsive_forces[-1] == pytest.approx([0.0, 0.0, force], abs=1e-6)
    assert value.distances[-1] == pytest.approx(gap)


def test_inside_the_force_points_along_the_shortest_way_out() -> None:
    crate = Obstacle("crate", Box(np.array([0.4, 0.4, 0.4])), transform(None, [0, 0, 0]))
    q, field, _ = one_point(np.array([0.15, 0.02, -0.03]), crate)
    push = field.at(q).repulsive_forces[-1]
    assert push[0] > 0.0
    assert push[1:] == pytest.approx([0.0, 0.0], abs=1e-6)


def test_a_union_pushes_once_from_what_is_nearest() -> None:
    cloud = PointCloud(np.array([[0.0, 0.0, 0.0], [0.3, 0.0, 0.0]]), 0.05)
    ball = Obstacle("b", Sphere(0.05), transform(None, [0, 0, 0]))
    point = np.array([0.0, 0.0, 0.2])
    q, union, _ = one_point(point, Obstacle("c", cloud, transform(None, [0, 0, 0])))
    q, single, _ = one_point(point, ball)
    assert union.at(q).potential == pytest.approx(single.at(q).potential)
    assert union.at(q).repulsive_forces == pytest.approx(single.at(q).repulsive_forces)
    q, both, _ = one_point(
        point, ball, Obstacle("d", Sphere(0.05), transform(None, [0.3, 0.0, 0.0]))
    )
    assert both.at(q).potential > single.at(q).potential


def test_a_mesh_with_a_notch_is_felt_as_its_convex_pieces() -> None:
    # An L in the xz-plane, extruded along y: its hull would fill the notch.
    outline = np.array([[0, 0], [0.4, 0], [0.4, 0.1], [0.1, 0.1], [0.1, 0.4], [0, 0.4]])
    vertices = np.array([[x, y, z] for y in (-0.1, 0.1) for x, z in outline])
    caps = [[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 5]]
    sides = [[i, (i + 1) % 6, (i + 1) % 6 + 6] for i in range(6)]
    sides += [[i, (i + 1) % 6 + 6, i + 6] for i in range(6)]
    # Seen from -y the outline runs clockwise or not; either way it must be the same on all faces.
    faces = [[a, b, c] for a, b, c in caps] + [[c + 6, b + 6, a + 6] for a, b, c in caps]
    faces += [[c, b, a] for a, b, c in sides]
    mesh = Mesh(vertices, np.array(faces))
    notch = np.array([0.25, 0.0, 0.25])
    q, field, _ = one_point(notch, Obstacle("l", mesh, transform(None, [0, 0, 0])))
    assert field.at(q).distances[-1] == pytest.approx(0.15, abs=0.02)


def test_attraction_in_closed_form() -> None:
    chain = builtin("planar_rr").chain
    where = origin_points(chain)
    goal, q = np.array([0.0, 0.0]), np.array([0.0, 0.05])
    weights = FieldWeights(attractive_weights=3.0, attractive_cap=0.2)
    field = Field(chain, where, Projector(()), goal, weights)
    points, goals = (control_points(chain, where, at)[0] for at in (q, goal))
    length = np.linalg.norm(points - goals, axis=1)
    value = field.at(q)
    assert value.potential == pytest.approx(1.5 * (length**2).sum())
    assert value.attractive_forces == pytest.approx(3.0 * (goals - points))
    far = np.array([2.0, 0.5])
    points = control_points(chain, where, far)[0]
    length = np.linalg.norm(points - goals, axis=1)
    assert (length > 0.2).all()
    value = field.at(far)
    assert value.potential == pytest.approx(3.0 * (0.2 * length - 0.02).sum())
    assert np.linalg.norm(value.attractive_forces, axis=1) == pytest.approx([0.6, 0.6])
    assert not np.isfinite(value.distances).any()
    assert (value.nearest == -1).all()


@pytest.mark.parametrize("name", ["panda", "stanford", "kr6_sixx"])
def test_jacobians_of_the_control_points(name: str) -> None:
    robot = builtin(name)
    chain = robot.chain
    random = np.random.default_rng(2)
    lower, upper = chain.sampling_bounds()
    for where in (origin_points(chain), along_links(robot)):
        q = random.uniform(lower, upper)
        _, jacobians = control_points(chain, where, q)
        for j, step in enumerate(STEP * np.eye(chain.n)):
            ahead, behind = (control_points(chain, where, at)[0] for at in (q + step, q - step))
            assert jacobians[:, :, j] == pytest.approx((ahead - behind) / 2e-6, abs=1e-8)
            # What joint j moves lies beyond it.
            assert not jacobians[where.joints < j, :, j].any()


@pytest.mark.parametrize("name", ["panda", "scara", "ur5e"])
def test_a_slope_has_the_value_and_the_force_of_all_obstacles(name: str) -> None:
    robot = builtin(name)
    random = np.random.default_rng(17)
    lower, upper = robot.chain.sampling_bounds()
    floor = Obstacle("floor", HalfSpace(np.array([0.0, 0.0, 1.0]), -0.1), np.eye(4))
    scenes = (Scene(), shelf(0.5), Scene((*shelf(0.4).obstacles, *pillar().obstacles, floor)))
    for scene in scenes:
        for where in (origin_points(robot.chain), along_links(robot)):
            goal = random.uniform(lower, upper)
            field = Field(robot.chain, where, Projector(scene), goal, FieldWeights(), 0.3)
            for _ in range(30):
                q = random.uniform(lower, upper)
                expected, (potential, force, _) = field.at(q), field.slope(q)
                assert potential == pytest.approx(expected.potential, rel=1e-12)
                scale = np.abs(expected.joint_force).max() + 1.0
                assert force == pytest.approx(expected.joint_force, abs=1e-12 * scale)


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
