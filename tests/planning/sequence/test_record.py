"""The record of a search: outcomes come only nearer, reasons are counted, one stage is blamed."""

import numpy as np
import pytest

from planning.sequence.node import Node
from planning.sequence.record import Blame, Check, Record, hint_of
from planning.sequence.stage import Grasp, Wait
from planning.sequence.step import Step
from planning.sequence.target import Candidates, Outcome, Target, Verdict
from tests.planning.sequence import crate

_NONE = np.zeros((0, 7))


def _candidates(**outcomes: Verdict) -> Candidates:
    found = {int(name.removeprefix("n")): outcome for name, outcome in outcomes.items()}
    return Candidates((), _NONE, found)


def _root() -> Node:
    return Node(None, 0, crate.world(), crate.HOME, {})


def _child(root: Node, number: int, stage: int) -> Node:
    target = Target(number, None, crate.HOME, None)
    grasp = Grasp("crate", crate.grasps(2))
    world = crate.world()
    step = Step(stage, grasp, "none", world, world, {}, crate.HOME, crate.HOME)
    return Node(root, 1, world, crate.HOME, {}, target, [step])


def test_candidates_are_noted_with_their_reasons_and_stay_open_where_they_are_reached() -> None:
    record = Record()
    record.note_candidates((), 2, _candidates(
        n0=Verdict(Outcome.REACHED), n1=Verdict(Outcome.OUT_OF_REACH),
        n2=Verdict(Outcome.IN_COLLISION, ("arm", "lid"), np.ones(7)),
    ))  # fmt: skip
    outcomes = {trial.choices: (trial.stage, trial.outcome, trial.reasons)
                for trial in record.trials}  # fmt: skip
    assert outcomes == {
        (0,): (2, "open", {}),
        (1,): (2, "out_of_reach", {"out_of_reach": 1}),
        (2,): (2, "in_collision", {"in collision: arm and lid": 1}),
    }
    shown = [trial.joints for trial in record.trials]
    assert shown[:2] == [None, None]
    np.testing.assert_array_equal(shown[2], np.ones(7))


def test_an_outcome_only_comes_nearer_to_a_solution() -> None:
    record = Record()
    record.note_candidates((), 2, _candidates(n0=Verdict(Outcome.IN_COLLISION, ("arm", "lid"))))
    record.note_candidates((), 2, _candidates(n0=Verdict(Outcome.OUT_OF_REACH)))
    (trial,) = record.trials
    assert trial.outcome == "in_collision"
    assert trial.reasons == {"in collision: arm and lid": 1, "out_of_reach": 1}


def test_the_last_check_that_was_reached_is_to_blame_with_its_most_frequent_reason() -> None:
    record, root = Record(), _root()
    assert record.blame() is None
    record.note_failure(root, 0, "starts badly")
    for reason in ("too short", "collides", "collides"):
        record.note_child(root, 1, (2, 1), reason, np.full(7, float(len(reason))))
    assert record.blame() == Blame(1, "collides", 2, {})
    (trial,) = record.trials
    assert (trial.choices, trial.stage, trial.outcome) == ((1,), 2, "failed")
    assert trial.reasons == {"too short": 1, "collides": 2}
    np.testing.assert_array_equal(trial.joints, np.full(7, 9.0))  # that of the first reason


def test_what_cuts_off_the_rest_is_to_blame_and_not_the_deepest_stage_looked_at() -> None:
    record, root = Record(), _root()
    # Two grasps fail at late stages before any path, the third passes and finds no free motion.
    record.note_candidates((0,), 7, _candidates(n0=Verdict(Outcome.OUT_OF_REACH)), Check.PLACE)
    record.note_failure(_child(root, 1, 2), 9, "no retreat")
    assert record.blame() == Blame(9, "no retreat", 1, {})
    record.note_failure(_child(root, 2, 2), 4, "touches", Check.STILL_OR_STRAIGHT)
    assert record.blame() == Blame(4, "touches", 1, {})
    for _ in range(2):
        record.note_failure(_child(root, 3, 2), 0, "no path", Check.FREE)
    assert record.blame() == Blame(0, "no path", 2, {})


def test_failures_and_solutions_belong_to_the_choices_of_their_node() -> None:
    record, root = Record(), _root()
    child = _child(root, 3, 2)
    record.note_failure(child, 5, "no lift")
    assert [(t.choices, t.stage, t.outcome) for t in record.trials] == [((3,), 2, "failed")]
    record.note_solution(child)
    record.note_failure(child, 5, "no lift")
    (trial,) = record.trials
    assert (trial.outcome, trial.reasons) == ("solved", {"no lift": 2})


def test_trials_are_in_the_order_of_stages_and_lists() -> None:
    record = Record()
    for choices, stage in (((1, 0), 8), ((2,), 2), ((0, 4), 8), ((1,), 2)):
        number = choices[-1]
        found = Candidates((), _NONE, {number: Verdict(Outcome.REACHED)})
        record.note_candidates(choices[:-1], stage, found)
    assert [trial.choices for trial in record.trials] == [(1,), (2,), (0, 4), (1, 0)]


def test_a_step_that_stands_still_lasts_its_bound_until_it_has_a_plan() -> None:
    world = crate.world()
    step = Step(0, Wait(0.4), "none", world, world, {}, crate.HOME, crate.HOME, bound=0.4)
    assert step.least_time == 0.4
    solved = crate.plan().stages[0]
    step.plan = solved
    assert step.least_time == solved.trajectory.duration


@pytest.mark.parametrize(
    "reason", ["'a' and 'b' touch at the start", "'a' and 'b' overlap by 0.1 m at the start"]
)
def test_what_touches_is_cured_by_naming_what_may_touch(reason: str) -> None:
    assert "allowed_collisions" in hint_of(Wait(0.4), reason)
