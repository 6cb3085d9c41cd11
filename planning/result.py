"""Results of planning: a certified plan, or a failure that says what to try.

Reports of the stages of planning, written down as they end.
"""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal, NamedTuple, TypeVar

import numpy as np

from kinematics.arrays import Array, frozen
from kinematics.trajectory.trajectory import Trajectory
from planning.clearance_report import ClearanceReport
from planning.proof.certificate import Certificate
from planning.stops.certificate import StopCertificate, Surroundings
from planning.timing.parametrization import TimingReport
from planning.tool_motions.tool_corner import ToolCurve
from planning.tool_motions.tool_path import PartName, ToolPath


class StageReport(NamedTuple):
    """Report of one stage of planning.

    Args:
        name: The stage.
        outcome: "succeeded", "failed", "skipped".
        milliseconds: Time it took [ms].
        detail: One sentence for a person.
        processor_milliseconds: Time this process computed for it [ms]; on a busy machine less.
    """

    name: str
    outcome: str
    milliseconds: float
    detail: str = ""
    processor_milliseconds: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class Path:
    """A polyline in joint space.

    Args:
        waypoints: Shape (k, n) [rad or m].
    """

    waypoints: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "waypoints", frozen(self.waypoints))

    @property
    def length(self) -> float:
        """Euclidean length in joint space."""
        steps = self.waypoints[1:] - self.waypoints[:-1]
        # The bits of numpy's norm, in half of its time.
        return float(np.sqrt(np.add.reduce(steps * steps, axis=1)).sum())


@dataclass(frozen=True, slots=True)
class SpeedLimit:
    """Limit of a joint that keeps the tool below the speed asked for.

    Args:
        speed: Largest constant speed of the tool that it allows [m/s].
        joint: Name of the joint.
        quantity: Which limit of it.
    """

    speed: float
    joint: str
    quantity: Literal["velocity", "acceleration", "jerk"]


@dataclass(frozen=True, slots=True)
class ToolMotionReport:
    """Result of one tool motion.

    Args:
        kind: "lin", "circ" or "corner".
        length: Of the whole of it [m].
        angle: How far the tool turns in the whole of it [rad].
        fraction: How far it was carried out.
        begins: When [s].
        ends: When [s].
        motion: The motion itself.
        asked: Index of the motion of the request that it is a part of.
        blends: Whether it rounds the corner at the end of that motion.
        part: Of what it is a part.
        speed_limit: What keeps the tool from the speed asked for; None where nothing does, or none
            is asked for. Ramps from rest and from slower motions are not meant.
    """

    kind: str
    length: float
    angle: float
    fraction: float
    begins: float
    ends: float
    motion: ToolCurve
    asked: int = 0
    blends: bool = False
    part: PartName = "motion"
    speed_limit: SpeedLimit | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Descent:
    """Course of a descent on a potential.

    Args:
        waypoints: Shape (k, n), before they were shortened to a path [rad or m].
        potentials: U at each of them, shape (k,) [J].
        iterations: Steps taken.
    """

    waypoints: Array
    potentials: Array
    iterations: int

    def __post_init__(self) -> None:
        for name in ("waypoints", "potentials"):
            object.__setattr__(self, name, frozen(getattr(self, name)))


@dataclass(frozen=True, slots=True)
class Progress:
    """A path that was the shortest so far, while a planner went on looking.

    Args:
        milliseconds: Since the planner began [ms].
        edges: Looked at until then.
        length: Of the path, Euclidean in joint space.
    """

    milliseconds: float
    edges: int
    length: float


@dataclass(frozen=True, slots=True, eq=False)
class Failure:
    """No certified motion, and why.

    Args:
        code: MoveIt's name of the error where one exists.
        message: What went wrong.
        hint: What to try.
        stage: Where it went wrong.
        stages: What each stage did, in order.
        details: Values a program can use.
    """

    code: str
    message: str
    hint: str
    stage: str
    stages: tuple[StageReport, ...] = ()
    details: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Explanation:
    """The reason why a planner found no path, and what to try.

    Args:
        hint: Both, for a person.
        details: Values a program can use.
    """

    hint: str
    details: Mapping[str, Any]


