"""Tours of arms: every leg proved once more, constraints, deadlines, goals that can't be."""

from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import armwright as aw
from planning.constraints.constraint_set import ConstraintSet
from planning.constraints.kinds.constraint import (
    ClearanceConstraint,
    ConeConstraint,
    ToolSpeedConstraint,
)
from planning.options import Options
from planning.problem import JointGoal, PoseGoal
from planning.proof.certificate import certify
from planning.reach.evaluation import Tolerance
from planning.result import Failure
from planning.timing.choice import chosen_parametrization
from planning.tours.legs import least_times
from planning.tours.planner import plan_tour
from planning.tours.problem import TourGoal, TourOptions, TourProblem
from planning.tours.result import Tour
from planning.tours.search import TourSearch, lower_bound
from planning.values import deadline
from planning.values.deadline import Deadline
from service.endpoints.tours.task import tour_answer
from tests.planning.tours.test_search_kernels import instance

START = np.array([0.0, -1.44, 2.5, 0.0, -1.07, 0.0])
DOWN = np.diag([1.0, -1.0, -1.0])


def pose(x: float, y: float, z: float) -> PoseGoal:
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = DOWN, (x, y, z)
    return PoseGoal(T)


@pytest.fixture(scope="module")
def problem() -> TourProblem:
    """Twelve spots beside a post, some with a free spin, some with two places."""
    robot = aw.load_robot("kr6_sixx")
    post = aw.Obstacle("post", aw.Box((0.06, 0.06, 0.8)), aw.pose([0.5, 0.0, 0.4]))
    goals = [
        TourGoal(
            f"spot_{i}",
            (pose(0.35 + 0.06 * (i % 3), 0.09 * i - 0.5, 0.3 + 0.04 * (i % 2)),),
            Tolerance.free("rz", samples=4) if i % 4 == 0 else Tolerance(),
            dwell=0.1 * (i % 3),
        )
        for i in range(12)
    ]
    goals[5] = replace(goals[5], alternatives=(pose(0.4, -0.2, 0.5), pose(0.4, -0.1, 0.5)))
    return TourProblem(robot, aw.Scene([post]), tuple(goals), START, "start")


def planned(problem: TourProblem, **options: object) -> Tour:
    answer = plan_tour(problem, TourOptions(Options(timeout=60.0), **options))  # type: ignore[arg-type]
    assert isinstance(answer, Tour), answer
    return answer


@pytest.fixture(scope="module")
def tour(problem: TourProblem) -> Tour:
    return planned(problem, rounds=4)


def test_every_leg_is_proved_and_joins_the_next(problem: TourProblem, tour: Tour) -> None:
    assert sorted(tour.order) == list(range(12))
    assert len(tour.legs) == 13
    for leg in tour.legs:
        assert certify(leg.trajectory, problem.robot, problem.scene).verified
        ends = leg.trajectory.sample([0.0, leg.trajectory.duration], 1)
        assert np.abs(ends).max() < 1e-6
    for before, after in pairwise(tour.legs):
        assert np.abs(before.trajectory.end - after.trajectory.start).max() < 1e-9
    assert np.abs(tour.legs[0].trajectory.start - START).max() < 1e-9
    assert np.abs(tour.legs[-1].trajectory.end - START).max() < 1e-9


def test_visits_take_the_poses_within_their_tolerance(problem: TourProblem, tour: Tour) -> None:
    for visit in tour.visits:
        goal = problem.goals[visit.index]
        alternative = goal.alternatives[visit.alternative]
        assert isinstance(alternative, PoseGoal)
        T = np.linalg.inv(alternative.T_base_tip) @ aw.fk(problem.robot, visit.joints)
        assert np.abs(T[:3, 3]).max() < 1e-6
        free = T[2, 2] if goal.tolerance.ranges else (np.trace(T[:3, :3]) - 1.0) / 2.0
        assert free == pytest.approx(1.0, abs=1e-9)


