"""What a robot holds, against FCL on solids that this file places by itself."""

from dataclasses import replace

import fcl
import numpy as np
import pytest

from kinematics.errors import InvalidLinkName, InvalidObjectName, InvalidScene
from kinematics.forward import link_poses
from kinematics.pose import from_rpy, inverse, transform
from kinematics.tree.serial_chain import serial_chain
from kinematics.tree.srdf import parse_srdf
from kinematics.urdf.urdf import parse_urdf
from obstacles.collision.checker import Checker
from obstacles.collision.fcl_distance import FclWorld
from obstacles.robots.allowed_pairs import allowed_pairs
from obstacles.robots.attachment import Attachment, Holding, grasp, hold, release
from obstacles.robots.robot_geometry import RobotGeometry, robot_geometry
from obstacles.scenes.scene import Obstacle, Scene
from obstacles.shapes.shape import Box, Sphere
from tests.obstacles.robots.test_robot_geometry import BAR, joint, link

#: Two bars and a stub of a hand that all turn about z, and tilt at the wrist.
URDF = (
    '<robot name="crane">'
    + link("base")
    + link("upper", BAR)
    + link("lower", BAR)
    + link("hand")
    + joint("j1", "base", "upper", xyz="0 0 0.2")
    + joint("j2", "upper", "lower", xyz="0.45 0 0.06")
    + joint("j3", "lower", "hand", xyz="0.45 0 0").replace('"0 0 1"', '"0 1 0"')
    + "</robot>"
)
SIZES = {"upper": (0.45, 0.05, 0.05), "lower": (0.45, 0.05, 0.05)}
ROD, BALL = (0.3, 0.04, 0.04), 0.06
T_HAND_ROD = transform(from_rpy([0.2, 0.4, -0.3]), [0.2, 0.02, 0.0])
T_LOWER_BALL = transform(None, [0.2, 0.0, 0.1])
TABLE, T_TABLE = (1.4, 0.3, 0.1), transform(from_rpy([0.1, 0.2, 0.3]), [0.3, 0.55, 0.25])


def crane(srdf: str | None = None) -> RobotGeometry:
    description = parse_urdf(URDF)
    semantics = None if srdf is None else parse_srdf(srdf)
    chain = serial_chain(description, tip_link="hand")
    return robot_geometry(chain, description, semantics=semantics)


def holding(scene: Scene, **more: tuple[str, ...]) -> Holding:
    rod = Attachment(Obstacle("rod", Box(np.array(ROD)), T_HAND_ROD), "hand", more.get("rod", ()))
    ball = Attachment(Obstacle("ball", Sphere(BALL), T_LOWER_BALL), "lower", more.get("ball", ()))
    return hold(crane(), scene, [rod, ball])


def table(margin: float = 0.0) -> Scene:
    return Scene((Obstacle("table", Box(np.array(TABLE)), T_TABLE, margin),))


def fcl_distance(a: tuple[str, np.ndarray], b: tuple[str, np.ndarray]) -> float:
    """Distance of two bodies in micrometres' resolution, negative for any overlap."""
    objects = []
    for name, T in (a, b):
        size = {"rod": ROD, "table": TABLE, **SIZES}.get(name)
        shape = fcl.Sphere(1e5 * BALL) if size is None else fcl.Box(*(1e5 * np.array(size)))
        objects.append(fcl.CollisionObject(shape, fcl.Transform(T[:3, :3], 1e5 * T[:3, 3])))
    if fcl.collide(*objects, fcl.CollisionRequest(), fcl.CollisionResult()):
        return -1.0
    return float(fcl.distance(*objects, fcl.DistanceRequest(), fcl.DistanceResult())) / 1e5


#: All that must be looked at: each attached object against the scene, the other one, and the links
#: that do not hold it.
PAIRS = [
    ("rod", "table"), ("ball", "table"), ("upper", "table"), ("lower", "table"),
    ("rod", "ball"), ("rod", "upper"), ("rod", "lower"), ("ball", "upper"),
]  # fmt: skip


