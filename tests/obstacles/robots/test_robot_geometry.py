"""A robot's solid: its pieces, the pairs that are checked and their margins."""

import pickle
import re
from typing import Any

import numpy as np
import pytest
import trimesh

import armwright as aw
from kinematics.errors import InvalidLinkName, InvalidOption, InvalidRobotDescription
from kinematics.forward import link_poses
from kinematics.model.chain import Chain
from kinematics.pose import transform
from kinematics.robots import builtin_names, builtin_srdf, builtin_urdf
from kinematics.tree.description import RobotDescription
from kinematics.tree.serial_chain import serial_chain
from kinematics.tree.srdf import Semantics, parse_srdf
from kinematics.urdf.urdf import parse_urdf
from obstacles.collision.checker import Checker
from obstacles.collision.fcl_distance import FclWorld, OverlapMeter
from obstacles.convex.piece import PieceKind
from obstacles.distance.signed_distance import signed_distance
from obstacles.robots.allowed_pairs import allowed_pairs, deepest
from obstacles.robots.finger_geometry import with_fingers
from obstacles.robots.link_margins import with_margins
from obstacles.robots.robot_geometry import RobotGeometry, robot_geometry
from obstacles.robots.touching_pairs import always_touching, suspected_pairs
from obstacles.scenes.scene import Scene
from planning.configuration_check import configuration_checker
from planning.options import Options
from planning.pipeline.pipeline import plan
from planning.problem import JointGoal, Problem
from planning.result import Plan
from tests.planning.scenes import HOME, builtin


def link(name: str, *solids: str) -> str:
    body = "".join(
        f'<collision><origin xyz="0.2 0 0"/><geometry>{s}</geometry></collision>' for s in solids
    )
    return f'<link name="{name}">{body}</link>'


def joint(name: str, parent: str, child: str, kind: str = "revolute", xyz: str = "0.4 0 0") -> str:
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{xyz}"/><axis xyz="0 0 1"/>'
        '<limit lower="-3" upper="3" velocity="1" effort="1"/></joint>'
    )


BAR = '<box size="0.45 0.05 0.05"/>'
BALL = '<sphere radius="0.03"/>'
#: base - j1 - one - j2 - bare (no solid) - fixed - two - j3 - three - fixed - tool
URDF = (
    '<robot name="snake">'
    + link("base", '<box size="0.3 0.3 0.1"/>')
    + link("one", BAR)
    + link("bare")
    + link("two", BAR, BALL)
    + link("three", '<cylinder radius="0.03" length="0.4"/>')
    + link("tool", BALL)
    + joint("j1", "base", "one", xyz="0 0 0.2")
    + joint("j2", "one", "bare")
    + joint("mount", "bare", "two", "fixed", "0 0 0.1")
    + joint("j3", "two", "three")
    + joint("flange", "three", "tool", "fixed", "0 0 0.3")
    + "</robot>"
)


def built(
    urdf: str = URDF, meshes: Any = None, semantics: Semantics | None = None
) -> tuple[RobotGeometry, Chain, RobotDescription]:
    description = parse_urdf(urdf)
    chain = serial_chain(description)
    return robot_geometry(chain, description, meshes, semantics), chain, description


def test_pieces_follow_their_links() -> None:
    geometry, chain, _ = built()
    assert geometry.links == ("base", "one", "two", "two", "three", "tool")
    assert geometry.joints.tolist() == [-1, 0, 1, 1, 2, 2]
    kinds = [PieceKind.POLYTOPE] * 4 + [PieceKind.CYLINDER, PieceKind.POLYTOPE]
    assert [piece.kind for piece in geometry.pieces] == kinds

    random = np.random.default_rng(0)
    world = FclWorld(geometry, Scene())
    for q in random.uniform(-3.0, 3.0, (10, 3)):
        world.set_configuration(q)
        poses = dict(zip((k.name for k in chain.links), link_poses(chain, q), strict=True))
        for i, name in enumerate(geometry.links):
            expected = poses[name] @ transform(None, [0.2, 0.0, 0.0])
            np.testing.assert_allclose(world._poses[i], expected, atol=1e-12)