def test_times_add_up(problem: TourProblem, tour: Tour) -> None:
    dwell = sum(goal.dwell for goal in problem.goals)
    motion = sum(leg.trajectory.duration for leg in tour.legs)
    assert tour.dwell == pytest.approx(dwell)
    assert tour.time == pytest.approx(motion + dwell)
    assert tour.trajectory.duration == pytest.approx(tour.time)
    assert tour.trajectory.continuity().position < 1e-9
    clock = 0.0
    for leg, visit in zip(tour.legs, tour.visits, strict=False):
        clock += leg.trajectory.duration
        assert visit.arrival == pytest.approx(clock)
        clock = visit.departure
        assert visit.departure - visit.arrival == pytest.approx(problem.goals[visit.index].dwell)
    assert dwell < tour.lower_bound <= tour.time
    assert tour.gap == pytest.approx(tour.time / tour.lower_bound - 1.0)
    times = [step.time for step in tour.search.improvements]
    assert times == sorted(times, reverse=True)
    assert times[-1] == pytest.approx(tour.time)


def test_the_tour_is_shorter_than_the_order_given(problem: TourProblem, tour: Tour) -> None:
    shuffled = tuple(problem.goals[k] for k in np.random.default_rng(0).permutation(12))
    given = tuple(pairwise(goal.id for goal in shuffled))
    ordered = planned(replace(problem, precedence=given), rounds=0)
    assert [problem.goals[k].id for k in ordered.order] == [goal.id for goal in shuffled]
    assert tour.time < ordered.time


def test_groups_and_precedence_are_kept(problem: TourProblem) -> None:
    goals = tuple(
        replace(goal, group=("left", "right", None)[i % 3]) for i, goal in enumerate(problem.goals)
    )
    rules = (("right", "left"), ("spot_9", "spot_0"), ("spot_2", "right"))
    answer = planned(replace(problem, goals=goals, precedence=rules, end="any"), rounds=1)
    place = {k: i for i, k in enumerate(answer.order)}
    for group in (0, 1):
        places = sorted(place[k] for k in range(group, 12, 3))
        assert places == list(range(places[0], places[0] + 4))
    assert max(place[k] for k in (1, 4, 7, 10)) < min(place[k] for k in (0, 3, 6, 9))
    assert place[9] < place[0]
    assert place[2] < min(place[k] for k in (1, 4, 7, 10))
    assert len(answer.legs) == 12


def test_any_start_and_a_given_end(problem: TourProblem) -> None:
    end = START + 0.5 * np.eye(6)[0]
    answer = planned(replace(problem, start=None, end=end, goals=problem.goals[:4]), rounds=0)
    assert len(answer.legs) == 4
    assert answer.visits[0].arrival == 0.0
    assert np.abs(answer.legs[-1].trajectory.end - end).max() < 1e-9
    assert answer.trajectory.duration == pytest.approx(answer.time)


def test_a_goal_without_a_way_to_it_is_left_out(problem: TourProblem) -> None:
    """Shoulder and elbow move so little that the arm can't go round a wall in front of it."""
    chain = problem.robot.chain
    lower, upper = np.array(chain.limits.lower), np.array(chain.limits.upper)
    lower[:3], upper[:3] = [-1.5, -1.7, 1.3], [1.5, -1.3, 1.9]
    chain = replace(chain, limits=replace(chain.limits, lower=lower, upper=upper))
    wall = aw.Obstacle("wall", aw.Box((1.2, 0.02, 3.0)), aw.pose([0.9, 0.0, 1.5]))
    places = [np.array([turn, -1.5, 1.5, 0.0, 0.5, 0.0]) for turn in (-0.8, -0.9, -0.6, -0.7, 0.8)]
    shut = replace(
        problem,
        robot=replace(problem.robot, chain=chain),
        scene=aw.Scene([wall]),
        start=places[0],
        goals=tuple(TourGoal(str(k), (JointGoal(q),)) for k, q in enumerate(places[1:])),
    )
    options = TourOptions(Options(timeout=60.0), rounds=0, leg_timeout=0.3, allow_partial=True)
    answer = plan_tour(shut, options)
    assert isinstance(answer, Tour), answer
    assert sorted(answer.order) == [0, 1, 2]
    assert [one.index for one in answer.unvisited] == [3]
    assert "no motion to it was found" in answer.unvisited[0].message
    failure = plan_tour(shut, replace(options, allow_partial=False))
    assert isinstance(failure, Failure)
    assert "goals[3]" in failure.message