def poses(q: np.ndarray) -> dict[str, np.ndarray]:
    upper, lower, hand = link_poses(crane().chain, q, ["upper", "lower", "hand"])
    shift = transform(None, [0.2, 0.0, 0.0])
    return {
        "upper": upper @ shift,
        "lower": lower @ shift,
        "rod": hand @ T_HAND_ROD,
        "ball": lower @ T_LOWER_BALL,
        "table": T_TABLE,
    }


@pytest.mark.parametrize("margin", [0.0, 0.03])
def test_attached_objects_meet_the_scene_the_robot_and_each_other(margin: float) -> None:
    held = holding(table(margin))
    checker, world = Checker.of(held.robot, held.scene), FclWorld(held.robot, held.scene)
    random = np.random.default_rng(3)
    seen = set()
    for q in random.uniform(-3.0, 3.0, (150, 3)):
        placed = poses(q)
        distances = {
            (a, b): fcl_distance((a, placed[a]), (b, placed[b])) - (margin if b == "table" else 0.0)
            for a, b in PAIRS
        }
        pair, least = min(distances.items(), key=lambda item: item[1])
        if abs(least) < 1e-6:
            continue
        assert checker.valid(q) == (least > 0.0)
        found = world.clearance(q)
        if least > 0.0:
            assert checker.clearance(q)[0] == pytest.approx(least, abs=1e-6)
            assert found.distance == pytest.approx(least, abs=1e-6)
        else:
            inside = {frozenset(pair) for pair, gap in distances.items() if gap < -1e-6}
            assert inside <= {frozenset(hit.pair) for hit in world.collisions(q)}
            seen |= inside
        assert (found.distance > 0.0) == (least > 0.0)
        assert pair in PAIRS
    assert {frozenset(p) for p in (("rod", "table"), ("rod", "ball"))} <= seen


def test_what_may_touch_is_not_looked_at() -> None:
    free = holding(table(), rod=("table", "upper", "ball"), ball=("upper",))
    pairs = FclWorld(free.robot, free.scene)
    checked = {frozenset(pairs.pair_names(k)) for k in range(len(pairs.pairs))}
    assert checked == {
        frozenset(pair)
        for pair in [("ball", "table"), ("upper", "table"), ("lower", "table"), ("rod", "lower")]
    }
    by_request = hold(free.robot, free.scene, (), [("ball", "table")])
    left = FclWorld(by_request.robot, by_request.scene)
    assert len(left.pairs) == len(pairs.pairs) - 1


GROUPS = (
    '<robot name="crane"><group name="bars"><joint name="j1"/><link name="lower"/></group>'
    '<group name="arm"><chain base_link="base" tip_link="hand"/></group>'
    '<group name="upper"><link name="lower"/></group></robot>'
)


@pytest.mark.parametrize(
    ("pair", "meant"),
    [
        (("bars", "table"), {("upper", "table"), ("lower", "table")}),
        (("table", "arm"), {("upper", "table"), ("lower", "table")}),
        (("upper", "table"), {("upper", "table")}),  # a link counts before a group of its name
        (("bars", "*"), {(a, b) for a, b in PAIRS if {a, b} & {"upper", "lower"}}),
        (("rod", "bars"), {("rod", "upper"), ("rod", "lower")}),
    ],
)
def test_a_group_stands_for_its_links(pair: tuple[str, str], meant: set[tuple[str, str]]) -> None:
    robot = crane(GROUPS)
    told = [line for line in robot.lint if "group 'upper' of the SRDF has the name of" in line]
    assert len(told) == 1
    objects = [
        Attachment(Obstacle("rod", Box(np.array(ROD)), T_HAND_ROD), "hand"),
        Attachment(Obstacle("ball", Sphere(BALL), T_LOWER_BALL), "lower"),
    ]
    held = hold(robot, table(), objects, [pair])
    listed = {item.pair for item in allowed_pairs(held.robot, held.scene) if item.reason != "srdf"}
    assert {tuple(sorted(pair)) for pair in meant} <= listed
    of_scene = hold(robot, replace(table(), allowed_collisions=frozenset({pair})), objects)
    left = [pair for pair in PAIRS if pair not in meant]
    checkers = [Checker.of(one.robot, one.scene) for one in (held, of_scene)]
    random, verdicts = np.random.default_rng(5), set()
    for q in random.uniform(-3.0, 3.0, (150, 3)):
        placed = poses(q)
        least = min(fcl_distance((a, placed[a]), (b, placed[b])) for a, b in left)
        if abs(least) < 1e-6:
            continue
        verdicts.add(least > 0.0)
        assert [checker.valid(q) for checker in checkers] == [least > 0.0] * 2
    assert verdicts == {True, False}


