"""The ladder's own trees: proved, seeded, bounded, and looked at by FCL."""

import time
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from obstacles.collision.checker import Checker
from obstacles.collision.fcl_distance import FclWorld
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.scenes.scene import Scene
from planning.planner import Query, Ready
from planning.preflight.preflight import preflight
from planning.problem import JointGoal, Problem
from planning.sampling.search import OmplPlanner
from planning.search.rrt_connect import RrtConnect, RrtResult, rrt_connect
from planning.values.deadline import Deadline
from planning.values.search_box import search_box
from tests.planning.scenes import HOME, box, builtin, pillar, shelf

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
    query = Query(problem, ready, ready.checkers[-1], 0, Deadline.after(30.0))
    ompl = OmplPlanner.of("rrt_connect", {})
    own = RrtConnect(ompl).plan(query)
    assert own.waypoints is not None
    assert "OMPL" not in own.detail
    other = RrtConnect(ompl, max_edges=2).plan(query)
    assert other.waypoints is not None
    assert other.detail.startswith("2 edges checked. OMPL: ")
    assert not np.array_equal(own.waypoints, other.waypoints)
    assert ready.checkers[-1].polyline(other.waypoints)[0].free