@dataclass(frozen=True, slots=True, eq=False)
class Attempt:
    """Outcome of one planner: a path, or why there is none.

    Args:
        waypoints: Shape (k, n), every leg free; None where it found none.
        detail: How it ended, for a person.
        notes: What the answer has to say of it.
        descent: Where it went, of a potential field.
        progress: The shortest paths over time, of a planner that goes on after the first.
        details: Values a program can use, where it found none.
        tool_path: Joint paths through the waypoints that lead the tool; None where the path is the
            polyline.
        stopped: Why the tool path ends early, where it does.
        failure: Why there is no path, where the planner knows itself and no diagnosis is needed.
        keep_path: Whether the waypoints are timed and proved as they are, without shortcuts.
        proved: Whether every leg is proved free; otherwise states of it were checked.
        explain: Finds why there is no path and what to do, of a planner that knows; called only
            where no other planner found one.
    """

    waypoints: Array | None
    detail: str
    notes: tuple[str, ...] = ()
    descent: Descent | None = None
    progress: tuple[Progress, ...] = ()
    details: Mapping[str, Any] = field(default_factory=dict)
    tool_path: ToolPath | None = None
    stopped: Mapping[str, Any] | None = None
    failure: Failure | None = None
    keep_path: bool = False
    proved: bool = True
    explain: Callable[[], Explanation] | None = None


@dataclass(frozen=True, slots=True)
class ChosenConfiguration:
    """One of a pose's configurations, as it was chosen.

    Args:
        branch: Name of its branch of the closed form; None where the arm has none.
        limit_share: Distance of the joint nearest to its limit, as a share of the joint's range.
        costs: What it costs, weighted, by the names of ``GoalCosts``.
        found: How many free configurations were found.
        cheaper: How many of them cost less, clearance left out.
        at_limit: How many of them are within 2 % of a joint limit.
        reason: Why this one and not another.
    """

    branch: str | None
    limit_share: float
    costs: dict[str, float]
    found: int
    cheaper: int
    at_limit: int
    reason: str


@dataclass(frozen=True, slots=True, eq=False)
class Plan:
    """A motion that has been proved.

    Args:
        planner: Name of the stage that found the path.
        stages: What each stage did, in order.
        path: The shortened polyline.
        trajectory: The timed motion: this is what the certificate is about.
        certificate: The proof.
        notes: What was done to the request (a snapped start, ...), for the answer.
        descent: Where a potential field went, if one found the path.
        progress: The shortest paths over time, of a planner that goes on after the first.
        fraction: How much of the tool's motions was carried out, where these were asked for.
        tool_motions: What became of each.
        stopped: Why it ends early, where it does.
        clearance: Where the motion is nearer to something than preferred.
        configuration: The configuration of a pose that it ends in; None where there was no choice.
        timing: Method and limits that the motion was timed by.
        deterministic: Whether the same request gives the same plan again: neither time nor memory
            ended a search.
        stops: The proof of its stops, where these were asked for.
        surroundings: Robot, scene, margin and limits that its stops are found for.
    """

    planner: str
    stages: tuple[StageReport, ...]
    path: Path
    trajectory: Trajectory
    certificate: Certificate
    notes: tuple[str, ...] = ()
    descent: Descent | None = None
    progress: tuple[Progress, ...] = ()
    fraction: float | None = None
    tool_motions: tuple[ToolMotionReport, ...] = ()
    stopped: Mapping[str, Any] | None = None
    clearance: ClearanceReport | None = None
    configuration: ChosenConfiguration | None = None
    timing: TimingReport | None = None
    deterministic: bool = True
    stops: StopCertificate | None = None
    surroundings: Surroundings | None = field(default=None, repr=False, compare=False)

    def __repr__(self) -> str:
        return f"Plan({self.planner}, {self.trajectory.duration:.3f} s, {self.certificate!r})"


_T = TypeVar("_T")


@dataclass(slots=True)
class Stages:
    """Reports of the stages, in order.

    Args:
        observer: Called with the name of each stage as it begins.
        reports: Reports of the stages that have ended.
    """

    observer: Callable[[str], None] | None = None
    reports: list[StageReport] = field(default_factory=list)

    def run(
        self, name: str, stage: Callable[[], _T], describe: Callable[[_T], tuple[bool, str]]
    ) -> _T:
        """Run a stage and time it; ``describe`` says if it succeeded, and how, for the report."""
        if self.observer is not None:
            self.observer(name)
        began, computed = time.perf_counter(), time.process_time()
        answer = stage()
        succeeded, detail = describe(answer)
        milliseconds = 1e3 * (time.perf_counter() - began)
        computed = 1e3 * (time.process_time() - computed)
        outcome = "succeeded" if succeeded else "failed"
        self.reports.append(StageReport(name, outcome, milliseconds, detail, computed))
        return answer