def test_neighbours_are_allowed_across_links_without_solids() -> None:
    geometry, _, _ = built()
    assert geometry.allowed == {
        ("base", "one"): "adjacent",
        ("one", "two"): "adjacent",
        ("three", "two"): "adjacent",
        ("three", "tool"): "same body",
    }
    checked = {tuple(geometry.links[k] for k in pair) for pair in geometry.self_pairs}
    assert checked == {
        ("base", "two"), ("base", "three"), ("base", "tool"), ("one", "three"), ("one", "tool"),
        ("two", "tool"),
    }  # fmt: skip


def test_what_always_touches_is_allowed_and_what_never_did_is_not() -> None:
    # A slab on the first link that the last ones are in wherever they turn.
    slab = '<box size="3 3 0.5"/>'
    geometry, _, _ = built(URDF.replace(link("one", BAR), link("one", slab)))
    assert geometry.allowed[("one", "three")] == "always"
    # The base is too low to be met by the others, but nothing proves it.
    assert ("base", "two") not in geometry.allowed


def test_the_srdf_decides_where_there_is_one() -> None:
    text = (
        '<robot name="snake"><disable_collisions link1="two" link2="base" reason="Never"/>'
        '<disable_collisions link1="gripper" link2="base" reason="Never"/></robot>'
    )
    geometry, _, _ = built(semantics=parse_srdf(text))
    assert geometry.allowed[("base", "two")] == "srdf"
    assert ("base", "one") not in geometry.allowed
    assert geometry.allowed[("three", "tool")] == "same body"
    silent, _, _ = built(semantics=parse_srdf('<robot name="snake"/>'))
    assert silent.allowed[("base", "one")] == "adjacent"


def test_the_hash_follows_the_content() -> None:
    geometry, _, _ = built()
    again, _, _ = built()
    assert geometry == again
    assert hash(geometry) == hash(again)
    copy = pickle.loads(pickle.dumps(geometry))
    assert copy == geometry
    np.testing.assert_array_equal(copy.self_pairs, geometry.self_pairs)
    longer, _, _ = built(URDF.replace('length="0.4"', 'length="0.5"'))
    looser, _, _ = built(semantics=Semantics("snake", frozenset({("base", "two")})))
    assert len({geometry.content_hash, longer.content_hash, looser.content_hash}) == 3


def mesh_urdf(uri: str, scale: str = "1 1 1") -> str:
    return URDF.replace(BALL, f'<mesh filename="{uri}" scale="{scale}"/>', 1)


def test_meshes_are_scaled_hulls_of_the_bytes_given() -> None:
    data = trimesh.creation.box([100.0, 200.0, 300.0]).export(file_type="stl")
    urdf = mesh_urdf("package://snake/meshes/part.stl", "0.001 -0.001 0.001")
    for meshes in ({"package://snake/meshes/part.stl": data}, lambda _: data):
        geometry, _, _ = built(urdf, meshes)
        piece = geometry.pieces[3]
        np.testing.assert_allclose(np.ptp(piece.vertices, axis=0), [0.1, 0.2, 0.3], atol=1e-9)
        assert geometry.lint == ()


def test_a_mesh_that_is_not_convex_is_reported() -> None:
    legs = [trimesh.creation.box([0.1, 0.1, 1.0]).apply_translation([x, 0, 0]) for x in (0, 1)]
    data = trimesh.util.concatenate(legs).export(file_type="stl")
    geometry, _, _ = built(mesh_urdf("fork.stl"), {"fork.stl": data})
    assert geometry.links.count("two") == 3
    (sentence,) = geometry.lint
    assert "'two'" in sentence
    assert "2 convex pieces" in sentence


