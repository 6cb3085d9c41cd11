"""Account of a motion's timing for answers: method, limits, and what a rule has made."""

from collections.abc import Mapping
from dataclasses import dataclass

from kinematics.arrays import Array
from planning.timing.options import Method, Solver
from planning.timing.parametrization import TimeParametrization


@dataclass(frozen=True, slots=True, eq=False)
class TimingReport:
    """Method and limits that a motion was timed by.

    Args:
        method: The method.
        solver: Who found the speeds; None where there is no choice.
        limits: Limits that the motion is held to, scaled, by quantity ("velocity",
            "acceleration", "jerk"), each shape (n,).
        ruled_jerk: Names of the joints whose jerk limit follows ``choice.JERK_RULE``.
    """

    method: Method
    solver: Solver | None
    limits: Mapping[str, Array]
    ruled_jerk: tuple[str, ...] = ()


def timing_report(parametrization: TimeParametrization, solver: Solver | None) -> TimingReport:
    """The account of a motion's timing.

    Args:
        parametrization: Method and limits.
        solver: Name of the solver as the motion tells it; None for the usual one of the method.
    """
    method = parametrization.method
    if solver is None and method.solver is not None:
        solver = "interior_point" if method.even_corners else method.solver
    return TimingReport(method.name, solver, parametrization.bounds, parametrization.ruled)