def test_goals_of_configurations_are_taken_as_they_are(problem: TourProblem) -> None:
    goals = tuple(
        TourGoal(f"q{i}", (JointGoal(START - 0.05 * i * np.eye(6)[(1, 0)[i % 2]]),))
        for i in range(1, 5)
    )
    answer = planned(replace(problem, goals=goals), rounds=0)
    for visit in answer.visits:
        wanted = goals[visit.index].alternatives[0]
        assert isinstance(wanted, JointGoal)
        assert (visit.joints == wanted.joints).all()


#: Half the angle of the cone about the direction of the tool [rad].
CONE = 0.6
#: To the side and down: straight joint motions do not keep a tool there.
ASIDE = np.array([0.0, np.sin(0.7), -np.cos(0.7)])
KEPT = ConeConstraint((0.0, 0.0, 1.0), ASIDE, CONE)


def aside(x: float, y: float, z: float) -> aw.PoseGoal:
    T = np.array(pose(x, y, z).T_base_tip)
    T[:3, 2], T[:3, 0] = ASIDE, (1.0, 0.0, 0.0)
    T[:3, 1] = np.cross(T[:3, 2], T[:3, 0])
    return aw.PoseGoal(T)


def few(problem: TourProblem, *constraints: object) -> TourProblem:
    """Three goals near and far, low and high, the tool aside at each."""
    rules = ConstraintSet(problem.robot.chain, constraints)  # type: ignore[arg-type]
    places = ((0.3, -0.45, 0.2), (0.6, -0.2, 0.2), (0.35, -0.45, 0.6))
    found = [
        aw.ik(problem.robot, aside(*place).T_base_tip, seed_joints=START).solutions
        for place in places
    ]
    goals = tuple(TourGoal(str(k), (aw.JointGoal(s[0].joints),)) for k, s in enumerate(found))
    return replace(problem, start=None, end="any", goals=goals, constraints=rules)


def test_every_leg_keeps_the_tool_aside_and_slow(problem: TourProblem) -> None:
    slow = few(problem, KEPT, ToolSpeedConstraint(0.3), ClearanceConstraint(0.01))
    assert slow.margin == 0.01
    tour = plan_tour(slow, TourOptions(Options(timeout=60.0), rounds=0))
    assert isinstance(tour, Tour), tour
    assert sorted(tour.order) == [0, 1, 2]
    cosine = np.cos(CONE)
    for leg in tour.legs:
        times = np.linspace(0.0, leg.trajectory.duration, 60)
        poses = [aw.fk(slow.robot, q) for q in leg.trajectory.sample(times)]
        assert min(ASIDE @ T[:3, 2] for T in poses) >= cosine - 1e-9
        points = np.array([T[:3, 3] for T in poses])
        speed = np.linalg.norm(np.diff(points, axis=0), axis=1) / np.diff(times)
        assert speed.max() <= 0.3 + 1e-9
        assert leg.certificate.path_constraints
        assert leg.certificate.min_clearance >= 0.0
    for before, after in pairwise(tour.legs):
        assert np.abs(before.trajectory.end - after.trajectory.start).max() < 1e-9


def test_ends_and_goals_that_violate_it_are_named(problem: TourProblem) -> None:
    held = few(problem, KEPT)
    failure = plan_tour(replace(held, start=START))
    assert isinstance(failure, Failure)
    assert failure.code == "START_STATE_VIOLATES_PATH_CONSTRAINTS"
    failure = plan_tour(replace(held, end=START))
    assert isinstance(failure, Failure)
    assert (failure.code, failure.stage) == ("GOAL_VIOLATES_PATH_CONSTRAINTS", "end")
    assert "the end of the tour" in failure.message
    up = np.array(pose(0.4, 0.3, 0.4).T_base_tip)
    up[:3, :3] = np.diag([1.0, 1.0, 1.0])
    goals = (replace(held.goals[0], alternatives=(aw.PoseGoal(up),)), *held.goals[1:])
    failure = plan_tour(replace(held, goals=goals))
    assert isinstance(failure, Failure)
    unvisited = failure.details["unvisited"]
    assert [one["index"] for one in unvisited] == [0]


