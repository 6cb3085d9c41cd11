"""The search for a path with the preferred clearance first, and then with less."""

import numpy as np
import pytest

from obstacles.scene import Scene
from planning import path_search
from planning.options import Options
from planning.pipeline import plan
from planning.preferred_clearance import PreferredClearance
from planning.problem import JointGoal, Problem
from planning.result import Plan
from tests.planning.scenes import box
from tests.planning.slider import slider

#: A wall across the table with a gap 20 mm wider than the ball, off the straight way.
LONG, SHORT = box("long", (0.1, 2.0, 0.3), (0, -0.76, 0)), box("short", (0.1, 1, 0.3), (0, 0.86, 0))
START, GOAL = np.array([-0.6, 0.0]), np.array([0.6, -0.2])


def stages(scene: Scene) -> list[str]:
    """Names of the stages that looked for a path with 40 mm to spare, and then without."""
    problem = Problem(slider(), scene, START, (JointGoal(GOAL),))
    answer = plan(problem, Options(clearance=PreferredClearance(0.04)))
    assert isinstance(answer, Plan)
    assert answer.certificate.verified
    names = [stage.name for stage in answer.stages]
    return names[1 : names.index("shortcut")]


def test_where_there_is_no_room_both_planners_are_asked_again_with_less_clearance() -> None:
    # With all of the preferred clearance, with half of it, and with none.
    assert stages(Scene((LONG, SHORT))) == 3 * ["straight_line", "rrt_connect"]


def test_where_there_is_room_one_search_is_enough() -> None:
    assert stages(Scene((LONG,))) == ["straight_line", "rrt_connect"]


def test_where_what_was_looked_at_is_not_proved_all_is_done_again_with_proofs(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(path_search, "shortcut_unproved", lambda *_: np.zeros((0, 2)))
    problem = Problem(slider(), Scene((LONG,)), START, (JointGoal(GOAL),))
    answer = plan(problem, Options(clearance=PreferredClearance(0.04)))
    assert isinstance(answer, Plan)
    assert answer.certificate.verified
    told = [(stage.name, stage.outcome) for stage in answer.stages if stage.name == "shortcut"]
    assert told == [("shortcut", "failed"), ("shortcut", "succeeded")]
