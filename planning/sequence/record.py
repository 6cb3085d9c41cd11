"""Record of a search: every alternative that was checked, with what came of it.

A search checks a combination of choices in a fixed order, what is cheap first. What fails ends the
combination at its place in that order. The last place that was reached cuts off all combinations
that passed the others: the stage that fails there is to blame, be it early or late in the task.
"""

from collections import Counter
from enum import IntEnum
from typing import Any, NamedTuple

from kinematics.arrays import Array
from kinematics.ik.closed_form.analytic import branches
from kinematics.ik.closed_form.arm_parts import out_of_reach
from kinematics.ik.closed_form.structure import structure
from planning.sequence.node import Node
from planning.sequence.result import SequenceFailure, StagePlan, Trial
from planning.sequence.stage import Grasp, Stage, describe_stage
from planning.sequence.step import LineStopped
from planning.sequence.target import Candidates, Outcome
from planning.sequence.task import Task
from planning.values.deadline import Deadline

#: Outcomes by how near they come to a solution.
_ORDER = ("out_of_reach", "outside_limits", "in_collision", "open", "failed", "solved")
#: Reasons for stops of an arm that comes to the end of its reach.
_AT_THE_END = ("singularity", "unreachable", "branch", "deviation")
#: Reasons of collisions begin so.
_COLLIDES = "in collision: "


class Check(IntEnum):
    """Checks of one combination of choices, in the order in which a search makes them."""

    ONWARD = 0
    TARGET = 1
    PLACE = 2
    APPROACH = 3
    STILL_OR_STRAIGHT = 4
    FREE = 5


class Blame(NamedTuple):
    """The stage at which a search fails.

    Args:
        stage: Number of the stage.
        reason: A short sentence.
        times: How often it was the reason.
        details: Values a program can use: pair and depth of a collision.
        others: Other reasons there with how often each was one, in words.
    """

    stage: int
    reason: str
    times: int
    details: dict[str, Any]
    others: str = ""


class Record:
    """Trials by the choices that led to them."""

    def __init__(self) -> None:
        self._trials: dict[tuple[int, ...], Trial] = {}
        self._reasons: dict[tuple[int, int, int], Counter[tuple[int, str]]] = {}
        self._colliding: dict[int, list[Candidates]] = {}

    @property
    def trials(self) -> tuple[Trial, ...]:
        """All of them, in the order of the stages and of the lists."""
        return tuple(sorted(self._trials.values(), key=lambda trial: (trial.stage, trial.choices)))

    def note_candidates(
        self,
        choices: tuple[int, ...],
        stage: int,
        candidates: Candidates,
        check: Check = Check.TARGET,
    ) -> None:
        """Note what came of a stage's targets before any path was planned.

        Args:
            choices: Numbers of the alternatives chosen before.
            stage: Number of the stage.
            candidates: Candidates of the targets.
            check: TARGET, or PLACE for places that were checked when the grasp was chosen.
        """
        known = self._colliding.setdefault(stage, [])
        # Lists of candidates of one stage whose collisions are checked in the end.
        if len(candidates.colliding) and candidates not in known and len(known) < 16:
            known.append(candidates)
        for index, (outcome, pair, joints, why) in candidates.outcomes.items():
            reached = outcome is Outcome.REACHED
            trial = self._trial((*choices, index), stage)
            if reached:
                continue
            if candidates.level and _ORDER.index(outcome.value) <= _ORDER.index(trial.outcome):
                continue  # as coarsely found
            trial.outcome = max(trial.outcome, outcome.value, key=_ORDER.index)
            if trial.outcome == "open":
                trial.outcome = outcome.value
            reason = str(outcome.value)
            if pair is not None:
                reason = why or f"{_COLLIDES}{pair[0]} and {pair[1]}"
            _note(trial, reason, joints)
            self._count(check, len(choices) - (check is Check.PLACE), stage, reason)

    def note_failure(
        self, node: Node, stage: int, reason: str, check: Check = Check.ONWARD
    ) -> None:
        """Note that a configuration of a node's target led nowhere, and at which stage."""
        self._count(check, node.depth, stage, reason)
        if node.target is None:
            return
        target_stage = node.steps[-1].index if node.steps else stage
        self._fail(node.choices, target_stage, reason, node.joints)

    def note_child(
        self, node: Node, choice: int, stages: tuple[int, int | None], reason: str, joints: Array
    ) -> None:
        """Note that a configuration of the next target has no way to it, or a grasp no place.

        Args:
            node: The choices before.
            choice: Number of the target.
            stages: Number of its stage, and of the stage that failed; None where it is noted.
            reason: A short sentence.
            joints: The configuration, shape (n,).
        """
        own, failed = stages
        if failed is not None:
            self._count(Check.APPROACH, node.depth, failed, reason)
        self._fail((*node.choices, choice), own, reason, joints)

    def _fail(self, choices: tuple[int, ...], stage: int, reason: str, joints: Array) -> None:
        trial = self._trial(choices, stage)
        _note(trial, reason, joints)
        if trial.outcome == "open":
            trial.outcome = "failed"

    def note_solution(self, node: Node) -> None:
        """Note that all stages are proved with the choices of a node."""
        for one in node.path:
            if one.target is not None:
                self._trial(one.choices, one.steps[-1].index).outcome = "solved"

    def blame(self) -> Blame | None:
        """The stage that cuts off what passed all other checks; None where nothing failed."""
        if not self._reasons:
            return None
        ((stage, reason), count), *more = self._reasons[max(self._reasons)].most_common(4)
        told = [f"{other} ({times} times)" for (k, other), times in more if k == stage]
        others = f"; also {', '.join(told)}" if told else ""
        overlaps = [one.least_overlap() for one in self._colliding.get(stage, ())]
        known = [overlap for overlap in overlaps if overlap is not None]
        if not (known and reason.startswith(_COLLIDES)):
            return Blame(stage, reason, count, {}, others)
        depth, pair = min(known)
        text = f"{_COLLIDES}{pair[0]} and {pair[1]}, at best by {depth:.4g} m"
        return Blame(stage, text, count, {"pair": list(pair), "depth": depth}, others)

    def reached(self) -> int:
        """Number of the last stage at which something failed."""
        return max((k for counter in self._reasons.values() for k, _ in counter), default=0)

    def _count(self, check: Check, depth: int, stage: int, reason: str) -> None:
        """Count a reason at its place in the order of a search's checks."""
        is_motion = check >= Check.STILL_OR_STRAIGHT
        place = (int(check), stage, 0) if is_motion else (0, depth, int(check))
        self._reasons.setdefault(place, Counter())[stage, reason] += 1

    def _trial(self, choices: tuple[int, ...], stage: int) -> Trial:
        if choices not in self._trials:
            self._trials[choices] = Trial(choices, stage, "open", {})
        return self._trials[choices]


