"""Configurations that reach a goal's pose, with the verdict on each."""

from collections.abc import Mapping, Sequence
from enum import StrEnum
from typing import Any, NamedTuple


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
