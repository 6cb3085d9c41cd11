"""Proposals of many kinds before the gate, and a judge of what it accepts: pinocchio and coal."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.polynomial.polynomial import polyder, polyval

from kinematics.arrays import Array
from kinematics.trajectory.trajectory import Trajectory
from obstacles.collision.checker import Checker
from planning.guard.gate import Verdict
from planning.guard.proposals import (
    Proposal,
    SamplesProposal,
    TrajectoryProposal,
    VelocityProposal,
)
from planning.stops.braking import BrakingLimits
from planning.stops.certificate import Surroundings, certify_stops
from planning.stops.stop_family import state_at
from planning.timing.jerk.state_to_state import JointState
from planning.values.preferences import StopKinds
from tests.planning.stops.judge import Brakes, CoalArm
from tests.planning.stops.motions import Moved, motions, rest_to_rest

#: Limits are exceeded by no more than this share of theirs.
_SLACK = 1e-6


class Case(NamedTuple):
    """A proposal.

    Args:
        kind: "clean", "noise", "wander" or "aimed".
        around: Robot, scene and limits of it.
        state: State that it begins in.
        proposal: The motion.
    """

    kind: str
    around: Surroundings
    state: JointState
    proposal: Proposal


def cases(name: str, count: int, *, jerk: bool = True, seed: int = 0) -> Iterator[Case]:
    """Proposals for an arm, of all kinds in turn, four for each motion through a scene."""
    random = np.random.default_rng([seed, *name.encode()])
    made = 0
    while made < count:
        for moved in motions(name, -(-count // 4), 4.0, jerk=jerk, first=10_000 * seed):
            for case in _of_motion(moved, random):
                yield case
                made += 1
                if made == count:
                    return


def _of_motion(moved: Moved, random: np.random.Generator) -> Iterator[Case]:
    motion, around = moved.trajectory, moved.around
    n = motion.n
    if certify_stops(motion, moved.certificate, around, "both").proved:
        begin, end = np.sort(random.uniform(0.0, motion.duration, 2))
        end = max(end, min(begin + 0.05, motion.duration))
        piece = motion if begin == 0.0 else motion.split(begin)[1]
        piece = piece if end >= motion.duration else piece.split(end - begin)[0]
        yield Case("clean", around, JointState(*state_at(motion, begin)), TrajectoryProposal(piece))
    begin = random.uniform(0.0, 0.8 * motion.duration)
    times = np.linspace(begin, motion.duration, 9)[1:]
    noisy = motion.sample(times) + random.normal(0.0, 10.0 ** random.uniform(-5.0, -2.0), (8, n))
    period = (times[0] - begin) * random.choice([0.5, 1.0, 1.5])
    state = JointState(*state_at(motion, begin))
    yield Case("noise", around, state, SamplesProposal(noisy, period, "natural_spline"))
    rates = random.normal(0.0, 1.0, n)
    still = JointState(state_at(motion, begin)[0])
    yield Case("wander", around, still, VelocityProposal(rates, random.uniform(0.05, 0.8)))
    yield Case("aimed", around, still, _aimed(still.position, around, random))


def _aimed(q: Array, around: Surroundings, random: np.random.Generator) -> Proposal:
    """A motion to a configuration that the arm can't be in."""
    chain = around.robot.chain
    low, high = chain.sampling_bounds()
    goals = random.uniform(low, high, (50, chain.n))
    hit = goals[~Checker.of(around.robot, around.scene).each_valid(goals)]
    goals = hit if len(hit) else goals
    goal = goals[np.abs(goals - q).max(axis=1).argmin()]
    brake = float(around.limits.bounds["acceleration"][0]) * random.uniform(0.3, 1.5)
    return TrajectoryProposal(rest_to_rest(chain.joint_names, q, goal, brake))


def faults(
    verdict: Verdict, case: Case, judge: CoalArm, kind: StopKinds, instants: int, stops: int
) -> list[str]:
    """Faults of an accepted motion when it is run, and stopped at many instants."""
    if verdict.trajectory is None:
        return []
    parts = (verdict.trajectory, verdict.stop.trajectory)
    found = [fault for part in parts for fault in limit_faults(part, case.around, instants)]
    # The stop begins where the motion ends.
    joined = state_at(parts[1], 0.0)[:2] - state_at(parts[0])[:2]
    if np.abs(joined).max() > 1e-8:
        found.append(f"the stop begins {joined} off")
    if np.abs(parts[1].sample([parts[1].duration], 1)).max() > 1e-8:
        found.append("the stop does not end at rest")
    if np.abs(state_at(parts[0], 0.0)[:2] - case.state.rows[:2]).max() > 1e-5:
        found.append("the motion does not begin in the state")
    found += [
        "the motion overlaps"
        for part in parts
        if judge.overlaps(positions(part, 0, instants)).any()
    ]
    if kind == "path":
        return found
    limits = case.around.robot.chain.limits
    brakes = Brakes(BrakingLimits.of(limits, parts[0].joint_names, case.around.limits))
    ways, _ = brakes.stops(parts[0], np.linspace(0.0, parts[0].duration, stops), 24)
    rows = ways.reshape(-1, parts[0].n)
    if judge.overlaps(rows).any():
        found.append("a stop overlaps")
    if (rows < limits.lower - _SLACK).any() or (rows > limits.upper + _SLACK).any():
        found.append("a stop leaves a range")
    return found


def limit_faults(
    motion: Trajectory, around: Surroundings, instants: int, *, jerk: bool = True
) -> Iterator[str]:
    """Limits that a motion exceeds at even instants, jerk among them or not."""
    limits, bounds = around.robot.chain.limits, around.limits.bounds
    q = positions(motion, 0, instants)
    if (q < limits.lower - _SLACK).any() or (q > limits.upper + _SLACK).any():
        yield "a range is left"
    names = ("velocity", "acceleration", "jerk") if jerk else ("velocity", "acceleration")
    for order, name in enumerate(names, start=1):
        most = np.asarray(bounds[name]) * (1.0 + _SLACK) + _SLACK
        if (np.abs(positions(motion, order, instants)) > most).any():
            yield f"{name} is exceeded"


def positions(motion: Trajectory, order: int, instants: int) -> Array:
    """Values of a derivative at even instants (instants, n), by numpy's own polynomials."""
    times = np.linspace(0.0, motion.duration, instants)
    at = np.searchsorted(motion.breaks[1:-1], times, side="right")
    rows = np.empty((instants, motion.n))
    for i in np.unique(at):
        chosen = at == i
        c = polyder(motion.coefficients[i].T, order)
        rows[chosen] = polyval(times[chosen] - motion.breaks[i], c).T
    return rows
