"""Solids of DH tables: placed by forward kinematics written here, judged by FCL itself."""

import fcl
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from kinematics.arrays import Array
from kinematics.errors import InvalidRobotDescription
from kinematics.forward import joint_frames
from kinematics.model.dh import Convention, DhRow, DhTable
from obstacles.collision.checker import Checker
from obstacles.collision.fcl_distance import FclWorld
from obstacles.robots.dh_geometry import LinkSolid, dh_robot_geometry
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.scenes.scene import Obstacle, Scene
from obstacles.shapes.shape import HalfSpace, Sphere

RADIUS = 0.05


def turn(axis: str, angle: float) -> Array:
    T = np.eye(4)
    T[:3, :3] = Rotation.from_euler(axis, angle).as_matrix()
    return T


def shift(x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Array:
    T = np.eye(4)
    T[:3, 3] = x, y, z
    return T


def skeleton(table: DhTable, q: Array) -> tuple[list[Array], list[tuple[Array, Array]]]:
    """Frames 0 to n of a table at q, and the two segments of every row, in the world."""
    T, frames, segments = table.base, [table.base], []
    for row, value in zip(table.rows, q, strict=True):
        theta, d = row.theta, row.d
        theta, d = (theta + value, d) if row.type == "revolute" else (theta, d + value)
        along_z = turn("z", theta) @ shift(z=d)
        along_x = shift(x=row.a) @ turn("x", row.alpha)
        first, last = (along_z, along_x) if table.convention == "standard" else (along_x, along_z)
        corners = [T[:3, 3], (T @ first)[:3, 3], (T @ first @ last)[:3, 3]]
        segments += [(corners[0], corners[1]), (corners[1], corners[2])]
        T = T @ first @ last
        frames.append(T)
    return frames, segments


def random_table(random: np.random.Generator, convention: Convention, prismatic: bool) -> DhTable:
    rows = [
        DhRow(
            type="prismatic" if prismatic and i == 2 else "revolute",
            a=float(random.choice([0.0, 0.3, -0.2])),
            alpha=float(random.uniform(-2.0, 2.0)),
            d=float(random.choice([0.0, 0.25, -0.3])),
            theta=float(random.uniform(-2.0, 2.0)),
            lower=-0.2 if prismatic and i == 2 else -2.5,
            upper=0.4 if prismatic and i == 2 else 2.5,
        )
        for i in range(4)
    ]
    base = turn("y", random.uniform(-1.0, 1.0)) @ shift(*random.normal(size=3) * 0.2)
    return DhTable(convention, tuple(rows), base)


def fcl_distance(a: Array, b: Array, point: Array, radius: float) -> float:
    """Distance by FCL of a capsule of RADIUS about a segment from a ball, in micrometres inside."""
    units = 1e5
    ball = fcl.CollisionObject(fcl.Sphere(units * radius), fcl.Transform(units * point))
    length = float(np.linalg.norm(b - a))
    z = (b - a) / length
    x = np.cross(z, [1.0, 0.0, 0.0] if abs(z[0]) < 0.9 else [0.0, 1.0, 0.0])
    x /= np.linalg.norm(x)
    R = np.column_stack([x, np.cross(z, x), z])
    solid = fcl.Capsule(units * RADIUS, units * length)
    capsule = fcl.CollisionObject(solid, fcl.Transform(R, units * 0.5 * (a + b)))
    return float(fcl.distance(capsule, ball)) / units


@pytest.mark.parametrize("convention", ["standard", "modified"])
def test_capsules_about_revolute_links_are_those_that_fcl_sees(convention: Convention) -> None:
    random = np.random.default_rng(1)
    touching = clear = 0
    for _ in range(6):
        table = random_table(random, convention, prismatic=False)
        robot = dh_robot_geometry("arm", table, capsule_radius=RADIUS)
        for _ in range(8):
            q = random.uniform(-2.5, 2.5, 4)
            _, segments = skeleton(table, q)
            # What stands still with the base is not compared with obstacles.
            still = 1 if convention == "modified" else 0
            moving = [(a, b) for a, b in segments[still:] if np.linalg.norm(b - a) > 1e-9]
            point = moving[random.integers(len(moving))][1] + random.normal(size=3) * 0.1
            scene = Scene((Obstacle("ball", Sphere(0.04), shift(*point)),))
            distances = [fcl_distance(a, b, point, 0.04) for a, b in moving]
            expected = min(distances)
            world = FclWorld(robot, scene)
            world.set_configuration(q)
            obstacle = world.pairs[:, 1] >= len(robot.pieces)
            distance = min(world.distance(int(k)) for k in np.flatnonzero(obstacle))
            free = Checker.of(robot, Scene(scene.obstacles, self_pairs(robot))).valid(q)
            if expected > 1e-6:
                clear += 1
                assert distance == pytest.approx(expected, abs=1e-6)
                assert free
            else:
                touching += 1
                assert distance <= 1e-6
                assert not free
    assert touching > 5
    assert clear > 5


def self_pairs(robot: RobotGeometry) -> frozenset[tuple[str, str]]:
    names = robot.names
    return frozenset((a, b) for a in names for b in names if a < b)


@pytest.mark.parametrize("convention", ["standard", "modified"])
@pytest.mark.parametrize("offset", [0.5, 0.1, -0.9], ids=["ahead", "across", "behind"])
def test_capsules_of_prismatic_links_cover_the_skeleton(
    convention: Convention, offset: float
) -> None:
    random = np.random.default_rng(2)
    for _ in range(4):
        table = random_table(random, convention, prismatic=True)
        row = DhRow("prismatic", 0.3, 0.7, offset, 0.4, lower=-0.2, upper=0.4)
        rows = (*table.rows[:2], row, table.rows[3])
        table = DhTable(convention, rows, table.base)
        robot = dh_robot_geometry("arm", table, capsule_radius=RADIUS)
        for extension in (-0.2, 0.0, 0.1, 0.4):
            q = np.array([*random.uniform(-2.5, 2.5, 2), extension, random.uniform(-2.5, 2.5)])
            _, segments = skeleton(table, q)
            carried = robot_pieces(robot, q)
            for a, b in segments:
                if np.linalg.norm(b - a) < 1e-9:
                    continue
                for share in np.linspace(0.0, 1.0, 11):
                    point = a + share * (b - a)
                    assert min(axis_distance(c, point) for c in carried) < 1e-9


def robot_pieces(robot: RobotGeometry, q: Array) -> list[tuple[Array, Array]]:
    """Ends of all capsules' axes in the world, placed by the chain."""
    frames = [np.eye(4), *joint_frames(robot.chain, q)]
    ends = []
    for piece, joint in zip(robot.pieces, robot.joints, strict=True):
        T = frames[joint + 1] @ piece.T_owner_piece
        first, last = (T[:3, :3] @ corner + T[:3, 3] for corner in piece.vertices)
        ends.append((first, last))
    return ends


def axis_distance(ends: tuple[Array, Array], point: Array) -> float:
    a, b = ends
    share = np.clip((point - a) @ (b - a) / ((b - a) @ (b - a)), 0.0, 1.0)
    return float(np.linalg.norm(point - a - share * (b - a)))


def test_neighbours_may_touch_and_the_others_may_not() -> None:
    rows = [DhRow("revolute", 0.5, 0.0, 0.0, 0.0, lower=-3.0, upper=3.0) for _ in range(3)]
    robot = dh_robot_geometry("arm", DhTable("standard", tuple(rows)), capsule_radius=RADIUS)
    assert dict(robot.allowed) == {
        ("link_1", "link_2"): "adjacent",
        ("link_2", "link_3"): "adjacent",
    }
    checker = Checker.of(robot, Scene())
    assert checker.valid(np.array([0.0, 0.3, 0.3]))
    assert not checker.valid(np.array([0.0, 2.6, 2.6]))


ROW = DhRow("revolute", 0.5, 0.0, 0.0, 0.0, lower=-3.0, upper=3.0)


def test_what_is_refused() -> None:
    table = DhTable("standard", (ROW, ROW))
    with pytest.raises(InvalidRobotDescription, match="given for 1 rows, the DH table has 2"):
        dh_robot_geometry("arm", table, [[]])
    with pytest.raises(InvalidRobotDescription, match=r"geometry\.capsules.*radius"):
        dh_robot_geometry("arm", table, capsule_radius=-0.1)
    floor = [[], [LinkSolid(HalfSpace(np.array([0.0, 0.0, 1.0]), 0.0))]]
    with pytest.raises(InvalidRobotDescription, match="row 2 of the DH table, geometry 1: a half"):
        dh_robot_geometry("arm", table, floor)
    sliding = DhTable("standard", (ROW, DhRow("prismatic", d=0.1, lower=-np.inf, upper=np.inf)))
    with pytest.raises(InvalidRobotDescription, match="row 2 of the DH table: a prismatic joint"):
        dh_robot_geometry("arm", sliding, capsule_radius=0.1)