def _note(trial: Trial, reason: str, joints: Array | None) -> None:
    trial.reasons[reason] = trial.reasons.get(reason, 0) + 1
    if trial.joints is None:
        trial.joints = joints


def hint_of(stage: Stage, reason: str) -> str:
    """Return what to try where a stage fails for a reason."""
    if "out_of_reach" in reason or "outside_limits" in reason:
        return "Bring what it aims at nearer to the robot, or give more alternatives."
    if "touch_depth" in reason:
        return "Move it out, or raise touch_depth if it is meant (null for any depth)."
    if any(word in reason for word in ("collision", "too near", " touch", " overlap", " apart")):
        return (
            "Give more alternatives, move what is in the way, or name the pairs that may touch in "
            "touch_links, support or allowed_collisions."
        )
    if isinstance(stage, Grasp):
        return "Give more grasps, or more places."
    return "Give more alternatives, shorter distances, or a smaller margin."


def search_failure(
    task: Task, record: Record, timeout: float, deadline: Deadline, *, late: bool,
    prefix: tuple[StagePlan, ...],
) -> SequenceFailure:  # fmt: skip
    """Why a search found no motions of all stages.

    Args:
        task: The stages.
        record: Record of all trials.
        timeout: Timeout of everything [s].
        deadline: The end of everything.
        late: Whether time was up.
        prefix: Proved stages of the combination that came farthest.
    """
    k, reason, times, known, others = record.blame() or Blame(0, "time was up", 1, {})
    what = describe_stage(task.stages, k)
    hint = hint_of(task.stages[k], reason)
    details = {"index": k, "reason": reason, "count": times, **known}
    if late:
        code = "TIMED_OUT"
        message = (
            f"no proved answer within the timeout of {timeout:.3g} s; the search "
            f"came to {what}: {reason} ({times} times){others}"
        )
        hint = f"Allow more time. {hint}"
    else:
        code = "PLANNING_FAILED"
        message = f"no combination can be done: {what} fails: {reason} ({times} times){others}"
    details = deadline.interruptions.reported_in(code, details)
    reached = max(record.reached(), k)
    return SequenceFailure(code, message, hint, k, details, record.trials, prefix, reached=reached)


def describe_stop(led: LineStopped | str) -> str:
    """Why a straight motion is too short, or fingers hold nothing, in words."""
    if isinstance(led, str):
        return led
    reason = led.stop.message
    if led.stop.reason in _AT_THE_END:
        chain, end = led.checker.model.robot.chain, led.way.pose(1.0)
        form = structure(chain)
        if form is not None and not form.redundant and not len(branches(chain, end).table):
            gap = out_of_reach(chain, end) or 0.0
            by = f", by {gap:.4g} m of its wrist at least" if gap > 0.0 else ""
            reason = (
                f"out_of_reach: the shortest way asked for, {led.way.length:.3g} m, ends there{by}"
            )
    return f"the tool comes {led.distance:.3g} m straight: {reason}"
