"""Results of planning: a motion with its certificate in words, a failure explained, branches.

State of the studio: the parts of a request, the changes that undo takes back, the session.
"""

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from enum import StrEnum
from pathlib import Path
from types import MappingProxyType
from typing import Any, Generic, NamedTuple, TypeAlias, TypeVar

from platformdirs import user_data_path
from pydantic import BaseModel, ValidationError

from armwright_client import (
    Certificate,
    FramedPose,
    Obstacle,
    Plan,
    Pose,
    TaskPlan,
    TaskStageReport,
    Tour,
)
from armwright_wire.plans.job import Problem
from service.viewer.words import (
    against,
    certificate_sentences,
    problem_sentences,
    stage_label,
)

#: Entries in order; each has a field that names its kind.
Entries: TypeAlias = tuple[Mapping[str, Any], ...]
#: Changes that can be taken back.
_MAX_CHANGES = 200


def moved(entries: Entries, number: int, steps: int) -> Entries:
    """The entries with one of them moved, as far as there is room.

    Args:
        entries: Entries in order.
        number: Number of the entry, from 0.
        steps: Towards the end, negative towards the beginning.
    """
    rest = [*entries[:number], *entries[number + 1 :]]
    place = min(max(number + steps, 0), len(rest))
    return (*rest[:place], entries[number], *rest[place:])


def without(entries: Entries, number: int) -> Entries:
    """The entries without one of them.

    Args:
        entries: Entries in order.
        number: Number of the entry, from 0.
    """
    return (*entries[:number], *entries[number + 1 :])


def with_field(entries: Entries, number: int, name: str, value: Any) -> Entries:
    """The entries with a field of one of them changed.

    Args:
        entries: Entries in order.
        number: Number of the entry, from 0.
        name: Name of the field.
        value: New value; None leaves the field to the service.
    """
    entry = dict(with_option(entries[number], name, value))
    return (*entries[:number], entry, *entries[number + 1 :])


@dataclass(frozen=True, slots=True)
class StudioState:
    """Robot, start, goal, scene and settings.

    Args:
        robot: Name of the robot.
        start: Start configuration [rad or m].
        goal_joints: Goal configuration; drawn also while the goal is a pose [rad or m].
        goal_pose: Pose of the tip as the goal, in the root frame; None where `goal_joints` is the
            goal.
        obstacles: Obstacles of the scene.
        attached: Link that carries an obstacle, by the obstacle's id.
        tool: Name of the stored tool that is mounted; None for the robot's own tip.
        fingers: Positions of the gripper's joints at the start, and during a plan [rad or m].
        settings: Values of further fields of a plan request, by their path: "timing.method".
        constraints: Constraints of a plan, each by its fields as the API has them.
        stages: Stages of a task, each by its fields as the API has them.
        goals: Goals of a tour, likewise.
        waypoints: Waypoints of a tool path, likewise.
        tour_options: Options of the tour, by name.
        path_options: Options of the tool path, by name.
    """

    robot: str
    start: tuple[float, ...]
    goal_joints: tuple[float, ...]
    goal_pose: Pose | None = None
    obstacles: tuple[Obstacle, ...] = ()
    attached: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))
    tool: str | None = None
    fingers: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))
    settings: Mapping[str, Any] = field(default_factory=lambda: MappingProxyType({}))
    constraints: Entries = ()
    stages: Entries = ()
    goals: Entries = ()
    waypoints: Entries = ()
    tour_options: Mapping[str, Any] = field(default_factory=lambda: MappingProxyType({}))
    path_options: Mapping[str, Any] = field(default_factory=lambda: MappingProxyType({}))

    def with_setting(self, path: str, value: Any) -> "StudioState":
        """The state with a setting changed; None leaves the field to the service."""
        return replace(self, settings=with_option(self.settings, path, value))

    def with_obstacle(self, obstacle: Obstacle) -> "StudioState":
        """The state with an obstacle added, or put in place of the one of its id."""
        ids = [item.id for item in self.obstacles]
        if obstacle.id not in ids:
            return replace(self, obstacles=(*self.obstacles, obstacle))
        changed = tuple(obstacle if item.id == obstacle.id else item for item in self.obstacles)
        return replace(self, obstacles=changed)

    def without_obstacle(self, obstacle_id: str) -> "StudioState":
        """The state without an obstacle, which nothing carries any more."""
        rest = tuple(item for item in self.obstacles if item.id != obstacle_id)
        return replace(self, obstacles=rest).with_attached(obstacle_id, None)

    def with_attached(self, obstacle_id: str, link: str | None) -> "StudioState":
        """The state with an obstacle carried by a link, or by nothing."""
        return replace(self, attached=with_option(self.attached, obstacle_id, link))

    def free_id(self, kind: str) -> str:
        """An id that no obstacle has: "box_1"."""
        ids = {item.id for item in self.obstacles}
        number = 1
        while f"{kind}_{number}" in ids:
            number += 1
        return f"{kind}_{number}"


