"""Record of a search: every alternative that was looked at, with what came of it."""

from collections import Counter

from kinematics.arrays import Array
from planning.sequence.node import Node
from planning.sequence.result import Trial
from planning.sequence.stage import Grasp, Stage
from planning.sequence.target import Candidates, Outcome

#: Outcomes by how near they come to a solution.
_ORDER = ("out_of_reach", "outside_limits", "in_collision", "open", "failed", "solved")


class Record:
    """Trials by the choices that led to them."""

    def __init__(self) -> None:
        self._trials: dict[tuple[int, ...], Trial] = {}
        self._reasons: dict[int, Counter[str]] = {}

    @property
    def trials(self) -> tuple[Trial, ...]:
        """All of them, in the order of the stages and of the lists."""
        return tuple(sorted(self._trials.values(), key=lambda trial: (trial.stage, trial.choices)))

    def note_candidates(self, choices: tuple[int, ...], stage: int, candidates: Candidates) -> None:
        """Note what came of a stage's targets before any path was planned."""
        for index, (outcome, pair, joints) in candidates.outcomes.items():
            reached = outcome is Outcome.REACHED
            trial = self._trial((*choices, index), stage)
            if reached:
                continue
            trial.outcome = max(trial.outcome, outcome.value, key=_ORDER.index)
            if trial.outcome == "open":
                trial.outcome = outcome.value
            reason = str(outcome.value)
            if pair is not None:
                reason = f"in collision: {pair[0]} and {pair[1]}"
            self._count(trial, stage, reason, joints)

    def note_failure(self, node: Node, stage: int, reason: str) -> None:
        """Note that a configuration of a node's target led nowhere, and at which stage."""
        self._reasons.setdefault(stage, Counter())[reason] += 1
        if node.target is None:
            return
        target_stage = node.steps[-1].index if node.steps else stage
        trial = self._trial(node.choices, target_stage)
        _note(trial, reason, node.joints)
        if trial.outcome == "open":
            trial.outcome = "failed"

    def note_child(
        self, node: Node, choice: int, stages: tuple[int, int], reason: str, joints: Array
    ) -> None:
        """Note that a configuration of the next target has no way to it.

        Args:
            node: The choices before.
            choice: Number of the target.
            stages: Number of its stage, and of the stage that failed.
            reason: A short sentence.
            joints: The configuration, shape (n,).
        """
        trial = self._trial((*node.choices, choice), stages[0])
        self._count(trial, stages[1], reason, joints)
        if trial.outcome == "open":
            trial.outcome = "failed"

    def note_solution(self, node: Node) -> None:
        """Note that all stages are proved with the choices of a node."""
        for one in node.path:
            if one.target is not None:
                self._trial(one.choices, one.steps[-1].index).outcome = "solved"

    def farthest(self) -> tuple[int, str, int] | None:
        """The latest stage at which something failed, its most frequent reason and how often."""
        if not self._reasons:
            return None
        stage = max(self._reasons)
        reason, count = self._reasons[stage].most_common(1)[0]
        return stage, reason, count

    def _count(self, trial: Trial, stage: int, reason: str, joints: Array | None) -> None:
        _note(trial, reason, joints)
        self._reasons.setdefault(stage, Counter())[reason] += 1

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
    if any(word in reason for word in ("collision", "too near", " touch", " overlap", " apart")):
        return (
            "Give more alternatives, move what is in the way, or name the pairs that may touch in "
            "touch_links, support or allowed_collisions."
        )
    if isinstance(stage, Grasp):
        return "Give more grasps, or more places."
    return "Give more alternatives, shorter distances, or a smaller margin."