def test_solids_that_may_be_in_millimetres_are_told() -> None:
    data = trimesh.creation.box([30.0, 40.0, 300.0]).export(file_type="stl")
    geometry, _, _ = built(mesh_urdf("part.stl"), {"part.stl": data})
    (sentence,) = geometry.lint
    assert "'part.stl' is 300 m long" in sentence
    assert 'scale="0.001 0.001 0.001"' in sentence
    rod = '<cylinder radius="30" length="400"/>'
    urdf = URDF.replace('<cylinder radius="0.03" length="0.4"/>', rod).replace(
        '<box size="0.3 0.3 0.1"/>', '<box size="30 30 0.1"/>'
    )
    # A floor may be that large: it does not move.
    (sentence,) = built(urdf)[0].lint
    assert "'three': its solid is 400 m long" in sentence
    assert "metres" in sentence


@pytest.mark.parametrize(("uri", "meshes"), [
    ("part.stl", None),
    ("part.stl", {}),
    ("part.stl", {"other.stl": b""}),
    ("part.stl", {"part.stl": b""}),
    ("part.stl", {"part.stl": b"PK\x03\x04"}),
    ("part.dae", {"part.dae": b"<COLLADA/>"}),
])  # fmt: skip
def test_a_mesh_that_is_missing_or_unreadable_is_told(uri: str, meshes: Any) -> None:
    with pytest.raises(InvalidRobotDescription, match=r"part\."):
        built(mesh_urdf(uri), meshes)


def test_a_header_without_triangles_is_no_solid() -> None:
    geometry, _, _ = built(mesh_urdf("frame.stl"), {"frame.stl": bytes(80)})
    whole, _, _ = built()
    assert len(geometry.pieces) == len(whole.pieces) - 1
    assert "'frame.stl' of link 'two'" in geometry.lint[0]
    assert "left out" in geometry.lint[0]


def test_a_robot_without_solids_says_so() -> None:
    _, chain, description = built()
    bare, _, _ = built(URDF.replace("collision", "visual"))
    for geometry in (robot_geometry(chain), bare):
        assert geometry.pieces == ()
        assert geometry.self_pairs.shape == (0, 2)
        assert "no collision geometry" in geometry.lint[0]
    assert description.links


@pytest.mark.parametrize("name", builtin_names())
def test_builtin_robots_are_free_somewhere_without_their_srdf_too(name: str) -> None:
    """Whatever is checked can be apart: nothing that is left in would always collide."""
    description = parse_urdf(builtin_urdf(name))
    chain = serial_chain(description, semantics=parse_srdf(builtin_srdf(name)))
    geometry = robot_geometry(chain, description, {})
    lower, upper = chain.sampling_bounds()
    random = np.random.default_rng(0)
    blocked = {(int(i), int(j)) for i, j in geometry.self_pairs}
    arrays = geometry.arrays

    world = FclWorld(geometry, Scene())
    for q in random.uniform(lower, upper, (20, chain.n)):
        world.set_configuration(q)
        touching = set()
        for i, j in blocked:
            balls = np.linalg.norm(world._centers[i] - world._centers[j])
            if balls > arrays.radii[i] + arrays.radii[j]:
                continue
            pieces = geometry.pieces
            bounds = signed_distance(pieces[i], world._poses[i], pieces[j], world._poses[j])
            if bounds[0] <= 0.0:
                touching.add((i, j))
        blocked = touching
    assert not blocked