def with_option(options: Mapping[str, Any], name: str, value: Any) -> Mapping[str, Any]:
    """Options with one of them changed.

    Args:
        options: Options by name.
        name: Name of the option.
        value: New value; None leaves the option to the service.
    """
    rest = {key: item for key, item in options.items() if key != name}
    return MappingProxyType(rest if value is None else rest | {name: value})


@dataclass(frozen=True, slots=True)
class History:
    """The present state, those before it and those that undo took back.

    Args:
        present: The state shown.
        past: Earlier states, the latest last.
        future: States taken back, the next one to come again last.
        last_key: Subject of the latest change; a change of the same subject replaces it, so that
            one drag is one change.
    """

    present: StudioState
    past: tuple[StudioState, ...] = ()
    future: tuple[StudioState, ...] = ()
    last_key: str | None = None

    def change(self, state: StudioState, key: str | None = None) -> "History":
        """The history with a new present state.

        Args:
            state: The new state.
            key: Subject of the change, None for a change that stands alone.
        """
        if state == self.present:
            return self
        if key is not None and key == self.last_key:
            return replace(self, present=state, future=())
        past = (*self.past, self.present)[-_MAX_CHANGES:]
        return History(state, past, (), key)

    def close_change(self) -> "History":
        """The history whose next change stands alone, whatever it is about."""
        return replace(self, last_key=None)

    def undo(self) -> "History":
        """The history one change back; itself where there is none."""
        if not self.past:
            return self
        return History(self.past[-1], self.past[:-1], (*self.future, self.present))

    def redo(self) -> "History":
        """The history with the change that was taken back last; itself where there is none."""
        if not self.future:
            return self
        return History(self.future[-1], (*self.past, self.present), self.future[:-1])


def session_file() -> Path:
    """The file of the session."""
    return user_data_path("armwright", appauthor=False) / "studio.json"


def save_session(file: Path, state: StudioState) -> None:
    """Write a state; another process sees all of the file or nothing.

    Args:
        file: File of the session.
        state: State of the studio.

    Raises:
        OSError: The file can't be written.
    """
    file.parent.mkdir(parents=True, exist_ok=True)
    new = file.with_suffix(".new")
    new.write_text(
        json.dumps({item.name: _plain(getattr(state, item.name)) for item in fields(state)})
    )
    new.replace(file)


def load_session(file: Path) -> StudioState | None:
    """The state that was saved last; None where there is none that can be read.

    Args:
        file: File of the session.
    """
    try:
        kept = json.loads(file.read_text())
        kept["obstacles"] = tuple(Obstacle.model_validate(item) for item in kept["obstacles"])
        if kept["goal_pose"] is not None:
            kept["goal_pose"] = FramedPose.model_validate(kept["goal_pose"])
        values = {name: _frozen(value) for name, value in kept.items()}
        return StudioState(**values)
    except (OSError, ValueError, KeyError, TypeError, ValidationError):
        return None


