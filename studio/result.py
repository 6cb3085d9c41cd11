"""Results of planning: a motion with its certificate in words, a failure explained, branches."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any, NamedTuple, TypeAlias

from armwright_client import Certificate, Plan, TaskPlan, Tour
from armwright_wire.plans.job import Problem
from service.viewer.words import against, certificate_sentences, problem_sentences
from studio.state import StudioState

#: Two bodies in a sentence: 'hand' and 'table' overlap.
_PAIR = re.compile(r"'([^']+)' and '([^']+)'")


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
class Planned:
    """A certified motion.

    Args:
        state: State that it was planned for.
        plan: The answer of the service.
    """

    state: StudioState
    plan: Plan

    @property
    def plan_id(self) -> str | None:
        """Id of the kept plan."""
        return self.plan.plan_id

    @property
    def title(self) -> str:
        """Planner and duration."""
        return f"Planned by {self.plan.planner}: {self.plan.trajectory.duration:.3f} s."

    @property
    def sentences(self) -> list[str]:
        """The certificate and the notes, in words."""
        certificate = certificate_sentences(_present(self.plan.certificate.model_dump(mode="json")))
        return [*certificate, *(f"Note: {note}" for note in self.plan.notes)]


@dataclass(frozen=True, slots=True)
class TaskPlanned:
    """Certified motions of all stages of a task.

    Args:
        state: State that they were planned for.
        plan: The answer of the service.
    """

    state: StudioState
    plan: TaskPlan

    @property
    def plan_id(self) -> str | None:
        """Id of the kept task."""
        return self.plan.plan_id

    @property
    def title(self) -> str:
        """Number of stages and duration."""
        return f"{len(self.plan.stages)} stages planned: {self.plan.duration:.3f} s."

    @property
    def sentences(self) -> list[str]:
        """Each stage with its duration, what is held in it, and whether it is proved."""
        return [self._sentence(number) for number in range(len(self.plan.stages))]

    def _sentence(self, number: int) -> str:
        stage = self.plan.stages[number]
        name = stage.kind if stage.name is None else f"{stage.name} ({stage.kind})"
        chosen = "" if stage.choice is None else f", choice {stage.choice}"
        held = ", ".join(item.id for item in stage.after.attached)
        proof = _proof(stage.certificate)
        holds = f", holds {held}" if held else ""
        return f"{stage.index}: {name}{chosen}: {stage.trajectory.duration:.2f} s, {proof}{holds}"


@dataclass(frozen=True, slots=True)
class TourPlanned:
    """Certified motions from goal to goal of a tour.

    Args:
        state: State that they were planned for.
        plan: The answer of the service.
    """

    state: StudioState
    plan: Tour

    @property
    def plan_id(self) -> str | None:
        """Id of the kept tour."""
        return self.plan.plan_id

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
        for number, leg in enumerate(plan.legs):
            proof = _proof(leg.certificate)
            ends = f"{leg.origin or 'start'} to {leg.target or 'end'}"
            lines.append(f"{number}: {ends}: {leg.trajectory.duration:.2f} s, {proof}")
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
        problem.hint or "",
        problem_sentences(problem.model_dump(mode="json")),
        None if pair is None else (str(pair[0]), str(pair[1])),
        candidates,
        None if nearest is None else tuple(nearest),
        details.get("plan_id"),
        _shown(state, problem, candidates, nearest),
    )


def _proof(certificate: Certificate) -> str:
    proof = "proved" if certificate.verified else "not proved"
    return f"{proof} {against(certificate.model_dump(mode='json'))}"


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
