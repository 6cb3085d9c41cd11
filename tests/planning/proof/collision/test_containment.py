"""Solids that meshes contain, against where they are known to be."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from kinematics.arrays import Array
from kinematics.pose import transform
from kinematics.trajectory.trajectory import stay
from obstacles.collision.checker import Checker
from obstacles.convex.piece import Piece, PieceKind, Surface
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.scenes.scene import Obstacle, Scene
from obstacles.shapes.shape import (
    Box,
    Capsule,
    Compound,
    HalfSpace,
    Mesh,
    PointCloud,
    Shape,
    Sphere,
)
from planning.proof.certificate import certify
from planning.proof.collision.containment import first_inside, open_meshes
from planning.proof.collision.mesh_solids import mesh_solids
from tests.obstacles.arms import cup, gantry, in_cup, mesh_shape, obstacle, off_file
from tests.obstacles.bodies import (
    HOSTS,
    assembly,
    bowl,
    cracked,
    ell,
    hollow_box,
    moved,
    sheet,
    small_torus,
)
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


def test_each_body_that_one_cover_holds_counts() -> None:
    """Two sheets far apart in one cover: a point of each is looked up."""
    sheet = 0.01 * np.array([[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]])
    for shifts in ([0.0, 1.0], [1.0, 0.0]):
        triangles = np.concatenate([sheet + np.array([shift, 0.0, 0.0]) for shift in shifts])
        surface = Surface(triangles, triangles[:, 0], triangles)
        cover = Piece(PieceKind.POLYTOPE, np.eye(4), triangles.reshape(-1, 3), surface=surface)
        robot = replace(gantry(BALL), pieces=(cover,))
        for q in ([0.0, 0.0, -0.3], [-1.0, 0.0, -0.3]):
            assert first_inside(robot, around(tall()), np.array(q)) == ("tool", "cup")
        assert first_inside(robot, around(tall()), np.array([-0.5, 0.0, -0.3])) is None


def verified(robot: RobotGeometry, scene: Scene, q: Array) -> bool:
    motion = stay(robot.chain.joint_names, q, 1.0)
    return certify(motion, robot, scene).verified


def small_things(random: np.random.Generator) -> list[Shape]:
    """Solids that fit into the walls of all hosts; of the last one only one body is there."""
    bodies = [small_torus(), *(moved(small_torus(), [4.0 + 0.1 * k, 4.0, 0.0]) for k in range(80))]
    many = trimesh.util.concatenate([bodies[k] for k in random.permutation(len(bodies))])
    return [Sphere(0.02), Box([0.03, 0.02, 0.03]), mesh_shape(ell(0.03)), mesh_shape(many)]


def carrying(shape: Shape) -> RobotGeometry:
    """A gantry whose last link is one solid."""
    if isinstance(shape, Mesh):
        return holder(trimesh.Trimesh(shape.vertices, shape.faces, process=False))
    if isinstance(shape, Sphere):
        return gantry(BALL)
    assert isinstance(shape, Box)
    return gantry(f'<box size="{" ".join(map(str, shape.size))}"/>')


@pytest.mark.parametrize("role", ["obstacle", "link", "attached"])
@pytest.mark.parametrize("host", HOSTS)
def test_planners_and_proof_see_what_is_inside_of_any_body(host: str, role: str) -> None:
    """Whatever other bodies a mesh has, and whichever of many bodies of the other is inside."""
    random = np.random.default_rng([*host.encode(), *role.encode()])
    made, at = assembly(random, host), np.array([0.1, 0.2, 0.3])
    thing = small_things(random)[random.integers(4)]
    for place, is_inside in ((made.inside, True), (made.free, False)):
        if role == "obstacle":
            robot, q = carrying(thing), at + place
            scene = Scene((obstacle("cell", made.shape(), at),))
        else:
            q, scene = at - place, Scene((obstacle("thing", thing, at),), {("thing", "tool")})
            robot = gantry(BALL).attach(Obstacle("held", made.shape()), "tool", ["tool"])
            if role == "link":
                robot, scene = carrying(made.shape()), Scene(scene.obstacles)
        assert Checker.of(robot, scene).valid(q) != is_inside
        assert verified(robot, scene, q) != is_inside


def test_the_proof_does_not_ask_planners_which_bodies_are_closed() -> None:
    """Covers of which none bounds a solid, with a point of one body each: planners are deceived."""
    hidden = trimesh.util.concatenate([cup(_BOTTOM), small_torus(), sheet(5.0)])
    robot, scene = gantry(BALL), around(hidden)
    (told,) = scene.obstacles
    lied = tuple(
        replace(piece, surface=replace(piece.surface, place=0, count=0))
        if piece.surface is not None else piece
        for piece in told.pieces()
    )  # fmt: skip
    object.__setattr__(told, "_pieces", lied)
    deep = np.array([0.0, 0.0, -0.3])
    assert Checker.of(robot, scene).valid(deep)
    assert not verified(robot, scene, deep)
    assert verified(robot, scene, np.array([0.0, 0.0, 1.0]))


def test_open_meshes_are_told_by_name() -> None:
    closed, opened = mesh_shape(tall()), mesh_shape(trimesh.util.concatenate([tall(), bowl(1.0)]))
    scene = Scene((
        Obstacle("closed", closed), Obstacle("opened", opened), Obstacle("ball", Sphere(0.1)),
        Obstacle("flat", mesh_shape(sheet(1.0))),
    ))  # fmt: skip
    assert open_meshes(gantry(BALL), scene) == ("opened", "flat")
    robot = holder(bowl(0.1)).attach(Obstacle("held", opened), "tool")
    assert open_meshes(robot, Scene()) == ("tool", "held")
    assert open_meshes(holder(tall()).attach(Obstacle("held", closed), "tool"), Scene()) == ()


def test_a_certificate_names_open_meshes_among_its_premises() -> None:
    scene = Scene((Obstacle("bowl", mesh_shape(bowl(0.1)), np.eye(4)),))
    robot = gantry(BALL)
    certificate = certify(stay(robot.chain.joint_names, np.ones(3), 1.0), robot, scene)
    assert certificate.verified
    assert certificate.premises.open_meshes == ("bowl",)


def test_an_open_mesh_of_a_link_is_told_by_its_lint() -> None:
    assert any("'cup.off' is open" in line for line in holder(bowl(0.1)).lint)
    assert not any("open" in line for line in holder(tall()).lint)


def test_each_mesh_of_an_object_of_several_solids_counts() -> None:
    floor, wall = HalfSpace(np.array([0.0, 0.0, 1.0]), -5.0), mesh_shape(tall())
    places = [np.eye(4), transform(None, [0.0, 0.0, 0.0]), transform(None, [1.0, 0.0, 0.0])]
    scene = Scene((Obstacle("two", Compound((floor, wall, wall), tuple(places))),))
    robot = gantry(BALL)
    for x, is_inside in ((0.0, True), (1.0, True), (0.5, False)):
        q = np.array([x, 0.0, -0.3])
        assert (first_inside(robot, scene, q) is not None) == is_inside
        assert Checker.of(robot, scene).valid(q) != is_inside
        assert verified(robot, scene, q) != is_inside


def turned_at_random(triangles: Array, random: np.random.Generator) -> Array:
    turned = random.random(len(triangles)) < 0.3
    return np.where(turned[:, None, None], triangles[:, ::-1], triangles)


def test_points_of_a_cup_are_inside_its_walls_and_not_in_its_hollow() -> None:
    random = np.random.default_rng(1)
    triangles = np.array(cup().triangles)
    for written in (triangles, triangles[:, ::-1], turned_at_random(triangles, random)):
        points = random.uniform(-0.25, 0.25, (600, 3))
        np.testing.assert_array_equal(mesh_solids(written).hold(points), in_cup(points))


def test_the_volume_of_all_bodies_is_that_of_the_solids() -> None:
    outer, inner = hollow_box()
    for bodies, volume, opened in (
        ([ell(1.0)], ell(1.0).volume, 0),
        ([outer, inner], outer.volume + inner.volume, 0),
        ([outer, inner, bowl(2.0), sheet(0.1)], outer.volume + inner.volume, 2),
        ([bowl(1.0)], 0.0, 1),
    ):
        found = mesh_solids(np.array(trimesh.util.concatenate(bodies).triangles))
        a, b, c = (found.triangles[:, k] for k in range(3))
        assert np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0 == pytest.approx(volume)
        assert (len(found.points), found.opened) == (len(bodies), opened)


def test_holes_are_closed_by_cones_so_that_winding_numbers_are_whole() -> None:
    ball = trimesh.creation.icosphere(3)
    holed = mesh_solids(np.array(ball.triangles)[10:])
    assert (len(holed.low), holed.opened) == (1, 0)
    points = np.random.default_rng(2).uniform(-1.2, 1.2, (500, 3))
    away = np.linalg.norm(points, axis=1)
    clear = np.abs(away - 1.0) > 0.06
    np.testing.assert_array_equal(holed.hold(points)[clear], (away < 1.0)[clear])
    assert mesh_solids(np.array(ball.triangles)[100:]).opened == 1
    cylinder = mesh_solids(np.array(cracked().triangles))
    assert (len(cylinder.low), cylinder.opened) == (1, 0)
    assert cylinder.hold(np.array([[0.0, 0.0, z] for z in (-0.2, 0.05, 0.4)])).tolist() == [
        True,
        True,
        False,
    ]


@pytest.mark.parametrize("host", HOSTS)
@pytest.mark.parametrize("seed", range(4))
def test_whatever_else_a_mesh_has_its_closed_bodies_keep_their_inside(host: str, seed: int) -> None:
    made = assembly(np.random.default_rng(seed), host)
    found = mesh_solids(made.vertices[made.faces])
    random = np.random.default_rng(seed + 100)
    near = random.uniform(-0.02, 0.02, (20, 3))
    assert found.hold(made.inside + near).all()
    assert not found.hold(made.free + near).any()


def test_overlapping_bodies_are_solid_whichever_way_round_they_are() -> None:
    """The winding numbers of the two would cancel each other where they overlap."""
    one, other = trimesh.creation.box([1.0] * 3), trimesh.creation.box([1.0] * 3)
    other.invert()
    both = trimesh.util.concatenate([one, moved(other, [0.5, 0.0, 0.0])])
    x = np.linspace(-0.9, 1.4, 47)
    points = np.column_stack([x, np.full_like(x, 0.1), np.full_like(x, 0.2)])
    held = mesh_solids(np.array(both.triangles)).hold(points)
    np.testing.assert_array_equal(held, (x > -0.5) & (x < 1.0))


def test_no_points_are_inside_of_anything() -> None:
    assert mesh_solids(np.array(cup().triangles)).hold(np.zeros((0, 3))).shape == (0,)
    assert not mesh_solids(np.array(sheet(1.0).triangles)).hold(np.zeros((3, 3))).any()
