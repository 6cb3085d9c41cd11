"""Costs of the configurations that targets of a task are reached in, as those of a plan's goals.

All are told as seconds of motion, so that they add up with the least times that the search is led
by. A configuration of a pose at a joint limit makes the motions beside it count as a fifth longer:
it is taken where every other one would make them longer than that.
"""

import numpy as np

from kinematics.arrays import Array
from kinematics.model.chain import Chain
from obstacles.collision.checker import Checker
from planning.goal_choice.goal_order import (
    FAR_FROM_OBSTACLES,
    clearance_lacks,
    is_at_limit,
    limit_nearness,
    manipulability_lacks,
    turn_counts,
)
from planning.sequence.node import Child, Node, OwnCosts
from planning.sequence.target import Candidates
from planning.sequence.world import Cell
from planning.values.goal_costs import GoalCosts, time_weight


class ConfigurationCosts:
    """Costs of the configurations of a search.

    Args:
        weights: Of the costs.
    """

    def __init__(self, weights: GoalCosts) -> None:
        self.weights = weights
        self._scale = 1.0 / time_weight(weights)
        self._known: dict[int, tuple[Candidates, OwnCosts]] = {}
        self._clearances: dict[tuple[int, bytes], float] = {}

    def of(self, chain: Chain, candidates: Candidates, start: Array) -> OwnCosts | None:
        """Costs that need no look at the surroundings; None where no target is a pose.

        Args:
            chain: The robot with what it holds.
            candidates: Valid configurations of a stage's targets.
            start: Where the motion to them begins, shape (n,).
        """
        if all(target.T is None for target in candidates.targets):
            return None
        known = self._known.get(id(candidates))
        if known is None:
            known = self._known[id(candidates)] = candidates, self._own(chain, candidates)
        own, weights = known[1], self.weights
        turns = weights.turns * turn_counts(chain, start, candidates.joints)
        return OwnCosts(own.seconds + self._scale * turns, own.at_limit)

    def _own(self, chain: Chain, candidates: Candidates) -> OwnCosts:
        joints, weights = candidates.joints, self.weights
        seconds = self._scale * (
            weights.joint_limits * limit_nearness(chain, joints)
            + weights.manipulability * manipulability_lacks(chain, joints)
        )
        posed = np.array([target.T is not None for target in candidates.targets])
        return OwnCosts(seconds, posed & is_at_limit(chain, joints))

    def of_clearance(self, cell: Cell, child: Child) -> float:
        """Cost of the clearance of a configuration in its surroundings."""
        if child.target.T is None or not self.weights.clearance:
            return 0.0
        clearance = self.clearance(cell.checker, child.joints)
        lack = clearance_lacks(np.array([clearance]))[0]
        return float(self._scale * self.weights.clearance * lack)

    def clearance(self, checker: Checker, q: Array) -> float:
        """Clearance of a configuration (n,), 5 cm where it is that or more [m]."""
        key = id(checker), q.tobytes()
        if key not in self._clearances:
            spacious = Checker(checker.model, FAR_FROM_OBSTACLES).valid(q)
            least = FAR_FROM_OBSTACLES if spacious else checker.clearance(q)[0]
            self._clearances[key] = float(least)
        return self._clearances[key]


def rests_at_limit(chain: Chain, node: Node) -> bool:
    """Whether the arm rests at a joint limit where the choice of a node has it rest.

    What is asked for as joints is no choice.
    """
    if node.target is None or node.target.T is None:
        return False
    moves = [step.end for step in (*node.steps, *node.onward) if step.motion != "none"]
    return bool(is_at_limit(chain, np.array([node.joints, *moves])).any())
