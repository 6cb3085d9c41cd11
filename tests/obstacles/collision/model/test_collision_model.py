"""The packed robot and scene: pairs, their groups, margins and brackets."""

import itertools

import numpy as np
import pytest

from benchmarks.judges.fcl import FclJudge
from benchmarks.planning.scale import room
from benchmarks.verdict import certify_all, clutter, verdicts_on
from kinematics.arrays import Array
from kinematics.forward import joint_frames
from kinematics.robots import builtin_names
from obstacles.collision.checker import Checker
from obstacles.collision.edge_check import COLLIDING, FREE
from obstacles.collision.fcl_distance import FclWorld
from obstacles.collision.model.collision_model import CollisionModel
from obstacles.collision.model.model_arrays import ModelArrays
from obstacles.collision.model.pair_grid import grid_bound
from obstacles.collision.model.pair_groups import (
    FIRST_PAIR,
    GROUP_SIZE,
    LAST_PAIR,
    PARTED,
    whole_groups,
)
from obstacles.convex.piece import Piece, PieceKind
from obstacles.distance.signed_distance import halfspace_distance, signed_distance
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.scenes.scene import Obstacle, Scene
from obstacles.shapes.shape import Box, HalfSpace, PointCloud, Sphere
from tests.obstacles.arms import builtin, cut_arm, gantry, obstacle
from tests.obstacles.outline import convex_shapes
from tests.obstacles.solids import random_transform

BALL = '<sphere radius="0.1"/>'
UP = np.array([0.0, 0.0, 1.0])


def mixed(seed: int) -> Scene:
    """Solids of every convex kind with margins, two clouds and two half-spaces, mixed."""
    random = np.random.default_rng(seed)
    shapes = [
        *convex_shapes(random), HalfSpace(UP, -0.7), PointCloud(random.normal(size=(5, 3)), 0.05),
        HalfSpace(-UP, -1.5), PointCloud(random.normal(size=(3, 3)), 0.02),
    ]  # fmt: skip
    names = random.permutation(len(shapes))
    return Scene(
        Obstacle(f"o{k}", shapes[k], random_transform(random, 0.8), 0.01 * k) for k in names
    )


def pairs_of(robot: RobotGeometry, scene: Scene) -> list[tuple[int, int, int]]:
    """Every pair that must stay apart as (pair number, piece, other piece), by definition."""
    owners, p = scene.pieces()[1], len(robot.pieces)
    m = len(owners)
    pairs = [
        (i * m + k, i, p + k)
        for i, k in itertools.product(range(p), range(m))
        if robot.joints[i] >= 0 and not scene.allows(robot.links[i], scene.ids[owners[k]])
    ]
    own = CollisionModel(robot, scene).arrays.self_pairs
    return pairs + [(p * m + s, int(i), int(j)) for s, (i, j) in enumerate(own)]


def distances(robot: RobotGeometry, scene: Scene, margin: float, q: Array) -> dict[int, float]:
    """Upper bounds of signed distances of all pairs less their margins, by Qhull."""
    frames = np.concatenate([np.eye(4)[None], joint_frames(robot.chain, q)])[robot.joints + 1]
    placed = [piece.placed(T) for piece, T in zip(robot.pieces, frames, strict=True)]
    placed += [scene.piece(k) for k in range(len(scene.pieces()[1]))]
    margins = np.concatenate([np.zeros(len(frames)), scene.pieces()[2] + margin])
    return {pair: apart(placed[i], placed[j]) - margins[j] for pair, i, j in pairs_of(robot, scene)}


def apart(a: Piece, b: Piece) -> float:
    """Signed distance of two pieces by Qhull [m], b perhaps a half-space."""
    if b.kind == PieceKind.HALFSPACE:
        return halfspace_distance(a, a.T_owner_piece, b.T_owner_piece)
    return signed_distance(a, a.T_owner_piece, b, b.T_owner_piece)[1]


@pytest.mark.parametrize(("name", "seed"), [("planar_rr", 0), ("scara", 1), ("kr6_sixx", 2)])
def test_near_pairs_are_all_that_are_near_with_their_margins_off(name: str, seed: int) -> None:
    """Each pair by itself, against an independent distance of each two pieces."""
    robot, scene, random = builtin(name), mixed(seed), np.random.default_rng(seed)
    checker = Checker.of(robot, scene, 0.02)
    q = random.uniform(*robot.chain.sampling_bounds())
    expected = distances(robot, scene, 0.02, q)
    near = checker.gradient(q, 0.3)
    told = dict(zip(near.pairs.tolist(), near.distances.tolist(), strict=True))
    assert len(told) == len(near.pairs) > 3
    assert {k for k, d in expected.items() if d < 0.3 - 1e-5} <= set(told)
    for pair, distance in told.items():
        assert distance == pytest.approx(expected[pair], abs=1e-5)


