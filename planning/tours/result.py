"""Results of planning tours: legs, visits, what was left out."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

from kinematics.arrays import Array
from kinematics.trajectory.trajectory import Trajectory, concatenate, stay
from planning.proof.certificate import Certificate
from planning.result import ChosenConfiguration
from planning.stops.certificate import StopCertificate


@dataclass(frozen=True, slots=True, eq=False)
class Leg:
    """One proved motion of a tour, from rest to rest.

    Args:
        planner: The stage of planning that found it.
        waypoints: Corners of its path, shape (k, n) [rad or m].
        trajectory: The timed motion.
        certificate: The proof.
        stops: The proof of its stops, where these are asked for.
    """

    planner: str
    waypoints: Array
    trajectory: Trajectory
    certificate: Certificate
    stops: StopCertificate | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Visit:
    """One goal of a tour that is visited.

    Args:
        index: Number of the goal.
        alternative: Number of the of its alternatives is taken.
        joints: The configuration, shape (n,) [rad or m].
        arrival: Time at which the arm gets there [s].
        departure: Time at which the arm goes on [s].
        configuration: Costs of the configuration, and the reason for it; None of a goal without a
            pose.
    """

    index: int
    alternative: int
    joints: Array
    arrival: float
    departure: float
    configuration: ChosenConfiguration | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Unvisited:
    """A goal that the tour leaves out, and why.

    Args:
        index: Number of the goal.
        id: Name of the object.
        code: MoveIt's name of the error where one exists.
        message: Message on what went wrong.
        details: Values a program can use.
    """

    index: int
    id: str
    code: str
    message: str
    details: Mapping[str, Any] = field(default_factory=lambda: MappingProxyType({}))


@dataclass(frozen=True, slots=True)
class TourImprovement:
    """A proved tour that was the best so far: its time and its configurations.

    Args:
        round: Round of search and proof that found it, 0 for the first tour.
        time: Time of the whole tour [s].
    """

    round: int
    time: float


@dataclass(frozen=True, slots=True)
class SearchReport:
    """Effort of the search.

    Args:
        configurations: Configurations of all goals together that the search chose from.
        checked: Straight motions that were checked.
        blocked: Pairs that something is in the way of.
        planned: Legs that were planned and proved.
        rounds: Rounds of search and proof.
        improvements: The proved tours that were the best so far.
        stopped: "finished", "deadline", or "rounds" where another round might have helped.
    """

    configurations: int
    checked: int
    blocked: int
    planned: int
    rounds: int
    improvements: tuple[TourImprovement, ...]
    stopped: str


@dataclass(frozen=True, slots=True, eq=False)
class Tour:
    """A tour whose every leg is proved.

    Args:
        visits: The goals in the order of their visit.
        legs: Motions in order: from the start, between goals, to the end.
        unvisited: Goals that are left out, with the reasons.
        time: Time of the whole tour, stays among them [s].
        dwell: Duration of all stays together [s].
        lower_bound: No tour over the configurations that were found takes less [s].
        search: Effort of the search.
        notes: Notes on what was done to the request.
        deterministic: Whether the same tour is found again: time ended no search.
        reaches_end: Whether the tour ends where it was asked to; not where time was up before.
    """

    visits: tuple[Visit, ...]
    legs: tuple[Leg, ...]
    unvisited: tuple[Unvisited, ...]
    time: float
    dwell: float
    lower_bound: float
    search: SearchReport
    notes: tuple[str, ...] = ()
    deterministic: bool = True
    reaches_end: bool = True

    @property
    def gap(self) -> float:
        """Share of the bound by which the tour may be too long at most [-]."""
        return self.time / self.lower_bound - 1.0 if self.lower_bound > 0.0 else 0.0

    @property
    def order(self) -> tuple[int, ...]:
        """Numbers of the goals in the order of their visit."""
        return tuple(visit.index for visit in self.visits)

    @property
    def trajectory(self) -> Trajectory:
        """The whole tour as one motion, with its stays."""
        names = self.legs[0].trajectory.joint_names
        parts: list[Trajectory] = []
        begins = len(self.visits) - len(self.legs)
        stays = [visit.departure - visit.arrival for visit in self.visits]
        if begins > 0 and stays[0] > 0.0:
            parts.append(stay(names, self.visits[0].joints, stays[0]))
        behind = stays[1:] if begins > 0 else stays
        for leg, seconds in zip(self.legs, [*behind, 0.0][: len(self.legs)], strict=True):
            parts.append(leg.trajectory)
            if seconds > 0.0:
                parts.append(stay(names, leg.trajectory.end, seconds))
        return concatenate(parts)
