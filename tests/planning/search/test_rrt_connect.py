"""Trees, straight motions and narrow passages, and the paths that are shortened."""

import time
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from scipy.spatial import KDTree

from kinematics.arrays import Array
from obstacles.collision.checker import Checker
from obstacles.collision.fcl_distance import FclWorld
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.scenes.scene import Scene
from planning.planner import Query, Ready
from planning.preflight.preflight import preflight
from planning.problem import JointGoal, Problem
from planning.sampling.search import OmplPlanner
from planning.search.rrt_connect import (
    RrtConnect,
    RrtResult,
    TreePairs,
    find_narrow_passage,
    rrt_connect,
    straight_line,
)
from planning.search.shortcut import (
    _MAX_CHECKS,
    path_is_free,
    shortcut,
)
from planning.search.trees import (
    Draws,
    Growth,
    Tally,
    grow_kernel,
    nearest_node,
    new_trees,
    place_node,
)
from planning.values.deadline import Deadline
from planning.values.search_box import search_box
from planning.values.search_trees import Explored
from tests.planning.scenes import HOME, box, builtin, pillar, shelf
from tests.planning.slider import slider

START, GOAL = HOME.copy(), HOME.copy()
START[0], GOAL[0] = -0.9, 0.9
MOST = 200_000
#: Of two links in a plane: the first one between two posts can't be got out from there.
BEFORE, BEHIND, ENCLOSED = np.array([-2.0, 0.3]), np.array([1.0, 0.3]), np.array([2.5, 0.0])


def grown(scene: Scene, seed: int, robot: str = "panda", margin: float = 0.0) -> RrtResult:
    checker = Checker.of(builtin(robot), scene, margin)
    return rrt_connect(checker, START, [GOAL], seed, Deadline.after(30.0), MOST)


def gate() -> Checker:
    """Bars on both sides of the first link in ENCLOSED, and one that the straight way meets."""
    posts = []
    for k, (angle, distance) in enumerate(((2.2, 0.3), (2.8, 0.3), (0.0, 1.3))):
        at = distance * np.array([np.cos(angle), np.sin(angle)])
        posts.append(box(f"post{k}", (0.04, 2.0, 0.04), (at[0], 0.0, at[1])))
    return Checker.of(builtin("planar_rr"), Scene(tuple(posts)))


@pytest.mark.parametrize("seed", range(6))
def test_paths_are_proved_inside_the_limits_and_the_same_for_the_same_seed(seed: int) -> None:
    found, again = grown(pillar(0.0, 0.4), seed), grown(pillar(0.0, 0.4), seed)
    path = found.waypoints
    assert path is not None
    assert again.waypoints is not None
    assert np.array_equal(path, again.waypoints)
    assert np.array_equal(path[[0, -1]], [START, GOAL])
    assert Checker.of(builtin("panda"), pillar(0.0, 0.4)).polyline(path)[0].free
    limits = builtin("panda").chain.limits
    assert ((path >= limits.lower) & (path <= limits.upper)).all()
    legs = np.linalg.norm(np.diff(path, axis=0), axis=1)
    assert (legs > 0.0).all()
    assert legs.max() <= 0.5 + 1e-12


@pytest.mark.parametrize(("scene", "margin"), [(pillar(0.0, 0.4), 0.0), (shelf(0.7), 0.01)])
def test_fcl_finds_no_contact_along_the_legs(scene: Scene, margin: float) -> None:
    robot = builtin("panda")
    path = grown(scene, 1, margin=margin).waypoints
    assert path is not None
    world = FclWorld(robot, scene)
    shares = np.linspace(0.0, 1.0, 40)[:, None]
    for a, b in pairwise(path):
        for q in (1.0 - shares) * a + shares * b:
            assert not world.collisions(q)


def test_seeds_differ_and_so_do_neighbours_runs() -> None:
    paths = [grown(pillar(0.0, 0.4), seed).waypoints for seed in range(5)]
    assert len({path.tobytes() for path in paths if path is not None}) == 5