@pytest.mark.parametrize("name", ["planar_rr", "scara", "ur5e", "panda"])
def test_own_pairs_are_those_of_the_robot_but_for_what_the_scene_allows(name: str) -> None:
    robot = builtin(name)
    all_own = {frozenset(map(int, pair)) for pair in robot.self_pairs}
    packed = CollisionModel(robot, Scene()).arrays.self_pairs
    assert {frozenset(map(int, pair)) for pair in packed} == all_own
    assert len(packed) == len(robot.self_pairs)
    names = sorted({tuple(sorted((robot.links[i], robot.links[j]))) for i, j in robot.self_pairs})
    for a, b in names[:12]:
        fewer = CollisionModel(robot, Scene((), {(b, a)})).arrays
        left = {frozenset(map(int, pair)) for pair in fewer.self_pairs}
        assert left == {pair for pair in all_own if {robot.links[k] for k in pair} != {a, b}}
        # Groups still cover them one behind the other, each of two bodies.
        spans = [tuple(group[:2]) for group in fewer.groups]
        assert [first for first, _ in spans] == [0, *(last for _, last in spans)][: len(spans)]
        assert not spans or spans[-1][1] == len(fewer.self_pairs)
        for first, last, *_ in fewer.groups:
            joints = robot.joints[fewer.self_pairs[first:last]]
            assert (joints == joints[0]).all()


def test_a_link_and_an_obstacle_of_one_name_are_two() -> None:
    """A pair of a scene's names means both ways to read them."""
    robot = gantry(BALL)
    scene = Scene((obstacle("tool", Sphere(0.1), np.zeros(3)),))
    assert not Checker.of(robot, scene).valid(np.zeros(3))
    assert Checker.of(robot, Scene(scene.obstacles, {("tool", "tool")})).valid(np.zeros(3))


def test_a_link_may_be_in_a_halfspace_that_it_is_allowed_to_touch() -> None:
    robot, floor = gantry(BALL), Obstacle("floor", HalfSpace(UP, 0.0))
    below = np.array([0.0, 0.0, -0.5])
    assert not Checker.of(robot, Scene((floor,))).valid(below)
    allowed = Checker.of(robot, Scene((floor,), {("floor", "tool")}))
    assert allowed.valid(below)
    assert allowed.free(-below, below)
    assert allowed.clearance(below) == (np.inf, None)
    # With something else to meet, the floor still does not count.
    both = Scene((floor, obstacle("ball", Sphere(0.1), [1.0, 0.0, -0.5])), {("floor", "tool")})
    clearance, pair = Checker.of(robot, both).clearance(below)
    assert clearance == pytest.approx(0.8)
    assert pair == ("tool", "ball")
    assert Checker.of(robot, both).free(-below, below)


def states_of(robot: RobotGeometry, random: np.random.Generator, count: int) -> Array:
    return random.uniform(*robot.chain.sampling_bounds(), (count, robot.chain.n))


def verdicts(checker: Checker, states: Array) -> tuple[Array, Array, int]:
    """By brackets and exact tests on what they leave, by the walk over motions, and how many."""
    ours, edges = np.empty(len(states)), np.empty(len(states))
    asked = verdicts_on(checker.model.arrays, states, checker.slack, ours)
    certify_all(checker.model.arrays, states, 0.0 * states, edges)
    return ours, edges, asked


@pytest.mark.parametrize("name", builtin_names())
def test_brackets_tell_what_fcl_tells(name: str) -> None:
    robot, random = builtin(name), np.random.default_rng(61)
    reach = float(np.linalg.norm(robot.chain.offsets[:, :3, 3], axis=1).sum()) + 0.1
    told = 0
    for scene in (clutter(random, reach), clutter(random, reach)):
        checker, judge = Checker.of(robot, scene), FclJudge(robot, scene)
        states = states_of(robot, random, 40)
        ours, edges, _ = verdicts(checker, states)
        assert (ours == edges).all()
        for q, verdict in zip(states, ours, strict=True):
            bracket = checker.bracket(q)
            assert not (bracket.free and bracket.colliding)
            told += bracket.free or bracket.colliding
            assert not bracket.free or not bracket.flagged
            assert not bracket.free or verdict == FREE
            assert not bracket.colliding or verdict == COLLIDING
            assert bracket.free or bracket.colliding or bracket.flagged
            assert not bracket.free or not judge.collides(q)
            assert not bracket.colliding or judge.collides(q)
            assert checker.valid(q) == (verdict == FREE)
    assert told > 20


