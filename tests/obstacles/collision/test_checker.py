"""Verdicts on states and motions: each other, closed forms, and FCL."""

import itertools
import time

import numpy as np
import pytest

from benchmarks.judges.fcl import FclJudge
from benchmarks.planning.scale import room
from benchmarks.verdict import clutter, judge
from kinematics.arrays import Array
from kinematics.robots import builtin_names
from obstacles.collision.checker import Checker, Motion
from obstacles.collision.edge_check import (
    COLLIDING,
    FREE,
    MAX_INTERVALS,
    UNDECIDED,
    Cubic,
    certify_in,
)
from obstacles.collision.model.kernel_work import workspace
from obstacles.collision.state_check import blocked_at
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.scenes.scene import Obstacle, Scene
from obstacles.shapes.shape import Box, Cylinder, HalfSpace, PointCloud, Sphere
from tests.obstacles.arms import builtin, cup, gantry, in_cup, mesh_shape, obstacle
from tests.obstacles.solids import random_transform

BALL = '<sphere radius="0.1"/>'
#: A wall of which the ball is clear for x < 0.9.
WALL = Scene((obstacle("wall", Box(np.array([0.2, 4.0, 4.0])), [1.1, 0.0, 0.0]),))


def checker(scene: Scene = WALL, slack: float = 0.0, margin: float = 0.0) -> Checker:
    return Checker(Checker.of(gantry(BALL), scene, margin).model, slack)


def states(robot: RobotGeometry, seed: int, count: int) -> Array:
    random = np.random.default_rng(seed)
    return random.uniform(*robot.chain.sampling_bounds(), (count, robot.chain.n))


def arena(robot: RobotGeometry, seed: int) -> Scene:
    reach = float(np.linalg.norm(robot.chain.offsets[:, :3, 3], axis=1).sum()) + 0.1
    return clutter(np.random.default_rng(seed), reach)


def along(x: float, y: float = 0.0, z: float = 0.0) -> Array:
    return np.array([x, y, z])


@pytest.mark.parametrize("name", builtin_names())
def test_the_clearance_is_the_distance_that_fcl_finds(name: str) -> None:
    """Of a robot whose own links may touch, from obstacles; FCL has no distance of half-spaces."""
    robot = builtin(name)
    solids = [o for o in arena(robot, 3).obstacles if not isinstance(o.shape, HalfSpace)]
    scene = Scene(solids, itertools.combinations(robot.names, 2))
    ours, judge = Checker.of(robot, scene), FclJudge(robot, scene)
    apart = 0
    for q in states(robot, 2, 12):
        clearance, pair = ours.clearance(q)
        assert (clearance <= 0.0) == judge.collides(q)
        assert pair is not None
        assert pair[0] in robot.links
        assert pair[1] in scene.ids
        if clearance > 0.0:
            assert clearance == pytest.approx(judge.obstacle_distance(q), abs=1e-6)
            apart += 1
    assert apart > 1


@pytest.mark.parametrize("name", ["scara", "ur5e", "panda"])
def test_all_answers_agree(name: str) -> None:
    robot = builtin(name)
    seen = set()
    for slack in (0.0, 0.03):
        ours = Checker(Checker.of(robot, arena(robot, 3), 0.01).model, slack)
        for q in states(robot, 4, 60):
            clearance, pair = ours.clearance(q)
            free, bracket, near = ours.valid(q), ours.bracket(q), ours.gradient(q, 0.2)
            assert free == (clearance > 0.0)
            assert free == ours.free(q, q) == ours.segment(q, q).free
            assert free == (near.distances > 0.0).all()
            assert not bracket.free or free
            assert not bracket.colliding or not free
            assert pair is not None
            if free and clearance < 0.2:
                closest = int(near.pairs[near.distances.argmin()])
                assert ours.model.pair_name(closest) == pair
            seen.add(free)
    assert seen == {True, False}