#: Three links of balls on a line: the first and the third touch where the elbow is bent enough.
ARM = """<robot name="arm"><link name="base"/>
<link name="one"><collision><geometry><sphere radius="{one}"/></geometry></collision></link>
<link name="two"><collision><origin xyz="0.5 0 0"/><geometry><sphere radius="0.01"/></geometry>
</collision></link>
<link name="three"><collision><origin xyz="{at} 0 0"/><geometry><sphere radius="0.1"/></geometry>
</collision></link>
<joint name="a" type="revolute"><parent link="base"/><child link="one"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" velocity="1" effort="1"/></joint>
<joint name="b" type="revolute"><parent link="one"/><child link="two"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" velocity="1" effort="1"/></joint>
<joint name="c" type="revolute"><parent link="two"/><child link="three"/><axis xyz="0 0 1"/>
<origin xyz="1 0 0"/><limit lower="{low}" upper="3" velocity="1" effort="1"/></joint></robot>"""


def arm(one: float = 0.1, at: float = 1.0, low: float = -3.0) -> RobotGeometry:
    description = parse_urdf(ARM.format(one=one, at=at, low=low))
    return robot_geometry(serial_chain(description), description)


def test_a_pair_that_touches_in_the_zero_pose_is_suspected() -> None:
    # The third ball lies on the first one where the elbow is straight.
    assert suspected_pairs(arm(at=-1.0)) == {("one", "three"): "zero pose"}
    # Beyond a limit the configuration nearest to 0 counts.
    assert suspected_pairs(arm(at=-1.0, low=2.0)) == {}
    assert suspected_pairs(arm()) == {}


def test_a_pair_that_touches_in_a_named_state_is_suspected() -> None:
    robot = arm()
    folded = RobotGeometry(
        robot.chain, robot.pieces, robot.links, robot.joints, robot.solids, robot.allowed,
        robot.lint, {"folded": np.array([0.0, 0.0, 3.1])},
    )  # fmt: skip
    assert suspected_pairs(folded) == {("one", "three"): "state 'folded'"}


def test_pairs_that_touch_nearly_always_are_told_and_always_ones_allowed() -> None:
    # A large ball: the third one leaves it only where the elbow is nearly straight.
    nearly = arm(one=1.898)
    assert nearly.allowed.get(("one", "three")) is None
    assert suspected_pairs(nearly)[("one", "three")] == "nearly always"
    assert arm(one=2.0).allowed[("one", "three")] == "always"
    assert always_touching(arm(), {}) == set()


def test_pairs_that_touch_often_are_told_with_how_often() -> None:
    # The third ball is in the first one where |elbow| is above 2 acos((one + 0.1) / 2), of 3.
    for radius in (0.9, 1.3, 1.5):
        share = 1.0 - 2.0 * np.arccos(0.5 * (radius + 0.1)) / 3.0
        found = suspected_pairs(arm(one=radius))
        if share < 0.35:
            assert found == {}
            continue
        told = re.fullmatch(r"in (\d+) of 100 random configurations", found[("one", "three")])
        assert told is not None
        assert abs(int(told[1]) - 100.0 * share) < 15.0


PANDA = builtin("panda")
HAND = aw.fk(PANDA, HOME, "panda_hand")


def test_requests_count_before_touch_links_and_these_before_scenes() -> None:
    table = aw.Obstacle("table", aw.Box([0.2, 0.2, 0.2]), aw.pose([0.9, 0.0, 0.0]))
    part = aw.Obstacle("part", aw.Box([0.02, 0.02, 0.02]), aw.pose([0.0, 0.0, 0.3]))
    scene = aw.Scene([table], [("part", "table"), ("panda_link5", "table")])
    touching = aw.Attachment(part, "panda_hand", ("table",), 0.003)
    held = aw.hold(PANDA, scene, [touching])
    asked = aw.hold(
        PANDA, scene, [touching], {("part", "table"): aw.AllowedContact("request", 0.02)}
    )
    for holding, reason, depth in ((held, "touch_links", 0.003), (asked, "request", 0.02)):
        found = {item.pair: item for item in allowed_pairs(holding.robot, holding.scene)}
        assert found["part", "table"][1:] == (reason, depth, True)
        assert found["panda_link5", "table"][1:] == ("scene", np.inf, True)
        assert not found["panda_link3", "panda_link4"].measured
    # What is nowhere in the cell is not told: matrices name whatever their author had.
    more = aw.Scene([table], [("camera", "table"), ("panda_link5", "camera")])
    assert {item.pair for item in allowed_pairs(PANDA, more)} == set(PANDA.allowed)


