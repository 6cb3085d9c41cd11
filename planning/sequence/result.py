"""Results of a task: a certified plan of every stage, or why there is none, and what was tried."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Any

from kinematics.arrays import Array
from kinematics.trajectory.trajectory import Trajectory
from planning.proof.certificate import Certificate
from planning.result import ChosenConfiguration, Plan
from planning.sequence.stage import Pair, Signal
from planning.sequence.world import World
from planning.values.finger_motion import FingerMotion
from planning.values.preferences import GoalCosts


@dataclass(frozen=True, slots=True)
class TaskOptions:
    """Options of the search.

    Args:
        timeout: Seconds for everything.
        improve: Seconds to search for a shorter answer after the first one.
        allow_partial: Whether the first stages are an answer where not all can be done.
        observer: Called with the share of the work that is done, from 0 to 1, and the stage.
        offer: Called with each proved answer that is the best so far.
        goal_costs: Weights by which configurations of poses are chosen.
    """

    timeout: float = 5.0
    improve: float = 0.0
    allow_partial: bool = False
    observer: Callable[[float, str], None] | None = field(default=None, repr=False, compare=False)
    offer: "Callable[[SequencePlan], None] | None" = field(default=None, repr=False, compare=False)
    goal_costs: GoalCosts = field(default_factory=GoalCosts)


@dataclass(frozen=True, slots=True, eq=False)
class StagePlan:
    """One stage with its motion and the proof.

    Args:
        index: Number of the stage.
        kind: Kind of the stage on the wire.
        name: Name of the object; empty for none.
        trajectory: Motion of the stage; a short stay where the arm does not move.
        certificate: The proof, with what is held and what may touch in this stage.
        after: The world after it.
        allowed: Pairs that the proof lets touch.
        target: Number of the alternative that was chosen, of a stage that has some.
        plan: The plan of its motion; None where the arm stands still.
        milliseconds: Time spent on it [ms].
        fingers: Motion of the gripper in it; None where its fingers stand still.
        passes: Whether the arm passes its end without resting, as the next stage goes on.
        configuration: The configuration that was chosen at its end, of a stage with a pose.
        event: Word with the machines around, of a stage that says one.
    """

    index: int
    kind: str
    name: str
    trajectory: Trajectory
    certificate: Certificate
    after: World
    allowed: tuple[Pair, ...]
    target: int | None
    plan: Plan | None
    milliseconds: float
    fingers: FingerMotion | None = None
    passes: bool = False
    configuration: ChosenConfiguration | None = None
    event: Signal | None = None


def total_duration(stages: Iterable[StagePlan]) -> float:
    """Time of stages one after another [s]."""
    return sum(stage.trajectory.duration for stage in stages)


@dataclass(frozen=True, slots=True)
class Improvement:
    """A certified answer that was the best so far.

    Args:
        milliseconds: Time since the search began [ms].
        duration: Duration of all stages together [s].
    """

    milliseconds: float
    duration: float


@dataclass(slots=True)
class Trial:
    """One alternative of one stage under the choices before it, and what came of it.

    Args:
        choices: Numbers of the alternatives chosen in each stage that has some, up to this one.
        stage: Number of the stage.
        outcome: "solved", "failed", "in_collision", "outside_limits", "out_of_reach", or "open"
            where the search did not come to it.
        reasons: Reasons for failures, each with how many configurations had it.
        joints: One of the configurations that failed, shape (n,); None where there is none inside
            the limits.
    """

    choices: tuple[int, ...]
    stage: int
    outcome: str
    reasons: dict[str, int]
    joints: Array | None = None


@dataclass(frozen=True, slots=True)
class FoundOrder:
    """An order of items that was to be the shortest.

    Args:
        items: Names of the items, in the order that was found.
        duration: Duration of all stages in this order [s].
        written: Duration of all stages in the order as written [s]; None where that can't be done.
    """

    items: tuple[str, ...]
    duration: float
    written: float | None

    @property
    def saved(self) -> float | None:
        """Time saved against the order as written [s]; None where that can't be done."""
        return None if self.written is None else self.written - self.duration


@dataclass(frozen=True, slots=True, eq=False)
class SequencePlan:
    """All stages of a task, each with a motion that is proved.

    Args:
        stages: Stages in order; each begins where the one before ends, at rest or as fast.
        duration: Duration of all of them [s].
        trials: The alternatives that were checked.
        improvements: Certified answers in the order they were found, the last one is answered.
        exhausted: Whether every combination was tried or can't be better by its estimate.
        complete: Whether these are all stages; not where only the first ones could be done.
        failure: Why the later stages could not be done; None where all are.
        deterministic: Whether the same task gives the same answer again: time ended no search.
        orders: Orders of items that were to be the shortest.
    """

    stages: tuple[StagePlan, ...]
    duration: float
    trials: tuple[Trial, ...]
    improvements: tuple[Improvement, ...]
    exhausted: bool
    complete: bool = True
    failure: "SequenceFailure | None" = None
    deterministic: bool = True
    orders: tuple[FoundOrder, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class SequenceFailure:
    """No certified motion of all stages, and why.

    Args:
        code: MoveIt's name of the error where one exists.
        message: Message on what went wrong.
        hint: Hint at what to try.
        stage: Number of the stage that the search never got past.
        details: Values a program can use.
        trials: The alternatives that were checked.
        prefix: Proved stages of the combination that came farthest.
        nearest: Configuration of the arm before the stage, shape (n,); None where unknown.
        reached: Number of the last stage that anything was tried for.
    """

    code: str
    message: str
    hint: str
    stage: int
    details: dict[str, Any]
    trials: tuple[Trial, ...]
    prefix: tuple[StagePlan, ...] = ()
    nearest: Array | None = None
    reached: int = 0