@pytest.mark.parametrize("name", ["scara", "ur5e"])
def test_many_states_are_answered_as_one_by_one(name: str) -> None:
    robot, within = builtin(name), 0.05
    solids = Checker.of(robot, arena(robot, 3), 0.01)
    hollow = obstacle("cup", mesh_shape(cup()), [0.5, 0.1, 0.2])
    dented = Scene((hollow,))
    for model in (solids.model, Checker.of(robot, dented).model):
        ours = Checker(model, 0.005)
        many = states(robot, 5, 60)
        valid = [ours.valid(q) for q in many]
        assert 0 < sum(valid) < len(many)
        assert ours.each_valid(many).tolist() == valid
        assert not ours.all_valid(many)
        assert ours.all_valid(many[valid])
        assert ours.closest(many[:0], within) == (within, -1, None)
        near = [ours.clearance(q) for q in many]
        for free in (many[valid], many[valid][::-1], *many[valid, None]):
            distance, state, pair = ours.closest(free, within)
            least = min(ours.clearance(q)[0] for q in free)
            assert distance == pytest.approx(min(least, within), abs=1e-12)
            if least < within:
                clearance, nearest = ours.clearance(free[state])
                assert distance == pytest.approx(clearance, abs=1e-12)
                assert pair == nearest
            else:
                assert (state, pair) == (-1, None)
        distance, state, pair = ours.closest(many, within)
        assert distance <= 0.0
        assert near[state][0] <= 0.0
        assert pair is not None
    assert ours.all_valid(many[:0])


@pytest.mark.parametrize("slack", [0.0, 0.25])
@pytest.mark.parametrize("margin", [0.0, 0.05])
def test_margin_and_slack_come_off_every_answer(margin: float, slack: float) -> None:
    ours, off = checker(slack=slack, margin=margin), margin + slack
    assert ours.clearance(along(0.3))[0] == pytest.approx(0.6 - off)
    assert ours.gradient(along(0.3), 1.0).distances == pytest.approx([0.6 - off])
    motion = ours.segment(along(0.0), along(0.3))
    assert motion.free
    assert 0.0 < motion.clearance <= 0.6 - off + 1e-9
    for x, free in ((0.9 - off - 1e-5, True), (0.9 - off + 1e-5, False)):
        assert ours.valid(along(x)) is free
        assert ours.free(along(0.0), along(x)) is free
        assert ours.polyline(np.array([along(0.0), along(x)]))[0].free is free
        assert ours.bracket(along(x)).free <= free


def test_pairs_within_reach_are_answered_and_those_at_its_end() -> None:
    for within, count in ((0.39, 0), (0.41, 1), (10.0, 1)):
        near = checker().gradient(along(0.5), within)
        assert len(near.pairs) == count
        # Slack makes everything nearer.
        assert len(checker(slack=0.02).gradient(along(0.5), within - 0.02).pairs) == count
        assert near.distances.shape == (count,)
        assert near.gradients.shape == (count, 3)


@pytest.mark.parametrize("count", [63, 64, 65, 300])
def test_however_many_pairs_are_near_all_are_answered(count: int) -> None:
    """The first try has room for 64 of them."""
    points = np.random.default_rng(5).normal(size=(count, 3))
    points *= 0.5 / np.linalg.norm(points, axis=1, keepdims=True)
    ours = checker(Scene((Obstacle("cloud", PointCloud(points, 0.01)),)))
    near = ours.gradient(np.zeros(3), 0.5)
    assert sorted(near.pairs.tolist()) == list(range(count))
    np.testing.assert_allclose(near.distances, 0.39, atol=1e-9)
    np.testing.assert_allclose(near.gradients, -2.0 * points[near.pairs], atol=1e-9)
    # Half of them as far as their distance in one direction.
    some = ours.gradient(along(0.1), 0.39)
    inside = np.linalg.norm(points - along(0.1), axis=1) - 0.11 <= 0.39
    assert sorted(some.pairs.tolist()) == np.flatnonzero(inside).tolist()


