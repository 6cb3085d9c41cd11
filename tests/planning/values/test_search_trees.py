"""Edges that planners explored: free by FCL, joined to the ends, and bounded in number."""

from dataclasses import replace

import numpy as np
import pytest

from obstacles.collision.fcl_distance import FclWorld
from planning.options import Options
from planning.pipeline.path_search import CASCADE
from planning.planner import Planner
from planning.sampling.search import OmplPlanner
from planning.search.rrt_connect import RrtConnect
from planning.values.search_trees import Edge, Explored
from tests.planning.pipeline.test_pipeline import GOAL, SHUT, START, WALL, problem, query
from tests.planning.scenes import planning_failure
from tests.planning.slider import slider

OWN = RrtConnect(fallback=OmplPlanner.of("rrt_connect", {}), max_edges=600)
PLANNERS: tuple[Planner, ...] = (
    OWN,
    OmplPlanner.of("rrt_connect", {}),
    OmplPlanner.of("rrt", {}),
    OmplPlanner.of("prm", {}),
)


def reached(edges: list[Edge], q: np.ndarray) -> set[bytes]:
    """The configurations that edges join to q."""
    around, found = [q.tobytes()], {q.tobytes()}
    while around:
        at = around.pop()
        for edge in edges:
            ends = edge.begin.tobytes(), edge.end.tobytes()
            for this, other in (ends, ends[::-1]):
                if this == at and other not in found:
                    found.add(other)
                    around.append(other)
    return found


@pytest.mark.parametrize("planner", PLANNERS, ids=lambda planner: repr(planner)[:30])
def test_the_path_is_in_what_was_explored_and_all_of_it_is_free(planner: Planner) -> None:
    explored = Explored()
    attempt = planner.plan(replace(query(WALL), explored=explored))
    assert attempt.waypoints is not None
    assert explored.planner == planner.name
    assert explored.runs >= 1
    assert explored.left_out == 0
    assert GOAL.tobytes() in reached(explored.edges, START)
    world = FclWorld(slider(), WALL)
    for edge in explored.edges:
        for share in np.linspace(0.0, 1.0, 9):
            assert world.nearest_points(edge.begin + share * (edge.end - edge.begin)).distance > 0.0


def test_keeping_it_changes_no_answer() -> None:
    for planner in PLANNERS:
        plain = planner.plan(query(WALL)).waypoints
        kept = planner.plan(replace(query(WALL), explored=Explored())).waypoints
        np.testing.assert_array_equal(plain, kept)


def test_trees_that_do_not_meet_are_told_apart() -> None:
    explored = Explored()
    attempt = CASCADE[-1].plan(
        replace(query(SHUT, constrained=True, seconds=0.5), explored=explored)
    )
    assert attempt.waypoints is None
    assert {edge.part for edge in explored.edges} <= {"start", "goals"}
    here = reached(explored.edges, START)
    assert GOAL.tobytes() not in here
    for edge in explored.edges:
        assert (edge.begin.tobytes() in here) == (edge.part == "start")


def test_edges_beyond_the_bound_are_counted() -> None:
    whole, some = Explored(), Explored(max_edges=3)
    for explored in (whole, some):
        OWN.plan(replace(query(WALL), explored=explored))
    assert len(some.edges) == 3
    assert some.left_out == len(whole.edges) - 3 > 0
    for one, other in zip(whole.edges[:3], some.edges, strict=True):
        np.testing.assert_array_equal(one.begin, other.begin)
        np.testing.assert_array_equal(one.end, other.end)


def test_the_pipeline_fills_what_options_give_it() -> None:
    explored = Explored()
    options = Options(planner="rrt", timeout=0.4, explored=explored)
    planning_failure(problem(SHUT), options)
    assert explored.planner == "rrt"
    # The clock ends the last run: how far it grew is not for a test to say.
    assert explored.edges
    assert GOAL.tobytes() not in reached(explored.edges, START)