def test_margins_slack_and_allowed_pairs() -> None:
    robot, random = builtin("ur5e"), np.random.default_rng(62)
    plain = clutter(random, 1.0)
    states = states_of(robot, random, 150)
    few = Scene(
        tuple(
            Obstacle(o.id, o.shape, o.T_world_obstacle, random.uniform(0.0, 0.05))
            for o in plain.obstacles
        ),
        allowed_collisions=frozenset(
            [("forearm_link", "o1"), ("floor", "shoulder_link"), ("wrist_1_link", "wrist_3_link")]
        ),
    )
    for scene, margin, slack in ((plain, 0.0, 0.0), (few, 0.02, 0.0), (few, 0.0, 0.01)):
        checker = Checker(Checker.of(robot, scene, margin).model, slack)
        ours, found = verdicts(checker, states)[0], np.empty(len(states))
        for k, q in enumerate(states):
            motion = checker.segment(q, q)
            found[k] = FREE if motion.free else COLLIDING if motion.colliding else 2.0
        assert (ours == found).all()
        assert 0 < (ours == FREE).sum() < len(states)


def test_a_robot_that_holds_something() -> None:
    random = np.random.default_rng(63)
    held = Obstacle("held", Box(np.array([0.3, 0.02, 0.2])), random_transform(random, 0.1))
    arm = builtin("iiwa14")
    robot = arm.attach(held, arm.chain.tip.name)
    walls = (Obstacle("wall", HalfSpace(np.array([1.0, 0.0, 0.0]), -0.4)),)
    balls = tuple(Obstacle(f"b{k}", Sphere(0.1), random_transform(random, 0.6)) for k in range(6))
    checker = Checker.of(robot, Scene(walls + balls))
    ours, edges, _ = verdicts(checker, states_of(robot, random, 200))
    assert (ours == edges).all()
    assert 0 < (ours == FREE).sum() < 200


def test_near_contact_the_verdict_is_the_exact_one() -> None:
    # A ball is moved until it all but touches: brackets leave these pairs, or are right.
    robot, random = builtin("kr6_sixx"), np.random.default_rng(64)
    for q in states_of(robot, random, 25):
        place = random_transform(random, 0.4)
        far = Checker.of(robot, Scene((Obstacle("ball", Sphere(0.001), place),)))
        bare = Checker.of(robot, Scene())
        distance = far.clearance(q)[0] + 0.001
        if not bare.valid(q) or bare.clearance(q)[0] < distance or distance < 0.01:
            continue
        for more, verdict in ((-2e-6, True), (2e-6, False)):
            ball = Obstacle("ball", Sphere(distance + more), place)
            assert Checker.of(robot, Scene((ball,))).valid(q) == verdict


def test_most_states_need_no_exact_test() -> None:
    robot, random = builtin("ur5e"), np.random.default_rng(65)
    checker = Checker.of(robot, room(random, 100_000))
    states = states_of(robot, random, 300)
    ours, edges, asked = verdicts(checker, states)
    assert (ours == edges).all()
    assert asked < 20 * len(states)


def test_a_link_without_volume() -> None:
    sheet = np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.0, 0.1, 0.0]])
    arm = builtin("planar_rr")
    flat = RobotGeometry(
        arm.chain, (Piece(PieceKind.POLYTOPE, np.eye(4), sheet),), (arm.links[-1],),
        np.array([1]), np.array([0]), {},
    )  # fmt: skip
    random = np.random.default_rng(66)
    ball = Obstacle("ball", Sphere(0.3), random_transform(random, 0.5))
    ours, edges, _ = verdicts(Checker.of(flat, Scene((ball,))), states_of(flat, random, 200))
    assert (ours == edges).all()


ARM = cut_arm()


def arrays() -> ModelArrays:
    return CollisionModel(ARM, Scene()).arrays


def size(groups: np.ndarray, group: int) -> int:
    """How many groups one and those that part it are."""
    return int(groups[group, GROUP_SIZE]) if groups[group, PARTED] < 0 else 1


def pair_groups_pairs_of(groups: np.ndarray, group: int) -> tuple[int, int]:
    """The first pair of a group and of those that part it, and the number after the last."""
    inside = groups[group : group + size(groups, group)]
    whole = inside[inside[:, PARTED] >= 0]
    return int(whole[:, FIRST_PAIR].min()), int(whole[:, LAST_PAIR].max())