def test_a_constraint_too_thin_for_a_motion_is_refused(problem: TourProblem) -> None:
    thin = few(problem, ConeConstraint((0.0, 0.0, 1.0), ASIDE, 1e-6))
    with pytest.raises(aw.ArmwrightError, match="at least are needed"):
        plan_tour(thin)


PASSED = Deadline(-np.inf)


def test_a_table_stops_when_time_is_up(problem: TourProblem) -> None:
    chain = problem.robot.chain
    limits = chosen_parametrization(
        Options().timing, chain.joint_names, chain.limits, Options().limits, chain
    )
    low, high = chain.sampling_bounds()
    joints = np.random.default_rng(0).uniform(low, high, (100, chain.n))
    real = np.ones(100)
    assert least_times(limits, joints, real, PASSED, straight=True) is None
    whole = least_times(limits, joints, real, Deadline.after(60.0), straight=True)
    assert whole is not None
    assert (whole == whole.T).all()
    assert (whole[~np.eye(100, dtype=bool)] > 0.0).all()
    bound = least_times(limits, joints, real, Deadline.after(60.0), straight=False)
    assert bound is not None
    assert (bound <= whole + 1e-6).all()


def test_a_bound_that_is_stopped_is_a_bound() -> None:
    times, first = instance(0, goals=40, branches=1)
    assert lower_bound(times, first, 10.0, PASSED) == 0.0
    whole = lower_bound(times, first, 10.0)
    assert lower_bound(times, first, 10.0, Deadline.after(60.0)) == whole > 0.0


@pytest.mark.parametrize("recorded", [False, True])
def test_the_first_proved_tour_is_answered_when_time_is_up(
    problem: TourProblem, monkeypatch: pytest.MonkeyPatch, recorded: bool
) -> None:
    """The clock jumps when the first tour is proved, or just before."""
    now = [0.0]
    monkeypatch.setattr(deadline, "time", SimpleNamespace(monotonic=lambda: now[0]))
    keep = TourSearch._record

    def record(self: TourSearch, round_number: int) -> bool:
        shorter = keep(self, round_number) if recorded else False
        now[0] = 1e6
        return shorter

    monkeypatch.setattr(TourSearch, "_record", record)
    answer: Any = plan_tour(problem, TourOptions(Options(timeout=60.0)))
    if recorded:
        assert isinstance(answer, Tour)
        assert len(answer.visits) == 12
        assert answer.search.stopped == "deadline"
        assert (answer.lower_bound, answer.gap) == (0.0, 0.0)
    else:
        assert isinstance(answer, Failure)
        assert answer.code == "TIMED_OUT"
        assert answer.details["proved_legs"] == 13


@pytest.mark.parametrize("end", ["start", np.array([0.9, -1.44, 2.5, 0.0, -1.07, 0.0])])
def test_a_tour_without_the_way_to_its_end_is_partial_and_says_so(
    problem: TourProblem, monkeypatch: pytest.MonkeyPatch, end: Any
) -> None:
    """The clock jumps when all legs but the last are proved."""
    now = [0.0]
    monkeypatch.setattr(deadline, "time", SimpleNamespace(monotonic=lambda: now[0]))

    def record(self: TourSearch, _: int) -> bool:
        del self.legs.legs[self._pairs()[-1]]
        now[0] = 1e6
        return False

    monkeypatch.setattr(TourSearch, "_record", record)
    asked = replace(problem, goals=problem.goals[:3], end=end)
    answer = plan_tour(asked, TourOptions(Options(timeout=60.0), allow_partial=True))
    assert isinstance(answer, Tour)
    assert (len(answer.visits), len(answer.legs), answer.unvisited) == (3, 3, ())
    assert not answer.reaches_end
    assert answer.lower_bound == 0.0
    (note,) = answer.notes
    assert repr(asked.goals[answer.order[-1]].id) in note
    assert ("back to the start" in note) == isinstance(end, str)
    assert tour_answer(answer, asked, None)["status"] == "partial"