def _plain(value: Any) -> Any:
    if isinstance(value, BaseModel):
        return value.model_dump(mode="json", exclude_none=True)
    if isinstance(value, Mapping):
        return {name: _plain(item) for name, item in value.items()}
    return [_plain(item) for item in value] if isinstance(value, tuple) else value


def _frozen(value: Any) -> Any:
    if isinstance(value, dict):
        return MappingProxyType(value)
    return tuple(value) if isinstance(value, list) else value


#: Hashes in sentences: the page of the plan has them.
_HASH = re.compile(r" \(hash \w+\)")
A = TypeVar("A", Plan, TaskPlan, Tour)
#: Two bodies in a sentence: 'hand' and 'table' overlap.
_PAIR = re.compile(r"'([^']+)' and '([^']+)'")


#: Words of the API in a hint, which say nothing to whoever sees the form.
_OF_API = re.compile(r"`|/v1/|details|\w_\w")
#: Hints in words of the form, by the code of the problem.
_HINTS = {
    "START_STATE_IN_COLLISION": "Move the start (tab Robot), or what is marked (tab Scene).",
    "GOAL_IN_COLLISION": "Move the goal or what is marked, or lower the margin (Settings).",
    "START_STATE_INVALID": "Bring the joint that is named inside its limits (tab Robot).",
    "GOAL_STATE_INVALID": "Bring the joint that is named inside its limits (tab Goal).",
    "NO_IK_SOLUTION": "Move or turn the goal: tab Goal says why each branch is rejected.",
    "PLANNING_FAILED": "Move what is in the way, or change planner, margin or timeout (Settings).",
    "TIMED_OUT": "Raise the timeout (Settings), or make it easier: fewer stages, more space.",
    "INVALID_LINK_NAME": "Name a link of the robot, as the obstacles' field 'Carried by' has them.",
    "INVALID_OBJECT_NAME": "Name an obstacle as the tab Scene lists it.",
    "MISSING_LIMIT": "Add the limit to the URDF, and upload it again (tab Robot).",
    "VALIDATION_ERROR": "Correct the field that is named.",
    "INVALID_ROBOT_DESCRIPTION": "Correct the file, or name the tip link of an arm (tab Robot).",
}


class Verdict(StrEnum):
    """Verdict on a configuration."""

    VALID = "valid"
    COLLISION = "collision"
    LIMITS = "limits"
    OTHER = "rejected"


#: Sign of each verdict in labels, so that no colour is needed to tell them apart.
SIGNS = {
    Verdict.VALID: "✓",
    Verdict.COLLISION: "✗ collides",
    Verdict.LIMITS: "✗ outside limits",
    Verdict.OTHER: "✗ rejected",
}


class Branch(NamedTuple):
    """One configuration that reaches the pose.

    Args:
        number: Counted from 0, best first.
        joints: [rad or m].
        verdict: Verdict on it.
        reason: Why it was rejected, in words; empty where it is valid.
        name: Name of the closed form's branch; empty where the solver is numeric.
    """

    number: int
    joints: tuple[float, ...]
    verdict: Verdict
    reason: str = ""
    name: str = ""

    @property
    def label(self) -> str:
        """Number and verdict, short."""
        return f"{self.number} {SIGNS[self.verdict]}"


def labels(group: Sequence[Branch]) -> str:
    """Numbers of branches by their verdict: "0, 2 ✓; 1 ✗ collides".

    Args:
        group: Branches that one label stands for.
    """
    signs: dict[str, list[str]] = {}
    for branch in group:
        signs.setdefault(SIGNS[branch.verdict], []).append(str(branch.number))
    return "; ".join(f"{', '.join(numbers)} {sign}" for sign, numbers in signs.items())


def branches(solutions: Sequence[Mapping[str, Any]]) -> tuple[Branch, ...]:
    """The branches of an answer, valid or not.

    Args:
        solutions: Solutions as the API answers them, or as a problem lists the rejected ones.
    """
    return tuple(
        Branch(
            number,
            tuple(solution["joints"]),
            _verdict(solution.get("rejected_because")),
            solution.get("rejected_because") or "",
            solution.get("branch") or "",
        )
        for number, solution in enumerate(solutions)
    )


