"""What planning answers: a certified plan, or a failure that says what to try."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

import numpy as np

from kinematics.chain import Array, frozen
from kinematics.trajectory import Trajectory
from planning.certificate import Certificate


@dataclass(frozen=True, slots=True)
class StageReport:
    """What one stage of the ladder did.

    Args:
        name: The stage.
        outcome: "succeeded", "failed", "skipped".
        milliseconds: Time it took [ms].
        detail: One sentence for a person.
    """

    name: str
    outcome: str
    milliseconds: float
    detail: str = ""


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
        return float(np.linalg.norm(np.diff(self.waypoints, axis=0), axis=1).sum())


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
    """

    planner: str
    stages: tuple[StageReport, ...]
    path: Path
    trajectory: Trajectory
    certificate: Certificate
    notes: tuple[str, ...] = ()


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
    details: Mapping[str, Any] = field(default_factory=lambda: MappingProxyType({}))
