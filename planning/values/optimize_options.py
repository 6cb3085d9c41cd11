"""Options of an optimisation."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, Literal, get_args

import numpy as np

from kinematics.errors import InvalidOption

#: The name of the planner, and of the stage.
OPTIMIZE = "optimize"
Objective = Literal["time", "jerk", "energy", "path_length"]
OBJECTIVES: tuple[Objective, ...] = ("time", "jerk", "energy", "path_length")
Solver = Literal["piqp", "ipopt"]
SOLVERS: tuple[Solver, ...] = get_args(Solver)

#: Degrees of the splines, least and largest.
DEGREES = (3, 7)
#: Control points of a joint, least and largest.
CONTROL_POINTS = (8, 64)
MAX_ROUNDS = 100

_TIME: Mapping[Objective, float] = MappingProxyType({"time": 1.0})


@dataclass(frozen=True, slots=True, eq=False)
class RefineOptions:
    """Options of the optimisation.

    Args:
        weights: Weights of what is to become small: "time" T [s], "jerk" the integral of the
            squared jerks of all joints, "energy" that of the squared torques, "path_length" the
            Euclidean length in joint space. The weighted sum of those named is minimised.
        duration: The longest the motion may take [s]; None for as long as the motion it starts
            from.
        degree: Degree of the spline; None for 5 where the jerk is made small, else 3.
        control_points: Control points of each joint; None for 16.
        rounds: Convex problems solved, at most.
        solver: Solver of each round: "piqp", with the limits' powers of T linearised on their safe
            side, or "ipopt", with the powers themselves.

    Raises:
        InvalidOption: A value is out of range.
    """

    weights: Mapping[Objective, float] = field(default_factory=lambda: _TIME)
    duration: float | None = None
    degree: int | None = None
    control_points: int | None = None
    rounds: int = 12
    solver: Solver = "piqp"

    def __post_init__(self) -> None:
        object.__setattr__(self, "weights", _checked_weights(self.weights))
        if self.duration is not None and not 0.0 < float(self.duration) < np.inf:
            raise InvalidOption("refine.duration must be a positive number of seconds")
        _check_range("degree", self.degree, *DEGREES)
        _check_range("control_points", self.control_points, *CONTROL_POINTS)
        _check_range("rounds", self.rounds, 1, MAX_ROUNDS)
        if self.solver not in SOLVERS:
            raise InvalidOption(
                f"there is no solver {self.solver!r}", hint=f"Choose among: {', '.join(SOLVERS)}."
            )

    @property
    def least_degree(self) -> int:
        """The degree of the spline."""
        return self.degree or (5 if "jerk" in self.weights else 3)

    @property
    def fastest(self) -> bool:
        """Whether nothing but time counts."""
        return set(self.weights) == {"time"}

    @classmethod
    def of(cls, given: Mapping[str, Any]) -> "RefineOptions":
        """The options by name; ``objective`` is a name or weights by name.

        Raises:
            InvalidOption: A name is unknown or a value is out of range.
        """
        names = ("objective", "duration", "degree", "control_points", "rounds", "solver")
        unknown = sorted(set(given) - set(names))
        if unknown:
            raise InvalidOption(
                f"refinement has no option {unknown[0]!r}",
                hint=f"Choose among: {', '.join(names)}.",
            )
        chosen = dict(given)
        objective = chosen.pop("objective", "time")
        weights: Any = {objective: 1.0} if isinstance(objective, str) else objective
        return cls(weights=weights, **{k: v for k, v in chosen.items() if v is not None})


def _checked_weights(given: Any) -> Mapping[Objective, float]:
    choices = f"Choose among: {', '.join(OBJECTIVES)}."
    if not isinstance(given, Mapping):
        raise InvalidOption("an objective is a name or weights by name", hint=choices)
    for name, weight in given.items():
        if name not in OBJECTIVES:
            raise InvalidOption(f"there is no objective {name!r}", hint=choices)
        number = isinstance(weight, int | float) and not isinstance(weight, bool)
        if not (number and 0.0 <= weight < np.inf):
            raise InvalidOption(f"the weight of {name} must be a number, 0 or more")
    weights = {name: float(weight) for name, weight in given.items() if weight > 0.0}
    if not weights:
        raise InvalidOption("the objective has no positive weight", hint=choices)
    return MappingProxyType(weights)


def _check_range(name: str, value: object, least: int, most: int) -> None:
    if value is None:
        return
    if isinstance(value, bool) or not isinstance(value, int) or not least <= value <= most:
        raise InvalidOption(f"refine.{name} must be an integer from {least} to {most}")