def test_a_group_is_no_obstacle_and_unknown_names_are_refused_with_the_nearest() -> None:
    robot = crane(GROUPS)
    with pytest.raises(InvalidObjectName, match="'barz'; is 'bars' meant"):
        hold(robot, table(), (), [("barz", "table")])
    with pytest.raises(InvalidObjectName, match="'tabel'; is 'table' meant"):
        hold(robot, table(), (), [("bars", "tabel")])
    bars = Scene((Obstacle("bars", Box(np.array(TABLE)), T_TABLE),))
    assert hold(robot, bars).scene.ids == ("bars",)
    with pytest.raises(InvalidScene, match="could mean either"):
        hold(robot, bars, (), [("bars", "upper")])


def test_from_grasp_to_release_it_is_one_object() -> None:
    robot, q = crane(), np.array([0.4, -0.6, 0.2])
    stands = Obstacle("rod", Box(np.array(ROD)), transform(from_rpy([0, 0, 1.0]), [0.9, 0.1, 0.3]))
    scene = Scene((*table().obstacles, stands))
    taken, T = grasp(robot, scene, "rod", "hand", q)
    hand = link_poses(robot.chain, q, ["hand"])[0]
    np.testing.assert_allclose(hand @ T, stands.T_world_obstacle, atol=1e-12)
    attachment = Attachment(taken, "hand")
    held = hold(robot, scene, [attachment])
    assert held.scene.ids == ("table",)
    later = np.array([-1.0, 0.3, 0.5])
    there, put = release(robot, held.scene, attachment, later)
    moved = link_poses(robot.chain, later, ["hand"])[0] @ inverse(hand)
    np.testing.assert_allclose(put.T_world_obstacle, moved @ stands.T_world_obstacle, atol=1e-12)
    assert there.ids == ("table", "rod")
    # What was grasped stands in the same place for the checks, held or not.
    before, after = FclWorld(robot, scene), FclWorld(held.robot, held.scene)
    for name in ("upper", "lower"):
        expected = before.distance_between(q, (name, "rod"))
        if name != "lower":
            assert after.distance_between(q, (name, "rod")) == pytest.approx(expected, abs=1e-7)
    assert after.distance_between(q, ("rod", "table")) == pytest.approx(
        fcl_distance(("rod", stands.T_world_obstacle), ("table", T_TABLE)), abs=1e-6
    )


def test_names_that_nobody_has() -> None:
    rod = Obstacle("rod", Box(np.array(ROD)), T_HAND_ROD)
    with pytest.raises(InvalidLinkName, match="hook"):
        hold(crane(), Scene(), [Attachment(rod, "hand", ("hook",))])
    with pytest.raises(InvalidLinkName, match="hook"):
        hold(crane(), Scene(), [Attachment(rod, "hook")])
    with pytest.raises(InvalidObjectName, match="hook"):
        hold(crane(), Scene(), (), [("hand", "hook")])
    with pytest.raises(InvalidObjectName, match="rod"):
        grasp(crane(), Scene(), "rod", "hand", np.zeros(3))
    with pytest.raises(InvalidScene, match="name"):
        hold(crane(), Scene(), [Attachment(rod, "hand"), Attachment(rod, "lower")])