def test_a_bracket_flags_the_pairs_it_leaves_open() -> None:
    """However many there are: the first try has room for 64 of them too."""
    assert checker().bracket(along(-2.0)) == (True, False, ())
    assert checker().bracket(along(1.1)).colliding
    # Boxes of which only the corners reach the tool: spheres about them touch, the boxes do not.
    tool = gantry('<box size="0.2 0.2 0.2"/>')
    scene = Scene(
        obstacle(f"b{k}", Box(np.array([0.1, 0.001, 0.001])), [0.1505, 0.0, 0.002 * k - 0.08])
        for k in range(80)
    )
    bracket = Checker.of(tool, scene).bracket(np.zeros(3))
    assert not bracket.free
    assert not bracket.colliding
    assert len(bracket.flagged) > 64
    assert set(bracket.flagged) <= {("tool", name) for name in scene.ids}
    assert Checker.of(tool, scene).valid(np.zeros(3))


def test_a_motion_stops_where_it_first_meets_something() -> None:
    thin = Scene((obstacle("near", Box(np.array([0.02, 4.0, 4.0])), [0.5, 0.0, 0.0]),
                  obstacle("far", Box(np.array([0.02, 4.0, 4.0])), [1.5, 0.0, 0.0])))  # fmt: skip
    ours = checker(thin)
    motion = ours.segment(along(0.0), along(2.0))
    assert motion.colliding
    assert not motion.free
    assert motion.pair == ("tool", "near")
    # In contact from x = 0.39 to 0.61.
    assert 0.39 <= 2.0 * motion.at <= 0.61
    back = ours.segment(along(2.0), along(0.0))
    assert back.pair == ("tool", "far")
    assert 1.39 <= 2.0 - 2.0 * back.at <= 1.61
    free = ours.segment(along(0.75), along(1.25))
    assert (free.free, free.colliding, free.at, free.pair) == (True, False, 1.0, None)
    assert 0.0 < free.clearance <= 0.14 + 1e-9
    assert free.intervals >= 1


def test_a_graze_is_neither_free_nor_colliding() -> None:
    """Along the wall at its margin: no contact was found, and no distance is left to prove."""
    motion = checker().segment(along(0.9, -1.0), along(0.9, 1.0))
    assert not motion.free
    assert motion.pair == ("tool", "wall")
    near = checker().segment(along(0.9 - 1e-5, -1.0), along(0.9 - 1e-5, 1.0))
    assert near.free


@pytest.mark.parametrize("name", builtin_names())
def test_an_edge_has_one_verdict_whoever_asks(name: str) -> None:
    robot = builtin(name)
    ours = Checker.of(robot, arena(robot, 3))
    seen = set()
    ends = states(robot, 7, 40)
    for a, towards in itertools.pairwise(ends):
        b = a + 0.1 * (towards - a)
        motion = ours.segment(a, b)
        assert ours.free(a, b) == motion.free
        zero = np.zeros_like(a)
        assert ours.curve(a, b - a, zero) == ours.curve(a, b - a, zero, zero) == motion
        line, leg = ours.polyline(np.array([a, b]))
        assert (line.free, line.pair, line.at) == (motion.free, motion.pair, motion.at)
        assert motion.free or leg == 0
        if motion.free:
            # Backwards, and each half of it.
            assert ours.segment(b, a).free
            assert ours.free(a, 0.5 * (a + b))
        seen.add(motion.free)
    assert True in seen


def test_a_cubic_is_followed_not_its_chord() -> None:
    """x goes from 0 to 0.5 in a line, y out and back: around a post on the chord."""
    post = Scene((obstacle("post", Sphere(0.1), [0.25, 0.0, 0.0]),))
    ours, zero = checker(post), np.zeros(3)
    assert not ours.free(zero, along(0.5))
    # y = 4 h s (1 - s), 0.5 at the middle.
    around = along(0.0, 4 * 0.5), along(0.0, -4 * 0.5)
    motion = ours.curve(zero, along(0.5) + around[0], around[1])
    assert motion.free
    s = np.linspace(0.0, 1.0, 1001)
    gaps = np.hypot(0.5 * s - 0.25, 2.0 * s * (1.0 - s)) - 0.2
    assert 0.0 < motion.clearance <= gaps.min() + 1e-9
    # With y = 8 s^3 - 8 s^2 it comes back to the chord, and meets what stands at its end.
    end = Scene((*post.obstacles, obstacle("end", Sphere(0.05), [0.5, 0.0, 0.0])))
    bow = along(0.0, -8.0), along(0.0, 8.0)
    assert ours.curve(zero, along(0.5), *bow).free
    assert checker(end).curve(zero, along(0.5), bow[0]).free
    back = checker(end).curve(zero, along(0.5), *bow)
    assert back.pair == ("tool", "end")
    assert back.at > 0.9