def test_hashes_of_scenes_tell_depths_apart() -> None:
    made = [
        aw.Scene(),
        aw.Scene([], [("a", "b")]),
        *(aw.Scene(contacts={("b", "a"): aw.AllowedContact("scene", d)}) for d in (0.1, 0.2)),
    ]
    assert len({scene.content_hash for scene in made}) == 4
    assert {scene.obstacles_hash for scene in made} == {made[0].content_hash}
    assert made[2].allows("a", "b")
    assert made[2].hash_allowing([("a", "b")]) == made[1].content_hash


@pytest.mark.parametrize("seed", range(30))
def test_a_ball_in_a_box_is_as_deep_as_it_is(seed: int) -> None:
    random = np.random.default_rng(seed)
    ball = aw.Obstacle("ball", aw.Sphere(0.04), aw.pose([0.0, 0.0, 0.25]))
    center = (HAND @ ball.T_world_obstacle)[:3, 3]
    # A block that is large beside the ball, of which only the upper face is near.
    depth = random.uniform(-0.01, 0.04)
    top = center[2] - 0.04 + depth
    block = aw.Obstacle("block", aw.Box([0.4, 0.4, 0.2]), aw.pose([*center[:2], top - 0.1]))
    limit = random.uniform(0.0, 0.04)
    holding = aw.hold(
        PANDA, aw.Scene([block]), [aw.Attachment(ball, "panda_hand", ("block",), limit)]
    )
    meter = OverlapMeter(holding.robot, holding.scene)
    told = {item.pair: item.overlap for item in meter.report([meter.depths(HOME)])}
    assert told["ball", "block"] == pytest.approx(max(depth, 0.0), abs=1e-6)
    assert told["panda_link3", "panda_link4"] is None
    report = configuration_checker(holding.robot, holding.scene).check(HOME)
    verdict = configuration_checker(holding.robot, holding.scene).verdict(HOME)
    assert report.valid == verdict.valid == (depth <= limit)
    if depth > limit:
        assert report.collisions[0].pair == verdict.collisions[0].pair == ("ball", "block")
        assert report.collisions[0].depth == pytest.approx(depth, abs=1e-6)
        plan = aw.plan(holding.robot, holding.scene, HOME, HOME + 0.1)
        assert isinstance(plan, aw.Failure)
        assert plan.code == "START_STATE_IN_COLLISION"
        assert "touch_depth" in plan.message
        assert plan.details["pair"] == ["ball", "block"]
        assert plan.details["touch_depth"] == limit


def test_of_several_motions_the_deepest_counts() -> None:
    one = aw.Scene([aw.Obstacle("a", aw.Sphere(0.1), HAND)], [("panda_hand", "a")])
    meter = OverlapMeter(PANDA, one)
    shallow, deep = meter.report([meter.depths(HOME + 0.1)]), meter.report([meter.depths(HOME)])
    depths = [{item.pair: item.overlap for item in told} for told in (shallow, deep)]
    merged = {item.pair: item.overlap for item in deepest(shallow, deep)}
    pair = ("a", "panda_hand")
    assert merged[pair] == max(depths[0][pair] or 0.0, depths[1][pair] or 0.0) > 0.0
    assert merged.keys() == depths[0].keys()


UR = aw.load_robot("ur5e")
JAW = aw.mount(UR, aw.built_in_tool("parallel_jaw", "jaw"))


def far_enough(
    robot: aw.RobotGeometry, scene: aw.Scene, q: np.ndarray, kept: dict[str, float], own: float
) -> float:
    """How much the tightest pair has to spare, by FCL [m]."""
    world = FclWorld(robot, scene)
    world.set_configuration(q)
    least = np.inf
    for k, (i, j) in enumerate(world.pairs.tolist()):
        between = j < len(robot.pieces)
        asked = own if between else kept.get(robot.links[i], 0.0)
        least = min(least, world.distance(k) - asked)
    return least