def test_a_goal_that_cannot_be_reached_does_not_stand_in_the_way() -> None:
    for goals in ([ENCLOSED, BEHIND], [BEHIND, ENCLOSED]):
        found = rrt_connect(gate(), BEFORE, goals, 1, Deadline.after(30.0), MOST)
        assert found.waypoints is not None
        assert np.array_equal(found.waypoints[-1], BEHIND)


def test_it_stops_at_its_edges_and_at_its_deadline() -> None:
    checker = gate()
    assert not checker.free(BEFORE, BEHIND)
    for most in (1, 250, 777, 5000):
        found = rrt_connect(checker, BEFORE, [ENCLOSED], 0, Deadline.after(30.0), most)
        assert found.waypoints is None
        assert found.edges == most
    began = time.process_time()
    found = rrt_connect(checker, BEFORE, [ENCLOSED], 0, Deadline.after(0.1), 100_000_000)
    assert found.waypoints is None
    assert found.runs > 1
    assert time.process_time() - began < 0.5
    late = rrt_connect(checker, BEFORE, [BEHIND], 0, Deadline.after(-1.0), MOST)
    assert late == RrtResult(None, 0, 0)


def test_it_draws_from_the_limits_or_a_turn_beyond_what_is_known() -> None:
    chain = builtin("panda").chain
    lower, upper = chain.limits.lower.copy(), chain.limits.upper.copy()
    lower[2], upper[2] = -np.inf, np.inf
    free = replace(chain, limits=replace(chain.limits, lower=lower, upper=upper))
    low, high = search_box(free, [START, GOAL])
    assert low[2] == HOME[2] - 2.0 * np.pi
    assert high[2] == HOME[2] + 2.0 * np.pi
    kept = np.arange(chain.n) != 2
    assert np.array_equal(low[kept], lower[kept])
    assert np.array_equal(high[kept], upper[kept])


def test_of_joints_that_turn_further_it_draws_within_half_a_turn_of_what_is_known() -> None:
    chain = builtin("ur5e").chain
    start, goal = np.zeros(6), np.array([0.5, -1.0, 0.0, 6.0, 0.0, -6.0])
    whole, near = (search_box(chain, [start, goal], nearby=near) for near in (False, True))
    turns = whole[1] - whole[0] > 2.0 * np.pi
    assert turns.any()
    least, most = np.minimum(start, goal) - np.pi, np.maximum(start, goal) + np.pi
    assert np.array_equal(near[0], np.where(turns, np.maximum(whole[0], least), whole[0]))
    assert np.array_equal(near[1], np.where(turns, np.minimum(whole[1], most), whole[1]))
    # Every place of a joint that the whole box has is in it.
    assert (near[1] - near[0] >= np.minimum(whole[1] - whole[0], 2.0 * np.pi)).all()
    slides = replace(chain, joint_types=np.ones(6, dtype=np.int64))
    near, whole = (search_box(slides, [start, goal], nearby=near) for near in (True, False))
    assert np.array_equal(near, whole)


def _ready(robot: RobotGeometry) -> tuple[Problem, Ready]:
    problem = Problem(robot, pillar(0.0, 0.4), START, (JointGoal(GOAL),))
    ready = preflight(problem, 0)
    assert isinstance(ready, Ready)
    return problem, ready


def test_ompl_goes_on_where_they_do_not_meet() -> None:
    problem, ready = _ready(builtin("panda"))
    query = Query(problem, ready, ready.checkers[-1], 0, Deadline.after(30.0), np.ones((3, 7)))
    ompl = OmplPlanner.of("rrt_connect", {})
    own = RrtConnect(ompl).plan(query)
    assert own.waypoints is not None
    assert "OMPL" not in own.detail
    other = RrtConnect(ompl, max_edges=2).plan(query)
    assert other.waypoints is not None
    assert other.detail.startswith("2 edges checked. OMPL: ")
    assert not np.array_equal(own.waypoints, other.waypoints)
    assert ready.checkers[-1].polyline(other.waypoints)[0].free