def test_nothing_in_the_way_is_free_everywhere() -> None:
    ours = checker(Scene())
    assert ours.clearance(np.zeros(3)) == (np.inf, None)
    assert ours.bracket(np.zeros(3)) == (True, False, ())
    assert ours.gradient(np.zeros(3), 100.0).gradients.shape == (0, 3)
    assert ours.segment(along(-3.0), along(3.0)) == ours.segment(along(0.0), along(0.0))
    assert ours.segment(along(-3.0), along(3.0)).clearance == np.inf


def test_a_mesh_is_as_far_away_as_its_triangles() -> None:
    """In the hollow of a cup its walls are nearer than its hull, which the ball is inside of."""
    robot, scene = gantry('<sphere radius="0.05"/>'), Scene((Obstacle("cup", mesh_shape(cup())),))
    ours = Checker.of(robot, scene)
    for q, gap in ((along(0), 0.1), (along(0.05), 0.05), (along(0, 0, -0.08), 0.02),
                   (along(0, 0, 0.6), np.hypot(0.4, 0.15) - 0.05)):  # fmt: skip
        assert ours.clearance(q)[0] == pytest.approx(gap, abs=1e-6)
    assert not ours.valid(along(0.11))
    assert ours.free(along(0.0, 0.0, 0.5), along(0.0))
    assert ours.segment(along(0.0), along(0.5)).colliding
    random = np.random.default_rng(8)
    points = random.uniform(-0.3, 0.3, (300, 3))
    small = Checker.of(gantry('<sphere radius="0.0001"/>'), scene)
    walls = np.abs(np.abs(points) - 0.2).min(axis=1) > 0.001
    inner = (np.abs(np.abs(points[:, :2]) - 0.15).min(axis=1) > 0.001) & (
        np.abs(points[:, 2] + 0.15) > 0.001
    )
    for q in points[walls & inner]:
        assert small.valid(q) is not bool(in_cup(q[None])[0])


def test_a_floor_is_felt_by_every_link_at_its_height() -> None:
    robot = builtin("planar_rr")
    floor = Scene((Obstacle("floor", HalfSpace(np.array([0.0, 0.0, 1.0]), -2.0)),))
    near = Checker.of(robot, floor).gradient(np.zeros(2), 10.0)
    lowest = {
        Checker.of(robot, floor).model.pair_name(int(pair))[0]: d
        for pair, d in zip(near.pairs, near.distances, strict=True)
    }
    # What stands still with the base is not compared with it.
    moving = {link for link, j in zip(robot.links, robot.joints, strict=True) if j >= 0}
    assert set(lowest) == moving
    assert min(lowest.values()) == pytest.approx(Checker.of(robot, floor).clearance(np.zeros(2))[0])


def few_solids(random: np.random.Generator, count: int = 6) -> Scene:
    obstacles = [Obstacle("floor", HalfSpace(np.array([0.0, 0.0, 1.0]), -0.6))]
    for k in range(count):
        T = random_transform(random, 0.5)
        T[:3, 3] += 0.4 * T[:3, 3] / np.linalg.norm(T[:3, 3])
        shape = [Box(random.uniform(0.05, 0.3, 3)), Sphere(0.1), Cylinder(0.05, 0.4)][k % 3]
        obstacles.append(Obstacle(f"thing_{k}", shape, T, margin=0.01 * (k % 2)))
    return Scene(tuple(obstacles))