@pytest.mark.parametrize("own", [0.0, 0.004])
def test_links_keep_what_is_asked_for_and_no_more(own: float) -> None:
    random = np.random.default_rng(38)
    kept = {"forearm_link": 0.1, "wrist_3_link": 0.03}
    arm = with_margins(UR, kept, own)
    lower, upper = UR.chain.sampling_bounds()
    agreed = {True: 0, False: 0}
    for _ in range(150):
        at = [*random.uniform(-0.6, 0.6, 2), random.uniform(0.1, 0.8)]
        scene = aw.Scene([aw.Obstacle("ball", aw.Sphere(0.08), aw.pose(at))])
        q = random.uniform(lower, upper)
        spare = far_enough(UR, scene, q, kept, own)
        if abs(spare) < 1e-6:
            continue
        valid = Checker.of(arm, scene).valid(q)
        # Shells are about the convex solids that cover a link: a little more than it.
        assert not valid if spare < 0.0 else valid or spare < 0.01, (spare, q)
        agreed[valid] += 1
    assert min(agreed.values()) > 20


def test_a_plan_is_proved_with_the_margin_of_a_link() -> None:
    scene = aw.Scene([aw.Obstacle("post", aw.Cylinder(0.05, 1.0), aw.pose([0.55, 0.0, 0.5]))])
    arm = with_margins(UR, {"wrist_3_link": 0.05})
    ends = np.array([[-0.9, -1.2, 1.4, -1.7, -1.57, 0.0], [0.9, -1.2, 1.4, -1.7, -1.57, 0.0]])
    found = plan(Problem(arm, scene, ends[0], (JointGoal(ends[1]),)), Options(timeout=20.0))
    assert isinstance(found, Plan), found
    assert found.certificate.verified
    states = found.trajectory.sample(np.linspace(0.0, found.trajectory.duration, 120))
    least = min(far_enough(UR, scene, q, {"wrist_3_link": 0.05}, 0.0) for q in states)
    assert least > 0.0


def test_a_tool_stands_for_its_parts_and_shells_may_touch_what_their_links_may() -> None:
    with pytest.raises(InvalidOption, match="a finger that moves"):
        with_margins(JAW, {"jaw": 0.02})
    torch = aw.mount(UR, aw.built_in_tool("torch", "torch"))
    arm = with_margins(torch, {"torch": 0.02}, 0.001)
    assert "torch/margin" in arm.names
    q = np.array([0.0, -1.4, 1.5, -1.67, -1.57, 0.0])
    tip = aw.fk(arm, q)[:3, 3]
    wall = aw.Scene([aw.Obstacle("wall", aw.Box((0.5, 0.5, 0.02)),
                                 aw.pose([tip[0], tip[1], tip[2] - 0.011]))])  # fmt: skip
    assert Checker.of(torch, wall).valid(q)
    assert not Checker.of(arm, wall).valid(q)
    touching = aw.hold(arm, wall, [], [("torch", "wall")])
    assert Checker.of(touching.robot, touching.scene).valid(q)


def test_own_margins_of_fingers_move_with_them() -> None:
    arm = with_margins(JAW, {}, 0.002)
    closed = with_fingers(arm, {"jaw/opening": 0.0})
    assert not any(name.startswith("jaw/left/") for name in arm.names)
    q = np.array([0.0, -1.4, 1.5, -1.67, -1.57, 0.0])
    assert Checker.of(closed, aw.Scene()).valid(q)


def test_unknown_links_are_refused() -> None:
    with pytest.raises(InvalidLinkName, match="'elbow' is no link with solids"):
        with_margins(UR, {"elbow": 0.1})
