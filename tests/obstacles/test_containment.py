"""A body inside a mesh, touching nothing: found, told by name, and by nobody who may touch it."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from kinematics.arrays import Array
from obstacles.checker import Checker
from obstacles.containment import first_inside
from obstacles.piece import Piece, PieceKind, Surface
from obstacles.robot_geometry import RobotGeometry
from obstacles.scene import Obstacle, Scene
from obstacles.shapes import Box, Capsule, HalfSpace, PointCloud, Shape, Sphere
from tests.obstacles.arms import cup, gantry, in_cup, mesh_shape, obstacle, off_file
from tests.obstacles.solids import random_transform

BALL = '<sphere radius="0.02"/>'
IN_THE_HOLLOW, OUTSIDE = [0.0, 0.0, 0.0], [0.0, 0.0, 0.5]
#: The floor of the cup begins here and ends at -0.15 m.
_BOTTOM = -0.4


def tall() -> trimesh.Trimesh:
    """The cup with a floor so thick that solids of 0.02 m fit into it."""
    return cup(_BOTTOM)


def around(mesh: trimesh.Trimesh, T: Array | None = None) -> Scene:
    return Scene((Obstacle("cup", mesh_shape(mesh), np.eye(4) if T is None else T),))


def holder(mesh: trimesh.Trimesh) -> RobotGeometry:
    """A gantry whose tool is a mesh."""
    return gantry('<mesh filename="cup.off"/>', {"cup.off": off_file(mesh)})


def test_a_link_in_the_wall_of_a_mesh_is_found_and_one_in_its_hollow_is_not() -> None:
    robot, scene = gantry(BALL), around(tall())
    deep = np.array([0.0, 0.0, -0.3])
    assert first_inside(robot, scene, deep) == ("tool", "cup")
    for place in (IN_THE_HOLLOW, OUTSIDE, [0.19, 0.0, 0.25], [1.0, 1.0, 1.0]):
        assert first_inside(robot, scene, np.array(place)) is None


def test_points_inside_are_those_between_outside_and_hollow() -> None:
    robot, random = gantry(BALL), np.random.default_rng(1)
    local = random.uniform([-0.25, -0.25, -0.45], [0.25, 0.25, 0.25], (200, 3))
    expected = in_cup(local, _BOTTOM)
    assert 50 < expected.sum() < 150
    for T in (np.eye(4), random_transform(random, 0.3)):
        scene, points = around(tall(), T), local @ T[:3, :3].T + T[:3, 3]
        told = [first_inside(robot, scene, p) == ("tool", "cup") for p in points]
        assert told == expected.tolist()


def test_a_pair_that_may_touch_may_be_inside() -> None:
    robot, q = gantry(BALL), np.array([0.0, 0.0, -0.3])
    (solid,) = around(tall()).obstacles
    assert first_inside(robot, Scene((solid,), {("tool", "cup")}), q) is None
    assert first_inside(robot, Scene((solid,), {("tool", "other")}), q) == ("tool", "cup")
    # A second mesh around it that nothing is said about is found.
    both = (solid, Obstacle("twin", solid.shape))
    assert first_inside(robot, Scene(both, {("cup", "tool")}), q) == ("tool", "twin")


def test_an_open_surface_has_nothing_inside() -> None:
    opened = tall()
    opened.update_faces(np.arange(len(opened.faces)) != 0)
    robot, scene, random = gantry(BALL), around(opened), np.random.default_rng(5)
    for q in random.uniform([-0.2, -0.2, -0.4], [0.2, 0.2, 0.2], (200, 3)):
        assert first_inside(robot, scene, q) is None


def test_convex_obstacles_are_not_asked_about() -> None:
    """What is inside of them overlaps them: the distance iteration sees that."""
    scene = Scene((obstacle("box", Box(np.ones(3)), [0.0, 0.0, 0.0]),))
    assert first_inside(gantry(BALL), scene, np.zeros(3)) is None
    assert not Checker.of(gantry(BALL), scene).valid(np.zeros(3))


@pytest.mark.parametrize(
    "shape",
    [Sphere(0.02), Box(np.full(3, 0.03)), Capsule(0.01, 0.02), PointCloud(np.zeros((1, 3)), 0.01)],
    ids=lambda shape: type(shape).__name__,
)
def test_an_obstacle_in_a_link_that_is_a_mesh_is_found(shape: Shape) -> None:
    robot = holder(tall())
    far = obstacle("far", Sphere(0.02), [2.0, 0.0, 0.0])
    scene = Scene((far, obstacle("bead", shape, [0.5, 0.0, 0.0])))
    # The tool is moved until the bead is in its floor.
    inside = np.array([0.5, 0.0, 0.3])
    assert first_inside(robot, scene, inside) == ("tool", "bead")
    assert first_inside(robot, scene, np.array([0.5, 0.0, 0.0])) is None
    assert first_inside(robot, scene, np.zeros(3)) is None
    allowed = Scene(scene.obstacles, {("bead", "tool")})
    assert first_inside(robot, allowed, inside) is None


def test_every_ball_of_a_cloud_counts() -> None:
    robot, random = holder(tall()), np.random.default_rng(2)
    points = random.uniform(0.4, 1.0, (50, 3))
    for k in (0, 17, 49):
        cloud = Scene((Obstacle("cloud", PointCloud(points, 1e-3)),))
        assert first_inside(robot, cloud, points[k] + [0.0, 0.0, 0.3]) == ("tool", "cloud")


def test_a_halfspace_is_inside_of_nothing() -> None:
    floor = Obstacle("floor", HalfSpace(np.array([0.0, 0.0, 1.0]), 0.0))
    assert first_inside(holder(tall()), Scene((floor,)), np.array([0.0, 0.0, 0.3])) is None


def test_a_mesh_within_a_mesh_is_found_by_either() -> None:
    """A small cup in the floor of a large one: both have triangles, and neither crosses."""
    small = tall().apply_scale(0.1)
    q = np.array([0.0, 0.0, -0.3])
    assert first_inside(holder(small), around(tall()), q) == ("tool", "cup")
    # The other way round: the obstacle is in the link.
    assert first_inside(holder(tall()), around(small), -q) == ("tool", "cup")
    assert first_inside(holder(small), around(tall()), np.array(IN_THE_HOLLOW)) is None


def test_two_links_of_one_arm() -> None:
    """A ball that hangs from the first slide in a mesh that the last one carries, and reversed."""
    robot = holder(tall())
    for pin in (Sphere(0.02), Box(np.full(3, 0.01))):
        arm = robot.attach(obstacle("pin", pin, [0.0, 0.0, 0.0]), "x")
        inside = np.array([0.0, 0.0, 0.3])
        assert first_inside(arm, Scene(), inside) == ("pin", "tool")
        assert first_inside(arm, Scene(), np.zeros(3)) is None
        assert first_inside(arm, Scene((), {("pin", "tool")}), inside) is None
        # Only the joints between the two count.
        assert first_inside(arm, Scene(), np.array([0.7, 0.0, 0.3])) == ("pin", "tool")
    arm = gantry(BALL).attach(Obstacle("shell", mesh_shape(tall())), "x")
    assert first_inside(arm, Scene(), np.array([0.3, 0.0, -0.3])) == ("tool", "shell")
    assert first_inside(arm, Scene(), np.array([0.3, 0.0, 0.0])) is None


def test_what_stands_with_the_base_is_not_compared_with_obstacles() -> None:
    robot = gantry(BALL).attach(obstacle("post", Sphere(0.02), [0.0, 0.0, -0.3]), "base")
    assert first_inside(robot, around(tall()), np.array(OUTSIDE)) is None


def test_each_body_of_a_mesh_counts() -> None:
    """Two balls as one mesh: the tool is in the wall when only the second one is."""
    bead = trimesh.creation.icosphere(subdivisions=1, radius=0.02)
    for shifts in ([0.0, 1.0], [1.0, 0.0]):
        bodies = [bead.copy().apply_translation([shift, 0.0, 0.0]) for shift in shifts]
        robot = holder(trimesh.util.concatenate(bodies))
        for q in ([0.0, 0.0, -0.3], [-1.0, 0.0, -0.3]):
            assert first_inside(robot, around(tall()), np.array(q)) == ("tool", "cup")
        assert first_inside(robot, around(tall()), np.array([-0.5, 0.0, -0.3])) is None


def test_each_body_that_one_cover_holds_counts() -> None:
    """Two sheets far apart in one cover: a point of each is looked up."""
    sheet = 0.01 * np.array([[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]])
    for shifts in ([0.0, 1.0], [1.0, 0.0]):
        triangles = np.concatenate([sheet + np.array([shift, 0.0, 0.0]) for shift in shifts])
        surface = Surface(triangles, triangles[:, 0])
        cover = Piece(PieceKind.POLYTOPE, np.eye(4), triangles.reshape(-1, 3), surface=surface)
        robot = replace(gantry(BALL), pieces=(cover,))
        for q in ([0.0, 0.0, -0.3], [-1.0, 0.0, -0.3]):
            assert first_inside(robot, around(tall()), np.array(q)) == ("tool", "cup")
        assert first_inside(robot, around(tall()), np.array([-0.5, 0.0, -0.3])) is None


def test_the_checker_refuses_what_is_inside_as_well() -> None:
    """Two ways to one verdict: by rays of the kernel, and by winding numbers."""
    robot, scene, random = gantry(BALL), around(tall()), np.random.default_rng(3)
    checker = Checker.of(robot, scene)
    inside = 0
    for q in random.uniform([-0.25, -0.25, -0.45], [0.25, 0.25, 0.25], (120, 3)):
        if first_inside(robot, scene, q) is not None:
            assert not checker.valid(q)
            inside += 1
        elif checker.valid(q):
            assert checker.clearance(q)[0] > 0.0
    assert inside > 20
