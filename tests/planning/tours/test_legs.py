"""Legs run backwards: proved anew, from the end of the way there to its start."""

import numpy as np

from planning.result import Failure
from planning.tours.planner import _TourPlanner
from planning.tours.problem import TourOptions, TourProblem
from planning.tours.result import Leg
from planning.values.deadline import Deadline
from tests.planning.tours.test_planner import problem as problem  # noqa: PLC0414

LATER = Deadline.after(1e6)


def test_a_leg_serves_either_way(problem: TourProblem) -> None:
    planner = _TourPlanner(problem, TourOptions(), lambda _share, _stage: None, lambda _tour: None)
    configurations = planner._configurations(problem.start)
    assert isinstance(configurations, dict)
    tables = planner._tables(configurations, (problem.start, problem.start))
    assert not isinstance(tables, Failure)
    _, legs = tables
    there, back = legs.plan(0, 9, LATER), legs.plan(9, 0, LATER)
    assert isinstance(there, Leg)
    assert isinstance(back, Leg)
    assert back.certificate.verified
    assert back.trajectory == there.trajectory.reverse()
    np.testing.assert_allclose(back.trajectory.start, legs.joints[9], atol=1e-9)
    np.testing.assert_allclose(back.trajectory.end, legs.joints[0], atol=1e-9)
    np.testing.assert_array_equal(back.waypoints, there.waypoints[::-1])