def states(count: int, seed: int) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-np.pi, np.pi, (count, ARM.chain.n))


def test_leaves_hold_every_pair_once_and_parents_what_is_in_them() -> None:
    groups = arrays().groups
    assert max(size(groups, group) for group in range(len(groups))) > 40
    leaves = groups[groups[:, PARTED] >= 0]
    numbers = np.concatenate([np.arange(a, b) for a, b in leaves[:, : LAST_PAIR + 1]])
    assert numbers.tolist() == list(range(len(ARM.self_pairs)))
    ours = {frozenset(pair) for pair in arrays().self_pairs.tolist()}
    assert ours == {frozenset(pair) for pair in ARM.self_pairs.tolist()}
    tops, end = whole_groups(groups).tolist(), 0
    for top in tops:
        first, last = pair_groups_pairs_of(groups, top)
        assert first == end
        end = last
    assert end == len(ARM.self_pairs)
    assert tops[0] == 0
    for group in np.flatnonzero(groups[:, PARTED] < 0).tolist():
        part, end = group + 1, pair_groups_pairs_of(groups, group)[0]
        while part < group + size(groups, group):
            first, last = pair_groups_pairs_of(groups, part)
            assert first == end
            part, end = part + size(groups, part), last
        assert part == group + size(groups, group)
        assert end == pair_groups_pairs_of(groups, group)[1]


def test_no_verdict_on_a_state_differs_from_fcl() -> None:
    checker, world = Checker.of(ARM, Scene()), FclWorld(ARM, Scene())
    drawn = states(400, 2)
    truth = []
    for q in drawn:
        world.set_configuration(q)
        truth.append(not world.collisions(q))
    assert 60 < sum(truth) < 340
    assert [checker.valid(q) for q in drawn] == truth
    assert checker.each_valid(drawn).tolist() == truth


@pytest.mark.parametrize("name", builtin_names())
def test_what_the_grid_proves_is_true(name: str) -> None:
    robot = builtin(name)
    arrays = Checker.of(robot, Scene()).model.arrays
    world = FclWorld(robot, Scene())
    rows = {frozenset(map(int, pair)): k for k, pair in enumerate(world.pairs)}
    random = np.random.default_rng(41)
    lower, upper = robot.chain.sampling_bounds()
    useful = compared = 0
    for _ in range(60):
        q = random.uniform(lower, upper)
        world.set_configuration(q)
        for s, (i, j) in enumerate(arrays.self_pairs):
            if arrays.grid_axes[s, 0, 2] == 0.0:
                continue
            proved = grid_bound(
                arrays.grid_axes, arrays.grid_starts, arrays.grid_values, s,
                int(arrays.joints[i]), q[None],
            )  # fmt: skip
            true = world.distance(rows[frozenset((int(i), int(j)))])
            assert proved <= max(true, 0.0) + 1e-9
            compared += 1
            useful += proved > 0.0 or true <= 0.02
    assert useful >= 0.6 * compared


@pytest.mark.parametrize("name", builtin_names())
def test_pairs_that_get_a_grid_are_those_that_balls_do_not_part(name: str) -> None:
    """Against a look at each pair by itself, from frames of the whole chain."""
    robot = builtin(name)
    arrays, chain = Checker.of(robot, Scene()).model.arrays, robot.chain
    lower, upper = chain.limits.lower, chain.limits.upper
    for s, (i, j) in enumerate(arrays.self_pairs):
        first, last = int(arrays.joints[i]) + 1, int(arrays.joints[j])
        moving = np.arange(first, min(last, chain.n - 1) + 1)
        span = upper[moving] - lower[moving]
        if last >= chain.n or len(moving) > 2 or not np.isfinite(span).all():
            assert arrays.grid_axes[s, 0, 2] == 0.0
            continue
        (a, a_radius), (b, b_radius) = (robot.pieces[k].bounding_sphere() for k in (i, j))
        apart = []
        for shares in itertools.product((0.05, 0.35, 0.65, 0.95), repeat=len(moving)):
            q = np.zeros(chain.n)
            q[moving] = lower[moving] + np.array(shares) * span
            frames = np.concatenate([np.eye(4)[None], joint_frames(chain, q)])
            A, B = frames[first], frames[last + 1]
            apart.append(np.linalg.norm(A[:3] @ [*a, 1.0] - B[:3] @ [*b, 1.0]))
        assert (arrays.grid_axes[s, 0, 2] > 0.0) == (min(apart) < a_radius + b_radius)
