"""Every planner by its name: proved paths, all goals, budgets, deadlines, repeatability."""

import time

import numpy as np
import pytest

from kinematics.arrays import Array
from obstacles.collision.checker import Checker
from planning.result import Attempt
from planning.sampling.planners import PLANNERS, planner_by_name
from planning.sampling.search import sample
from planning.values.deadline import Deadline
from tests.planning.sampling.world import ENCLOSED, GOAL, SHORTEST, START, WALL, plane
from tests.planning.scenes import HOME, builtin, shelf

IMPROVING = [name for name in PLANNERS if planner_by_name(name).improves]


def search(
    planner: str,
    goals: list[Array],
    seed: int = 0,
    seconds: float = 600.0,  # no search is ended by it, however busy the machine is
    **options: float,
) -> Attempt:
    if planner_by_name(planner).batch is not None:
        options.setdefault("num_samples", 200)
    return sample(planner, plane(), WALL, START, goals, options, seed, Deadline.after(seconds))


def length(found: Attempt) -> float:
    assert found.waypoints is not None, found.detail
    return float(np.linalg.norm(np.diff(found.waypoints, axis=0), axis=1).sum())


@pytest.mark.parametrize("planner", PLANNERS)
def test_paths_are_proved_and_repeat_for_a_seed(planner: str) -> None:
    for seed in range(3):
        budget = {"max_iterations": 400} if planner in IMPROVING else {}
        found, again = (search(planner, [GOAL], seed, **budget) for _ in range(2))
        assert found.waypoints is not None, found.detail
        assert np.array_equal(found.waypoints[0], START)
        assert np.array_equal(found.waypoints[-1], GOAL)
        assert WALL.polyline(found.waypoints)[0].free
        assert length(found) >= SHORTEST - 1e-9
        assert again.waypoints is not None
        assert np.array_equal(found.waypoints, again.waypoints)
        assert found.notes == ()
        assert [p.length for p in found.progress] == [p.length for p in again.progress]


@pytest.mark.parametrize("planner", PLANNERS)
def test_with_nothing_in_the_way_paths_still_begin_at_the_start(planner: str) -> None:
    budget = {"max_iterations": 400} if planner in IMPROVING else {}
    near = START + np.array([0.0, 0.3])
    for goals in ([near], [ENCLOSED, near], [GOAL, near]):
        found = search(planner, goals, 2, **budget)
        assert found.waypoints is not None, found.detail
        assert np.array_equal(found.waypoints[0], START)
        assert any(np.array_equal(found.waypoints[-1], goal) for goal in goals)
        if found.progress:
            assert found.progress[-1].length == pytest.approx(length(found), rel=1e-6)


@pytest.mark.parametrize("planner", PLANNERS)
def test_a_goal_that_cannot_be_reached_does_not_stand_in_the_way(planner: str) -> None:
    budget = {"max_iterations": 800} if planner in IMPROVING else {}
    for goals in ([ENCLOSED, GOAL], [GOAL, ENCLOSED]):
        found = search(planner, goals, 1, **budget)
        assert found.waypoints is not None, found.detail
        assert np.array_equal(found.waypoints[-1], GOAL)


class Countdown(Deadline):
    """Passes after so many questions, whatever the clock says, and notes the processor's time."""

    left: int
    at_end: float | None

    def __init__(self, questions: int) -> None:
        super().__init__(np.inf)
        object.__setattr__(self, "left", questions)
        object.__setattr__(self, "at_end", None)

    @property
    def passed(self) -> bool:
        object.__setattr__(self, "left", self.left - 1)
        if self.left <= 0 and self.at_end is None:
            object.__setattr__(self, "at_end", time.process_time())
        return self.left <= 0


@pytest.mark.parametrize("planner", PLANNERS)
def test_deadlines_hold_where_there_is_no_way(planner: str) -> None:
    for questions in (30, 1000, 3000):
        deadline = Countdown(questions)
        found = sample(planner, plane(), WALL, START, [ENCLOSED], {}, 0, deadline)
        # Of the processor, since other processes may have it in between [s].
        assert deadline.at_end is not None
        late = time.process_time() - deadline.at_end
        assert found.waypoints is None
        assert late < 0.05


@pytest.mark.parametrize("planner", PLANNERS)
def test_budgets_end_it_where_there_is_no_way(planner: str) -> None:
    for option in ("max_iterations", "max_edges"):
        found = search(planner, [ENCLOSED], **{option: 300})
        assert found.waypoints is None
        if option in found.detail:
            return
    pytest.fail(found.detail)


@pytest.mark.parametrize("planner", IMPROVING)
def test_paths_get_shorter_until_the_budget_is_spent(planner: str) -> None:
    found = search(planner, [GOAL], 2, max_iterations=2000 if planner == "prm_star" else 5000)
    lengths = [step.length for step in found.progress]
    assert lengths == sorted(lengths, reverse=True)
    assert lengths[-1] == pytest.approx(length(found), rel=1e-5)
    assert length(found) <= 1.1 * SHORTEST
    assert "max_iterations" in found.detail


@pytest.mark.parametrize("planner", IMPROVING)
def test_a_path_that_is_short_enough_ends_it(planner: str) -> None:
    found = search(planner, [GOAL], 2, cost_threshold=1.3 * SHORTEST)
    assert length(found) <= 1.3 * SHORTEST
    assert "short enough" in found.detail
    assert found.notes == ()


@pytest.mark.parametrize("planner", IMPROVING)
def test_what_the_deadline_ended_is_not_called_reproducible(planner: str) -> None:
    found = search(planner, [GOAL], 2, 0.3)
    assert found.waypoints is not None
    assert len(found.notes) == 1
    assert "max_iterations" in found.notes[0]


def test_a_start_that_is_a_goal_is_enough() -> None:
    for planner in PLANNERS:
        found = search(planner, [GOAL, START])
        assert found.waypoints is not None
        assert np.array_equal(found.waypoints, [START, START])


@pytest.mark.parametrize("planner", PLANNERS)
def test_an_arm_reaches_into_a_shelf(planner: str) -> None:
    robot, scene = builtin("panda"), shelf(0.62)
    checker = Checker.of(robot, scene)
    goal = np.array([0.2, -0.9, 0.1, -2.5, 0.1, 1.7, 0.9])
    start = HOME.copy()
    start[0] = -1.2
    assert checker.valid(goal)
    options = {"num_samples": 500} if planner_by_name(planner).batch else {}
    options |= {"max_edges": 300, "max_iterations": 3000} if planner in IMPROVING else {}
    found = sample(planner, robot.chain, checker, start, [goal], options, 0, Deadline.after(20.0))
    assert found.waypoints is not None, found.detail
    assert checker.polyline(found.waypoints)[0].free
    limits = robot.chain.limits
    assert ((found.waypoints >= limits.lower) & (found.waypoints <= limits.upper)).all()