TREES_BEFORE, TREES_BEHIND = np.array([-0.6, 0.2]), np.array([0.6, 0.2])


def wire() -> Checker:
    """A wire that two links in a plane pass between the looks at a step."""
    at = 1.7 * np.array([np.cos(0.15), 0.0, np.sin(0.15)])
    post = box("wire", (1e-5, 1.0, 1e-5), (at[0], at[1], at[2]))
    return Checker.of(builtin("planar_rr"), Scene((post,)))


def trees_grown(seed: int) -> tuple[np.ndarray, int]:
    """The path between two configurations, and how many steps were cut off."""
    checker, limit = wire(), np.full(2, 3.0)
    roots = np.array([TREES_BEFORE, TREES_BEHIND])
    draws = Draws(-limit, limit, 9.0, 2.0, 0.0, True, roots, 0.6, 0.7)
    trees = new_trees(2, 2, 2000, np.array([seed], dtype=np.uint64))
    assert grow_kernel(checker.model.arrays, trees, draws, roots, None, 2000, 2000) == Growth.FOUND
    assert trees.tally[Tally.EDGES] <= 2000
    return trees.path[: trees.tally[Tally.PATH]].copy(), int((trees.parents == -2).sum())


@pytest.mark.parametrize("seed", range(8))
def test_paths_past_what_no_look_finds_are_proved(seed: int) -> None:
    path, _ = trees_grown(seed)
    assert np.array_equal(path[[0, -1]], [TREES_BEFORE, TREES_BEHIND])
    motion, _ = wire().polyline(path)
    assert motion.free
    again, _ = trees_grown(seed)
    assert np.array_equal(path, again)


def test_steps_over_it_were_taken_and_cut_off() -> None:
    assert sum(cut for _, cut in map(trees_grown, range(8))) > 0


def test_what_is_kept_of_trees_is_proved() -> None:
    checker, explored = wire(), Explored()
    found = rrt_connect(
        checker, TREES_BEFORE, [TREES_BEHIND], 0, Deadline.after(30.0), 20_000, explored
    )
    assert found.waypoints is not None
    assert explored.runs == found.runs
    assert explored.edges
    assert all(checker.free(edge.begin, edge.end) for edge in explored.edges)


def test_a_path_that_need_not_be_proved_is_looked_at_more_closely() -> None:
    """The wire is met by some: what comes after has to prove them."""
    checker, late = wire(), Deadline.after(60.0)
    met = 0
    for seed in range(8):
        found = rrt_connect(checker, TREES_BEFORE, [TREES_BEHIND], seed, late, 20_000, proves=False)
        path = found.waypoints
        assert path is not None
        assert np.array_equal(path[[0, -1]], [TREES_BEFORE, TREES_BEHIND])
        shares = np.arange(9) / 8.0
        for a, b in pairwise(path):
            assert all(checker.valid(a + share * (b - a)) for share in shares)
        met += not checker.polyline(path)[0].free
    assert met > 0


