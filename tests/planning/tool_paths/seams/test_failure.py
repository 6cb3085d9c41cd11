"""Reasons why a seam can't be followed, on layers of which the reason is known by construction."""

import numpy as np
import pytest

from kinematics.pose import transform
from obstacles.collision.checker import Checker
from obstacles.scenes.scene import Scene
from planning.tool_motions.tool_tolerance import SeamOptions, SeamWaypoint, ToolTolerance
from planning.tool_paths.seams.failure import explain_search
from planning.tool_paths.seams.path import seam_places, seam_runs
from planning.tool_paths.seams.search import SeamGraph, SeamSearch
from planning.values.deadline import Deadline
from tests.planning.scenes import HOME, builtin

DOWN = np.diag([1.0, -1.0, -1.0])


def layers(layer: int) -> tuple[SeamSearch, SeamGraph, np.ndarray]:
    """A line, the layers along it, checked, and the configurations of one of them."""
    points = tuple(SeamWaypoint(transform(DOWN, [0.5, y, 0.4])) for y in np.linspace(-0.2, 0.2, 9))
    places = seam_places(seam_runs(SeamOptions(points, ToolTolerance.of({}, ("rz",))), 0.0))
    checker = Checker.of(builtin("panda"), Scene())
    search = SeamSearch(checker, places, np.array(HOME), (), Deadline.after(60.0))
    graph = search.prepare(places.layers())
    search.check_all(graph)
    mine = np.arange(graph.nodes.firsts[layer], graph.nodes.firsts[layer + 1])
    return search, graph, mine


def leading_on(search: SeamSearch, graph: SeamGraph, layer: int) -> np.ndarray:
    """Configurations of a layer that lead to the few that are kept of the next one."""
    search.solve(graph)
    after = np.arange(graph.nodes.firsts[layer + 1], graph.nodes.firsts[layer + 2])
    kept = after[np.isfinite(graph.best[after])][:5]
    graph.costs[np.setdiff1d(after, kept)] = np.inf
    mine = np.arange(graph.nodes.firsts[layer], graph.nodes.firsts[layer + 1])
    steps = np.abs(graph.nodes.joints[mine][:, None] - graph.nodes.joints[kept][None])
    leads = (steps.max(axis=2).min(axis=1) <= graph.jump) & np.isfinite(graph.costs[mine])
    assert leads.any()
    assert (np.isfinite(graph.costs[mine]) & ~leads).any()
    return np.asarray(mine[leads])


@pytest.mark.parametrize(("in_the_way", "reason"), [(True, "collision"), (False, "branch")])
def test_a_way_that_collides_is_no_matter_of_branches(in_the_way: bool, reason: str) -> None:
    search, graph, _ = layers(4)
    closed = leading_on(search, graph, 3)
    graph.costs[closed] = np.inf
    graph.collided[closed] = in_the_way
    failure = explain_search(search, [graph])
    assert failure.details["reason"] == reason
    assert failure.details["waypoint"] == search.places.waypoint[graph.layers[4]]


def test_steps_with_a_collision_on_the_way_are_told_as_one() -> None:
    search, graph, _ = layers(4)
    opened = leading_on(search, graph, 3)
    after = np.arange(graph.nodes.firsts[4], graph.nodes.firsts[5])
    steps = [(int(i), int(j)) for i in opened for j in after[np.isfinite(graph.costs[after])]]
    graph.blocked += steps
    assert explain_search(search, [graph]).details["reason"] == "branch"
    graph.hits |= {step: graph.nodes.joints[step[0]] for step in steps}
    assert explain_search(search, [graph]).details["reason"] == "collision"


def test_the_look_that_comes_farthest_tells_where() -> None:
    search, far, mine = layers(6)
    _, near, few = layers(2)
    for graph, closed in ((far, mine), (near, few)):
        graph.costs[closed], graph.collided[closed] = np.inf, True
    for graphs in ([far, near], [near, far]):
        details = explain_search(search, graphs).details
        assert details["waypoint"] == search.places.waypoint[far.layers[6]]
        assert details["reason"] == "collision"


def test_what_stands_on_a_seam_is_no_matter_of_branches() -> None:
    search, graph, _ = layers(4)
    closed = [np.arange(graph.nodes.firsts[k], graph.nodes.firsts[k + 1]) for k in (4, 5)]
    for mine in closed:
        graph.costs[mine], graph.collided[mine] = np.inf, True
    failure = explain_search(search, [graph])
    assert not failure.details["other_branches"]
    at = search.places.waypoint[graph.layers]
    last = len(search.places.runs[0].motions)
    assert failure.details["followable"] == [
        {"from_waypoint": 0, "to_waypoint": int(at[3])},
        {"from_waypoint": int(at[5]) + 1, "to_waypoint": last},
    ]
    assert f"{int(at[5]) + 1} to {last} can be followed" in failure.hint
