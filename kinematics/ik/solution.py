"""Results of inverse kinematics, of every method."""

from typing import NamedTuple

from kinematics.arrays import Array


class IkSolution(NamedTuple):
    """One configuration and how far it is from the pose asked for.

    Args:
        joints: Shape (n,), read-only [rad or m].
        position_error: Distance of the link's origin from its target [m].
        orientation_error: Angle of the rotation that is left [rad].
        iterations: Steps spent on it over all restarts.
        branch: Branch of the closed form; None from iteration.
        within_limits: Whether every joint is inside its limits.
    """

    joints: Array
    position_error: float
    orientation_error: float
    iterations: int
    branch: str | None = None
    within_limits: bool = True


class IkResult(NamedTuple):
    """The solutions found, best first, or how near the best attempt came.

    Args:
        solutions: Inside the tolerances; empty where none was found.
        nearest: The attempt with the least error, whether it solves the problem or not.
        starts: Start configurations tried.
        advice: Meaning and remedy where nothing was found.
        out_of_reach: Distance by which the wrist centre is too far away or too near [m]; None where
            that is not known.
        complete: Whether every branch inside the limits was found, none of which can move within
            the pose. A search and the closed form of a redundant arm never know.
        found: Solutions before the cut to as many as are asked for.
    """

    solutions: tuple[IkSolution, ...]
    nearest: IkSolution
    starts: int
    advice: str = ""
    out_of_reach: float | None = None
    complete: bool = False
    found: int = 0