@pytest.mark.parametrize("count", [1, 7, 8, 9, 40, 333])
def test_the_nearest_of_some_nodes(count: int) -> None:
    random = np.random.default_rng(count)
    for n in (1, 2, 6, 7, 9):
        nodes = random.normal(size=(count, n))
        blocks = np.full((count + 7) // 8 * 8 * n, np.nan)
        for k, q in enumerate(nodes):
            place_node(blocks, k, q)
        asked = random.normal(size=(50, n))
        away, found = KDTree(nodes).query(asked)
        found = np.asarray(found)
        answers = [nearest_node(blocks, count, q) for q in asked]
        assert [node for node, _ in answers] == found.tolist()
        assert np.allclose([distance for _, distance in answers], away, rtol=1e-14)
        # The first of equals, and none that is nowhere.
        again = np.vstack([nodes, nodes])
        wider = np.full((2 * count + 7) // 8 * 8 * n, np.nan)
        for k, q in enumerate(again):
            place_node(wider, k, q)
        assert [nearest_node(wider, 2 * count, q)[0] for q in asked] == found.tolist()
        for k in range(count):
            place_node(wider, k, np.full(n, np.inf))
        assert [nearest_node(wider, 2 * count, q)[0] for q in asked] == (found + count).tolist()


def test_nothing_is_nearest_where_all_nodes_were_taken_out() -> None:
    blocks = np.empty(8 * 3)
    place_node(blocks, 0, np.zeros(3))
    place_node(blocks, 0, np.full(3, np.inf))
    node, away = nearest_node(blocks, 1, np.ones(3))
    assert (node, away) == (0, np.inf)


def pairs(scene: Scene, max_edges: int = 100_000, *, proves: bool = True) -> TreePairs:
    checker, roots = Checker.of(builtin("panda"), scene), np.array([START, GOAL])
    return TreePairs(checker, roots, 3, Deadline.after(60.0), max_edges, None, proves)


@pytest.mark.parametrize("scene", [pillar(0.0, 0.4), shelf(0.7)])
def test_the_way_keeps_the_clearance_asked_for_and_is_found_again(scene: Scene) -> None:
    robot, grown = builtin("panda"), pairs(scene)
    path = find_narrow_passage(grown)
    assert path is not None
    assert np.array_equal(path[[0, -1]], [START, GOAL])
    assert grown.runs >= 6
    assert Checker.of(robot, scene).polyline(path)[0].free
    world = FclWorld(robot, scene)
    for a, b in pairwise(path):
        assert not any(world.collisions(a + share * (b - a)) for share in np.linspace(0, 1, 30))
    again = find_narrow_passage(pairs(scene))
    assert again is not None
    assert np.array_equal(path, again)


def test_there_is_none_where_there_is_no_way() -> None:
    roots = np.array([BEFORE, ENCLOSED])
    grown = TreePairs(gate(), roots, 0, Deadline.after(60.0), 100_000, None, True)
    assert find_narrow_passage(grown) is None
    assert grown.edges <= 100_000


def test_budgets_hold_whatever_pair_they_end_in() -> None:
    for most in (1, 50, 200):
        grown = pairs(shelf(0.7), most)
        find_narrow_passage(grown)
        # The last pair may take as many again for a shorter path.
        assert grown.edges <= 2 * most


STRAIGHT_LINE_START = np.array([-0.6, 0.0])
STRAIGHT_LINE_BEHIND, BESIDE, FARTHER = (
    np.array([0.6, 0.0]),
    np.array([-0.6, 0.7]),
    np.array([-0.5, 0.8]),
)
CHECKER = Checker.of(slider(), Scene((box("wall", (0.1, 1.0, 0.4), (0.0, 0.0, 0.0)),)))


def test_the_first_goal_that_can_be_reached_is_taken() -> None:
    path, motions = straight_line(
        CHECKER, STRAIGHT_LINE_START, [STRAIGHT_LINE_BEHIND, BESIDE, FARTHER]
    )
    assert path is not None
    np.testing.assert_array_equal(path, [STRAIGHT_LINE_START, BESIDE])
    assert [motion.free for motion in motions] == [False, True]


def test_blocked_motions_name_their_pair_and_place() -> None:
    path, (motion,) = straight_line(CHECKER, STRAIGHT_LINE_START, [STRAIGHT_LINE_BEHIND])
    assert path is None
    assert motion.pair == ("ball", "wall")
    # The ball of 5 cm meets the wall's face, 5 cm before the middle: 0.5 m of 1.2 m.
    assert motion.colliding
    assert 0.5 / 1.2 <= motion.at <= 0.7 / 1.2


def test_a_motion_that_keeps_too_little_distance_is_not_free() -> None:
    wary = Checker(CHECKER.model, 0.1)
    past = np.array([-0.17, 0.5])
    assert straight_line(CHECKER, STRAIGHT_LINE_START, [past])[0] is not None
    path, _ = straight_line(wary, STRAIGHT_LINE_START, [past])
    assert path is None


def test_a_motion_that_no_look_finds_blocked_is_proved() -> None:
    # Thinner than the way from look to look: only the proof finds it.
    thin = Checker.of(slider(), Scene((box("foil", (1e-5, 1.0, 0.4), (0.07, 0.0, 0.0)),)))
    far = 30.0 * STRAIGHT_LINE_BEHIND
    assert all(thin.valid(s * far) for s in np.linspace(-1.0, 1.0, 17))
    path, (motion,) = straight_line(thin, -far, [far])
    assert path is None
    assert motion.pair == ("ball", "foil")


@pytest.mark.parametrize("kind", [np.int64, np.float32])
def test_numbers_of_other_kinds_are_looked_at_as_such(kind: Any) -> None:
    one = np.array([1.0, 0.0])
    other: Any = one.astype(kind)
    assert CHECKER.straight(-other, other) == CHECKER.straight(-one, one)


#: Of two links in the plane of x and z: a bar that the outer one meets on the straight way.
SHORTCUT_START, SHORTCUT_GOAL = np.array([-1.2, 0.4]), np.array([1.2, -0.4])
BAR = Scene((box("bar", (0.1, 1.0, 0.1), (1.3, 0.0, 0.0)),))


def length(path: Array) -> float:
    return float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())


def least_distance(path: Array, scene: Scene, name: str = "planar_rr") -> float:
    """The least distance along a path, by FCL at steps of a hundredth of a radian."""
    world, least = FclWorld(builtin(name), scene), np.inf
    for a, b in pairwise(path):
        steps = int(np.abs(b - a).max() / 0.01) + 2
        for share in np.linspace(0.0, 1.0, steps):
            least = min(least, world.clearance(a + share * (b - a)).distance)
    return float(least)


def detour(checker: Checker, random: np.random.Generator) -> Array:
    """A path of many proved legs from SHORTCUT_START to SHORTCUT_GOAL that wanders about."""
    low, high = np.array([-2.5, -2.4]), np.array([2.5, 2.4])
    points = [SHORTCUT_START]
    while not (len(points) > 8 and checker.free(points[-1], SHORTCUT_GOAL)):
        q = random.uniform(low, high)
        if checker.free(points[-1], q):
            points.append(q)
    return np.array([*points, SHORTCUT_GOAL])


@pytest.mark.parametrize("seed", range(8))
def test_what_comes_back_is_free_shorter_and_has_the_same_ends(seed: int) -> None:
    checker = Checker.of(builtin("planar_rr"), BAR)
    path = detour(checker, np.random.default_rng(seed))
    short = shortcut(checker, path)
    assert np.array_equal(short[[0, -1]], path[[0, -1]])
    assert least_distance(short, BAR) > 0.0
    # The bar can't be gone through: no way round it is nearly as short as the straight one.
    assert length(short) > 1.02 * length(path[[0, -1]])
    assert length(short) < 0.5 * length(path)


@pytest.mark.parametrize("slack", [0.0, 0.02, 0.05])
def test_slack_and_margin_are_kept(slack: float) -> None:
    margin = 0.03
    checker = Checker(Checker.of(builtin("planar_rr"), BAR, margin).model, slack)
    path = detour(checker, np.random.default_rng(5))
    short = shortcut(checker, path)
    assert least_distance(short, BAR) >= margin + slack


def test_links_are_kept_off_each_other() -> None:
    """Panda folds: its hand would meet its forearm on the straight way."""
    checker = Checker.of(builtin("panda"), Scene())
    start = np.array([2.8, 1.2, 0.8, -0.8, 0.7, 1.2, 0.5])
    goal = np.array([2.4, -1.3, -0.7, -0.1, 2.8, 0.3, -2.2])
    assert not checker.free(start, goal)
    path, random = [start, HOME, goal], np.random.default_rng(1)
    while not all(checker.free(a, b) for a, b in pairwise(path)):
        path[1] = HOME + random.uniform(-1.0, 1.0, 7)
    short = shortcut(checker, np.array(path))
    assert len(short) > 2
    assert least_distance(short, Scene(), "panda") > 0.0


def test_the_same_path_is_shortened_in_the_same_way() -> None:
    checker = Checker.of(builtin("planar_rr"), BAR)
    path = detour(checker, np.random.default_rng(3))
    first, again = (shortcut(checker, path) for _ in range(2))
    np.testing.assert_array_equal(first, again)


@pytest.mark.parametrize("seed", range(6))
def test_what_is_looked_at_with_a_clearance_keeps_it_between_looks_too(seed: int) -> None:
    """Looks farther apart than a clearance would let corners of the bar come much nearer."""
    clearance = 0.03
    proof = Checker.of(builtin("planar_rr"), BAR)
    wished = Checker.of(builtin("planar_rr"), BAR, clearance)
    path = detour(wished, np.random.default_rng(seed))
    short = shortcut(wished, path, proof)
    assert least_distance(short, BAR) >= 0.9 * clearance


def test_a_path_that_was_only_looked_at_keeps_the_clearance_by_looks() -> None:
    proof = Checker.of(builtin("planar_rr"), BAR)
    wished = Checker.of(builtin("planar_rr"), BAR, 0.03)
    path = detour(wished, np.random.default_rng(2))
    short = shortcut(wished, path, proves=False)
    assert np.array_equal(short[[0, -1]], path[[0, -1]])
    assert len(short) < len(path)
    assert least_distance(short, BAR) >= 0.9 * 0.03
    assert path_is_free(proof, short)


def test_waypoints_are_left_out_and_none_is_new() -> None:
    checker = Checker.of(builtin("planar_rr"), BAR)
    path = detour(checker, np.random.default_rng(2))
    short = shortcut(checker, path)
    places = [np.flatnonzero((path == q).all(axis=1)) for q in short]
    assert all(len(place) == 1 for place in places)
    assert (np.diff(np.concatenate(places)) > 0).all()
    assert 2 < len(short) < len(path)
    assert checker.polyline(short)[0].free


def test_a_leg_that_cannot_be_proved_is_found_in_any_place() -> None:
    """A foil between the looks at a motion of many metres."""
    checker = Checker.of(slider(), Scene((box("foil", (1e-5, 1.0, 0.4), (0.07, 0.0, 0.0)),)))
    far, above = np.array([18.0, 0.0]), np.array([0.0, 3.0])
    path = np.array([-far, 0.5 * -far, far])
    looked = shortcut(checker, path, proves=False)
    assert len(looked) == 2
    assert not path_is_free(checker, np.array([-far, far]))
    assert not path_is_free(checker, np.array([above, -far, far, above]))
    assert path_is_free(checker, np.array([-far, above, far]))
    assert path_is_free(checker, far[None])


RADIUS, HALF = 0.05, 0.15
#: A ball on a table, and a block that it goes around.
BLOCKED = Checker.of(slider(), Scene((box("block", (0.3, 0.3, 0.3), (0.0, 0.0, 0.0)),)))
OPEN = Checker.of(slider(), Scene())
AROUND = np.array([[-0.6, 0.0], [-0.5, 0.5], [0.0, 0.7], [0.5, 0.5], [0.6, 0.0]])


@pytest.mark.parametrize("count", [1, 2, 3])
def test_short_paths_keep_their_ends(count: int) -> None:
    path = AROUND[:count]
    short = shortcut(OPEN, path)
    np.testing.assert_array_equal(short, path[[0, -1]] if count > 1 else path)


def test_a_path_through_one_point_twice_loses_its_loop() -> None:
    loop = np.array([[-0.6, 0.0], [-0.6, 0.5], [-0.3, 0.5], [-0.6, 0.0], [-0.6, -0.5]])
    short = shortcut(BLOCKED, loop)
    np.testing.assert_array_equal(short, loop[[0, -1]])


def test_more_waypoints_than_checks_in_the_open_leave_the_ends() -> None:
    """A bisection looks at the last waypoint first."""
    many = np.random.default_rng(1).uniform(-0.9, 0.9, (2 * _MAX_CHECKS, 2))
    np.testing.assert_array_equal(shortcut(OPEN, many), many[[0, -1]])