def _verdict(reason: str | None) -> Verdict:
    if reason is None:
        return Verdict.VALID
    if "outside" in reason:
        return Verdict.LIMITS
    # Reasons name colliding bodies between quotes: 'hand' and 'table' overlap.
    return Verdict.COLLISION if "' and '" in reason else Verdict.OTHER


@dataclass(frozen=True, slots=True)
class _Kept(Generic[A]):
    """Certified motions.

    Args:
        state: State that they were planned for.
        plan: The answer of the service.
    """

    state: StudioState
    plan: A

    @property
    def plan_id(self) -> str | None:
        """Id of the kept plan, task or tour."""
        return self.plan.plan_id


class Planned(_Kept[Plan]):
    """A certified motion."""

    __slots__ = ()

    @property
    def title(self) -> str:
        """Planner and duration."""
        return f"Planned by {self.plan.planner}: {self.plan.trajectory.duration:.3f} s."

    @property
    def sentences(self) -> list[str]:
        """The certificate and the notes, in words."""
        certificate = certificate_sentences(_present(self.plan.certificate.model_dump(mode="json")))
        return [*certificate, *(f"Note: {note}" for note in self.plan.notes)]


class TaskPlanned(_Kept[TaskPlan]):
    """Certified motions of all stages of a task."""

    __slots__ = ()

    @property
    def title(self) -> str:
        """Number of stages and duration."""
        return f"{len(self.plan.stages)} stages planned: {self.plan.duration:.3f} s."

    @property
    def sentences(self) -> list[str]:
        """What is proved of which stages, and each with its duration and what is held in it."""
        stages = self.plan.stages
        proved = _proofs({str(stage.index): stage.certificate for stage in stages}, "stage")
        return [*proved, *map(self._sentence, stages)]

    def _sentence(self, stage: TaskStageReport) -> str:
        name = stage_label(stage.model_dump(include={"index", "name", "kind"}))
        chosen = "" if stage.choice is None else f", choice {stage.choice}"
        held = ", ".join(item.id for item in stage.after.attached)
        holds = f", holds {held}" if held else ""
        return f"{name}{chosen}: {stage.trajectory.duration:.2f} s{holds}"


class TourPlanned(_Kept[Tour]):
    """Certified motions from goal to goal of a tour."""

    __slots__ = ()

    @property
    def title(self) -> str:
        """Number of goals and duration."""
        return f"Tour of {len(self.plan.order)} goals: {self.plan.time:.3f} s."

    @property
    def sentences(self) -> list[str]:
        """The order, each leg with its duration and whether it is proved, and what is left out."""
        plan = self.plan
        gap = "" if plan.gap is None else f"; at most {100.0 * plan.gap:.1f} % longer than needed"
        lines = [f"Order: {', '.join(plan.order)}{gap}"]
        lines += _proofs({str(i): leg.certificate for i, leg in enumerate(plan.legs)}, "leg")
        for number, leg in enumerate(plan.legs):
            ends = f"{leg.origin or 'start'} to {leg.target or 'end'}"
            lines.append(f"{number}: {ends}: {leg.trajectory.duration:.2f} s")
        return [*lines, *(f"Left out: {one.id}, {one.message}" for one in plan.unvisited)]


@dataclass(frozen=True, slots=True)
class Failure:
    """A plan that there is not, and why.

    Args:
        state: State that was planned for.
        title: Kind of the problem in words.
        detail: Description of the fault and its place.
        hint: Remedy; empty where none is known.
        sentences: The whole problem in words.
        pair: The two bodies that collide, if the problem names them.
        candidates: Configurations that reach the goal and why they were rejected.
        nearest: The nearest configuration to an unreachable goal [rad or m].
        plan_id: Id of the kept request.
        shown: The configuration that the failure is about: the pair is drawn there [rad or m].
    """

    state: StudioState
    title: str
    detail: str
    hint: str = ""
    sentences: list[str] = field(default_factory=list)
    pair: tuple[str, str] | None = None
    candidates: tuple[Branch, ...] = ()
    nearest: tuple[float, ...] | None = None
    plan_id: str | None = None
    shown: tuple[float, ...] | None = None


