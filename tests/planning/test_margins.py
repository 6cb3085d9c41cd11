"""Margins of requests, obstacles and constraints, by the closed-form distances of a ball."""

from collections.abc import Sequence

import numpy as np
import pytest
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from kinematics.arrays import Array
from kinematics.pose import transform
from obstacles.scenes.scene import Obstacle, Scene
from obstacles.shapes.shape import Box
from planning.constraints.constraint_set import ConstraintSet
from planning.constraints.kinds.constraint import ClearanceConstraint
from planning.options import Options
from planning.pipeline.pipeline import plan
from planning.planner import Ready
from planning.preflight.preflight import preflight
from planning.problem import JointGoal, Problem
from planning.result import Failure, Plan
from planning.values.preferences import DEFAULT_PREFERRED
from tests.planning.scenes import planned_motion
from tests.planning.slider import slider

ROBOT, RADIUS = slider(), 0.05
START, GOAL = np.array([-0.6, 0.0]), np.array([0.6, 0.0])


def post(name: str, x: float, y: float, margin: float = 0.0, size: float = 0.1) -> Obstacle:
    """A square post, by its middle."""
    return Obstacle(name, Box(np.array([size, size, 0.4])), transform(None, [x, y, 0.0]), margin)


def gap(obstacle: Obstacle, q: Array) -> Array:
    """The ball's distance from a post, margins not taken off, shape (k,)."""
    assert isinstance(obstacle.shape, Box)
    outside = np.abs(q - obstacle.T_world_obstacle[:2, 3]) - 0.5 * obstacle.shape.size[:2]
    return np.asarray(np.linalg.norm(np.maximum(outside, 0.0), axis=1) - RADIUS)


def asked(scene: Scene, margin: float = 0.0, clearance: float | None = None) -> Problem:
    held = (
        None if clearance is None else ConstraintSet(ROBOT.chain, (ClearanceConstraint(clearance),))
    )
    return Problem(ROBOT, scene, START, (JointGoal(GOAL),), margin, constraints=held)


@pytest.mark.parametrize(
    ("request_margin", "own", "clearance", "total"),
    [
        (0.0, 0.0, None, 0.0),
        (0.02, 0.0, None, 0.02),
        (0.0, 0.03, None, 0.03),
        (0.02, 0.03, None, 0.05),
        (0.0, 0.0, 0.04, 0.04),
        (0.02, 0.01, 0.04, 0.05),
        (0.05, 0.01, 0.04, 0.06),
    ],
)
def test_a_start_is_valid_beyond_all_margins_together_and_no_nearer(
    request_margin: float, own: float, clearance: float | None, total: float
) -> None:
    """The obstacle's own margin, and the larger of the request's and the constraint's."""
    for spare, valid in ((1e-4, True), (-1e-4, False)):
        if total + spare <= 0.0:
            continue
        beside = RADIUS + 0.05 + total + spare
        scene = Scene((post("post", float(START[0]), beside, own),))
        found = preflight(asked(scene, request_margin, clearance), 0)
        assert isinstance(found, Ready) is valid
        if isinstance(found, Failure):
            assert found.code == "START_STATE_IN_COLLISION"
            assert found.details["margin"] == pytest.approx(total, abs=1e-6)
            assert found.details["clearance"] == pytest.approx(total + spare, abs=1e-6)
            assert found.details["depth"] == 0.0


@pytest.mark.parametrize("margin", [0.0, 0.02, 0.05])
def test_each_obstacle_is_passed_at_its_own_margin_and_the_requests(margin: float) -> None:
    obstacles = (post("west", -0.25, 0.03, 0.04), post("east", 0.25, -0.03))
    answer = planned_motion(asked(Scene(obstacles), margin), Options(timeout=20.0))
    path = answer.trajectory.sample(np.linspace(0.0, answer.trajectory.duration, 4001))
    for obstacle in obstacles:
        assert gap(obstacle, path).min() >= margin + obstacle.margin
    assert answer.certificate.verified
    # Not much farther round than is needed: quick ways have fewer corners than the shortest one.
    problem, lengths = asked(Scene(obstacles), margin), list[float]()
    for seed in range(16):
        answer = planned_motion(problem, Options(timeout=20.0, seed=seed))
        lengths.append(answer.path.length)
    shortest = shortest_way(obstacles, max(margin, DEFAULT_PREFERRED))
    assert np.mean(lengths) < 1.08 * shortest
    assert max(lengths) < 1.2 * shortest


def shortest_way(obstacles: Sequence[Obstacle], kept: float) -> float:
    """Length of the shortest way of the ball past posts by a visibility graph [m].

    Args:
        obstacles: The posts.
        kept: Distance from them, beyond their own margins [m].
    """
    turns = np.linspace(0.0, 0.5 * np.pi, 17)
    quarter, corners = np.stack([np.cos(turns), np.sin(turns)], axis=1), [(1, 1), (1, -1), (-1, 1)]
    points = [START[None], GOAL[None]]
    for obstacle in obstacles:
        assert isinstance(obstacle.shape, Box)
        away = RADIUS + obstacle.margin + kept + 3e-4
        place, half = obstacle.T_world_obstacle[:2, 3], 0.5 * obstacle.shape.size[:2]
        points += [place + (half + away * quarter) * side for side in (*corners, (-1, -1))]
    nodes, shares = np.concatenate(points), np.linspace(0.0, 1.0, 101)[:, None]
    lengths = np.zeros((len(nodes), len(nodes)))
    for i, a in enumerate(nodes):
        legs = a + shares * (nodes[:, None] - a)
        gaps = [gap(o, legs.reshape(-1, 2)).reshape(len(nodes), -1) - o.margin for o in obstacles]
        free = np.min(gaps, axis=(0, 2)) >= kept
        lengths[i] = np.where(free, np.linalg.norm(nodes - a, axis=1), 0.0)
    return float(dijkstra(csr_array(lengths), directed=True, indices=[0])[0, 1])


@pytest.mark.parametrize("spare", [4e-3, -4e-3])
def test_a_gate_is_passed_where_it_is_wider_than_the_ball_with_its_margins(spare: float) -> None:
    """Walls that reach across the table, but for a gate in the middle."""
    margin = 0.03
    half = RADIUS + margin + spare
    walls = [
        Obstacle(
            name, Box(np.array([0.1, 2.0, 0.4])), transform(None, [0.0, sign * (1.0 + half), 0.0])
        )
        for name, sign in (("north", 1.0), ("south", -1.0))
    ]
    answer = plan(asked(Scene(tuple(walls)), margin), Options(timeout=2.0))
    assert isinstance(answer, Plan) is (spare > 0.0)
    if isinstance(answer, Plan):
        path = answer.trajectory.sample(np.linspace(0.0, answer.trajectory.duration, 2001))
        assert min(gap_to_wall(path, half, sign) for sign in (1.0, -1.0)) >= margin


def gap_to_wall(path: Array, half: float, sign: float) -> float:
    outside = np.stack([np.abs(path[:, 0]) - 0.05, half - sign * path[:, 1]], axis=1)
    return float(np.linalg.norm(np.maximum(outside, 0.0), axis=1).min()) - RADIUS
