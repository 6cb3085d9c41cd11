"""Costs of the configurations that a tour visits, beside the times of its legs.

A table of times holds them as seconds: half of what each end of a leg costs, so that a visit costs
all of it with the legs before and after it. A configuration of a pose at a joint limit makes its
legs count as a fifth longer: a tour takes it where every other one would make them longer still.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinematics.arrays import Array
from kinematics.model.chain import Chain
from planning.goal_choice.goal_order import (
    MAX_LONGER,
    configuration_costs,
    is_at_limit,
    turn_counts,
)
from planning.timing.rest_to_rest import Times
from planning.values.preferences import GoalCosts, time_weight


class VisitCosts(NamedTuple):
    """Costs of configurations in a tour beside the times of its legs.

    Args:
        own: Costs as seconds, shape (m,); 0 where the goal has no pose.
        at_limit: Whether each of them, of a pose, is at a joint limit, shape (m,).
        turn: Cost of each joint that turns by more than half a turn, as seconds.
        posed: Whether each of them is of a goal with a pose, shape (m,).
    """

    own: Array
    at_limit: NDArray[np.bool_]
    turn: float
    posed: NDArray[np.bool_]

    def factor(self, a: int, b: int) -> float:
        """Times by which the leg between two configurations counts as longer."""
        return float(MAX_LONGER ** (int(self.at_limit[a]) + int(self.at_limit[b])))

    def extra(self, chain: Chain, joints: Array, a: int, b: int) -> float:
        """Seconds that count beside the time of the leg between two of ``joints`` (m, n)."""
        extra = 0.5 * (self.own[a] + self.own[b])
        if self.turn and (self.posed[a] or self.posed[b]):
            extra += self.turn * turn_counts(chain, joints[a], joints[b][None])[0]
        return float(extra)

    def put_into(self, times: Times, chain: Chain, joints: Array, real: Array) -> None:
        """Add what configurations cost to a table of times, shape (m, m), in place.

        Args:
            times: Times of the legs, 0 to and from a free end.
            chain: The robot.
            joints: The configurations, shape (m, n).
            real: Whether each of them is one, shape (m,).
        """
        if not self.posed.any():
            return
        weights, half = np.where(self.at_limit, MAX_LONGER, 1.0), 0.5 * self.own
        for a in range(len(joints)):
            row = times[a] * (weights[a] * weights) + half[a] + half
            if self.turn and real[a]:
                turned = self.posed | self.posed[a]
                row += self.turn * turned * real * turn_counts(chain, joints[a], joints)
            times[a] = row


class StopConfigurations(NamedTuple):
    """Configurations of one stop of a tour.

    Args:
        joints: Shape (k, n) [rad or m].
        posed: Whether each of them is of a pose, shape (k,).
        clearances: Margins taken off, shape (k,) [m].
    """

    joints: Array
    posed: NDArray[np.bool_]
    clearances: Array


def visit_costs(chain: Chain, costs: GoalCosts, stops: Sequence[StopConfigurations]) -> VisitCosts:
    """Costs of configurations of stops, those of one stop after those of another.

    What is asked for as joints alone costs nothing.

    Args:
        chain: The robot.
        costs: The weights.
        stops: Stops in order.
    """
    scale = 1.0 / time_weight(costs)
    own, at_limit, posed = [], [], []
    for joints, of_pose, clearances in stops:
        weigh = bool(of_pose.any())
        cost = np.zeros(len(joints))
        if weigh:
            cost = scale * configuration_costs(chain, joints, costs, clearances)
        own.append(cost)
        at_limit.append(of_pose & is_at_limit(chain, joints))
        posed.append(np.full(len(joints), weigh))
    return VisitCosts(
        np.concatenate(own), np.concatenate(at_limit), scale * costs.turns, np.concatenate(posed)
    )