@pytest.mark.parametrize("name", builtin_names())
def test_proved_motions_stay_as_far_away_as_was_proved(name: str) -> None:
    robot = builtin(name)
    random = np.random.default_rng(7)
    lower, upper = robot.chain.sampling_bounds()
    proved = refused = 0
    for _ in range(6):
        checker = Checker.of(robot, few_solids(random))
        for k in range(14):
            a, b = random.uniform(lower, upper, (2, robot.chain.n))
            b = a + (b - a) * random.uniform(0.02, 0.1 if k % 2 else 1.0)
            bend = random.normal(size=robot.chain.n) * 0.1
            motion = checker.curve(a, b - a - bend, bend)
            s = np.linspace(0.0, 1.0, 80)[:, None]
            states = a + (b - a - bend) * s + bend * s**2
            dense = min(checker.clearance(q)[0] for q in states)
            if motion.free:
                proved += 1
                assert dense >= motion.clearance - 1e-9
                assert motion.clearance > 0.0
            else:
                refused += 1
                at = a + (b - a - bend) * motion.at + bend * motion.at**2
                assert checker.clearance(at)[0] <= (0.0 if motion.colliding else 1e-5)
    assert proved > 3
    assert refused > 3 or name in ("planar_rr", "cart_pendulum", "scara")


def test_proof_is_given_up_after_the_intervals_it_may_take() -> None:
    random = np.random.default_rng(5)
    robot = builtin("panda")
    model = Checker.of(robot, few_solids(random)).model.arrays
    limits, zero, found = robot.chain.limits, np.zeros(robot.chain.n), np.empty(4)
    given_up = 0
    for _ in range(200):
        a, b = random.uniform(limits.lower, limits.upper, (2, robot.chain.n))
        step = 0.2 * (b - a)
        work, line = workspace(model), Cubic(a, step, zero, zero)
        verdict = certify_in(model, work, line, 0.0, MAX_INTERVALS, found)
        needed = found[2]
        if verdict == FREE and needed > 1:
            assert certify_in(model, work, line, 0.0, 1, found) == UNDECIDED
            assert found[2] == 1
            given_up += 1
    assert given_up > 5


def test_room_that_runs_out_is_widened_to_the_same_verdict() -> None:
    """A workspace with hardly any room gives what one with plenty gives."""
    random = np.random.default_rng(6)
    robot = builtin("panda")
    model = Checker.of(robot, few_solids(random)).model.arrays
    limits, zero = robot.chain.limits, np.zeros(robot.chain.n)
    roomy, small, verdicts = workspace(model), workspace(model), set[int]()
    small = small._replace(
        entries=small.entries[:, :2].copy(),
        hints=np.zeros((3, len(model.roots), 3)),
        spans=small.spans[:, :2].copy(),
        lists=small.lists[:, :2].copy(),
    )
    for _ in range(60):
        a, b = random.uniform(limits.lower, limits.upper, (2, robot.chain.n))
        line, plenty, little = Cubic(a, 0.2 * (b - a), zero, zero), np.empty(4), np.empty(4)
        verdict = certify_in(model, roomy, line, 0.0, MAX_INTERVALS, plenty)
        assert certify_in(model, small, line, 0.0, MAX_INTERVALS, little) == verdict
        np.testing.assert_array_equal(little, plenty)
        verdicts.add(verdict)
    assert verdicts >= {FREE, COLLIDING}


#: Instants of a motion that FCL looks at.
_SAMPLES = 25


def edges(robot: RobotGeometry, seed: int, count: int) -> list[tuple[Array, Array]]:
    """Motions that bend, from a hundredth to a half of the joints' range."""
    random = np.random.default_rng(seed)
    lower, upper = robot.chain.sampling_bounds()
    motions = []
    for length in np.geomspace(0.01, 0.5, count):
        a, b = random.uniform(lower, upper, (2, robot.chain.n))
        bend = random.normal(size=robot.chain.n) * 0.1 * length
        motions.append((a, np.array([length * (b - a) - bend, bend])))
    return motions


def at(start: Array, powers: Array, s: float) -> Array:
    return np.asarray(start + powers[0] * s + powers[1] * s * s)


def assert_true(judge: FclJudge, motion: Motion, start: Array, powers: Array) -> None:
    """Free motions collide at no sample, and colliding ones where it is said."""
    if motion.free:
        for s in np.linspace(0.0, 1.0, _SAMPLES):
            assert not judge.collides(at(start, powers, s))
    elif motion.colliding:
        assert 0.0 <= motion.at <= 1.0
        assert judge.collides(at(start, powers, motion.at))