Outcome: TypeAlias = Planned | TaskPlanned | TourPlanned | Failure


def failure(state: StudioState, problem: Problem) -> Failure:
    """The failure that a problem document tells.

    Args:
        state: State that was planned for.
        problem: Problem of the service.
    """
    details = problem.details
    nearest = details.get("nearest_joints")
    candidates = branches(details.get("rejected") or [])
    reasons = " ".join([problem.detail, *(branch.reason for branch in candidates)])
    named = _PAIR.search(reasons)
    pair = details.get("pair") or (None if named is None else named.groups())
    return Failure(
        state,
        problem.title,
        problem.detail,
        form_hint(problem),
        problem_sentences(problem.model_dump(mode="json")),
        None if pair is None else (str(pair[0]), str(pair[1])),
        candidates,
        None if nearest is None else tuple(nearest),
        details.get("plan_id"),
        _shown(state, problem, candidates, nearest),
    )


def form_hint(problem: Problem) -> str:
    """The hint of a problem in words of the form; empty where it is about the API alone.

    Args:
        problem: Problem of the service.
    """
    hint = problem.hint or ""
    return _HINTS.get(problem.code, "") if _OF_API.search(hint) else hint


def _proofs(certificates: Mapping[str, Certificate], word: str) -> list[str]:
    """What is proved of which parts of a plan, once for all of which the same is.

    Args:
        certificates: Certificate of each part, by its number.
        word: A part in a word: "stage".
    """
    found: dict[str, list[str]] = {}
    for number, certificate in certificates.items():
        proof = "proved" if certificate.verified else "NOT proved"
        premises = _HASH.sub("", against(certificate.model_dump(mode="json")))
        found.setdefault(f"{proof} {premises}", []).append(number)
    if len(found) == 1:
        return [f"Every {word} is {text}." for text in found]
    return [f"Of {word}s {', '.join(numbers)}: {text}." for text, numbers in found.items()]


def _shown(
    state: StudioState,
    problem: Problem,
    candidates: tuple[Branch, ...],
    nearest: Sequence[float] | None,
) -> tuple[float, ...] | None:
    """The configuration that a problem is about, where it is known."""
    if nearest is not None:
        return tuple(nearest)
    if problem.stage == "start":
        return state.start
    colliding = [branch.joints for branch in candidates if _PAIR.search(branch.reason)]
    if colliding:
        return colliding[0]
    # Of a pose as the goal, the configuration that reached it last.
    return state.goal_joints if problem.stage == "goal" else None


def compare(first: Planned, second: Planned) -> str:
    """Two plans side by side, as a table in Markdown.

    Args:
        first: The plan that was pinned.
        second: The plan after it.
    """
    rows = [
        ("planner", *(item.plan.planner for item in (first, second))),
        ("duration", *(f"{item.plan.trajectory.duration:.3f} s" for item in (first, second))),
        ("length in joint space", *(f"{item.plan.path.length:.3f}" for item in (first, second))),
        ("clearance proved", *(_clearance(item) for item in (first, second))),
        ("time of planning", *(_time(item) for item in (first, second))),
    ]
    lines = ["| | pinned | present |", "|---|---|---|"]
    return "\n".join([*lines, *(f"| {a} | {b} | {c} |" for a, b, c in rows)])


def _clearance(item: Planned) -> str:
    clearance = item.plan.certificate.min_clearance
    return "nothing to hit" if clearance is None else f"{1000.0 * clearance:.1f} mm"


def _time(item: Planned) -> str:
    return f"{sum(stage.milliseconds for stage in item.plan.stages):.0f} ms"


def _present(document: dict[str, Any]) -> dict[str, Any]:
    """The document without limits that were not looked at."""
    uses = {name: use for name, use in (document["limits"] or {}).items() if use is not None}
    return document | {"limits": uses}