@pytest.mark.parametrize("seed", [3, 4])
def test_fcl_finds_no_collision_on_a_proved_edge_among_meshes(seed: int) -> None:
    """A ball in and around cups, which may stand inside their hulls but not their walls."""
    random = np.random.default_rng(seed)
    robot = gantry('<sphere radius="0.03"/>')
    cups = [Obstacle(f"cup{k}", mesh_shape(cup()), random_transform(random, 0.3)) for k in range(4)]
    scene = Scene(cups)
    checker, judge = Checker.of(robot, scene), FclJudge(robot, scene)
    seen = {"free": 0, "colliding": 0, "in a hull": 0}
    for _ in range(40):
        start = random.normal(size=3) * 0.25
        powers = np.array([random.normal(size=3) * random.choice([0.05, 0.4]), np.zeros(3)])
        motion = checker.curve(start, powers[0], powers[1])
        assert_true(judge, motion, start, powers)
        seen["free"] += motion.free
        seen["colliding"] += motion.colliding
        near = checker.clearance(start)[0]
        seen["in a hull"] += motion.free and 0.0 < near < 0.1
    assert min(seen.values()) > 3


def test_a_cloud_is_as_many_balls() -> None:
    robot = builtin("ur5e")
    random = np.random.default_rng(52)
    points = random.normal(size=(300, 3)) * 0.6
    cloud = Checker.of(robot, Scene((Obstacle("cloud", PointCloud(points, 0.03), margin=0.01),)))
    balls = Scene(tuple(
        Obstacle(f"b{k}", Sphere(0.03), np.block([[np.eye(3), p[:, None]], [0, 0, 0, 1]]), 0.01)
        for k, p in enumerate(points)
    ))  # fmt: skip
    apart = Checker.of(robot, balls)
    lower, upper = robot.chain.sampling_bounds()
    for _ in range(40):
        a, b = random.uniform(lower, upper, (2, robot.chain.n))
        b = a + 0.1 * (b - a)
        one, other = cloud.segment(a, b), apart.segment(a, b)
        assert (one.free, one.colliding) == (other.free, other.colliding)
        assert cloud.clearance(a)[0] == pytest.approx(apart.clearance(a)[0], abs=1e-9)


def test_a_hundred_thousand_points() -> None:
    robot = builtin("iiwa14")
    random = np.random.default_rng(53)
    scenes = [room(random, count) for count in (1_000, 100_000)]
    Checker.of(robot, scenes[0])
    began = time.process_time()
    large = Checker.of(robot, scenes[1])
    assert time.process_time() - began < 5.0
    lower, upper = robot.chain.sampling_bounds()
    states = random.uniform(lower, upper, (200, robot.chain.n))
    spent = []
    for checker in (Checker.of(robot, scenes[0]), large):
        judge(checker, states)
        began = time.process_time()
        judge(checker, states)
        spent.append(time.process_time() - began)
    assert spent[1] < 10.0 * spent[0] + 0.01
    for q in itertools.islice(states[judge(large, states) == FREE], 3):
        clearance, pair = large.clearance(q)
        assert clearance > 0.0
        assert pair is not None


@pytest.mark.parametrize("parts", [1, 2])
def test_a_motion_is_blocked_at_the_first_state_looked_at_that_is_not_free(parts: int) -> None:
    robot = builtin("ur5e")
    random = np.random.default_rng(55)
    checker = Checker.of(robot, clutter(random, 1.2))
    arrays, asked = checker.model.arrays, np.empty(1, dtype=np.int64)
    work = workspace(arrays)
    lower, upper = robot.chain.sampling_bounds()
    order = [1.0, 0.5, 0.25, 0.75][parts - 1 :]
    outcomes = set()
    for _ in range(60):
        a, b = random.uniform(lower, upper, (2, robot.chain.n))
        b = a + 0.3 * (b - a)
        blocked = [share for share in order if not checker.valid(a + share * (b - a))]
        found = blocked_at(arrays, work, a, b, 0.0, parts, 4, asked)
        assert found == (blocked[0] if blocked else -1.0)
        outcomes.add(found)
    assert {-1.0, order[0], order[1]} <= outcomes
