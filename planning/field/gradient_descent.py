"""Steps down a potential, each of them proved free before it is taken."""

from enum import IntEnum
from typing import NamedTuple

import numpy as np

from compiled.kernel import kernel
from kinematics.arrays import Array
from obstacles.collision.edge_check import FREE, Cubic, certify_in
from obstacles.collision.model.kernel_work import Workspace, workspace
from obstacles.collision.model.model_arrays import ModelArrays
from planning.constraints.edge_bounds import EDGE_CELLS, EdgeVerdict, edge_kernel
from planning.field.potential import Field, Slope
from planning.values.deadline import Deadline


class Outcome(IntEnum):
    """Outcome of a descent."""

    #: It is at the goal.
    ARRIVED = 0
    #: No step along the force is proved.
    BLOCKED = 1
    #: Its steps were used up.
    GOING = 2
    #: The force vanishes, but for joints at their limits: a local minimum, or a saddle.
    MINIMUM = 3
    #: As many steps as it has patience for did not lower the potential.
    STALLED = 4
    #: Every proved step along the force leads higher: a kink of the potential.
    KINK = 5


#: An adaptive step that was taken whole may be longer next time by this factor.
GROWTH = 1.5
#: An adaptive step is not halved below this: it could not lower the potential by its rounding
#: [rad or m].
_SHORTEST = 1e-12
#: Length of a move that ``_move`` did not find, because every proved one leads higher.
_UPHILL = -1.0


class Proof(NamedTuple):
    """The conditions that every step is proved to hold.

    Args:
        model: The packed robot and scene.
        slack: Distance to keep beyond the margins [m].
        rows: Rows of the constraints, shape (r, WIDTH); r = 0 where there are none.
    """

    model: ModelArrays
    slack: float
    rows: Array


class Rules(NamedTuple):
    """Parameters of the descent; ``FieldOptions`` says what each of these means.

    Args:
        lower: Lower joint limits, shape (n,) [rad or m].
        upper: Upper joint limits, shape (n,) [rad or m].
        sizes: alpha_k, shape (k,); the last one is kept; k = 0 where they are adaptive.
        longest: Longest step of a joint [rad or m].
        halvings: Halvings of a step that can't be taken.
        tolerance: Distance from the goal that counts as arrived [rad or m].
        connect: Whether a proved straight motion to the goal counts too.
        patience: Steps in a row without progress after which it gives up.
        progress: Share of the lowest potential by which a step has to lower it to be progress.
        force_tolerance: Share of its terms below which the joint force vanishes.
    """

    lower: Array
    upper: Array
    sizes: Array
    longest: float
    halvings: int
    tolerance: float
    connect: bool
    patience: int
    progress: float
    force_tolerance: float


class Descent:
    """A descent, and the configurations that it visits.

    Args:
        field: The potential.
        proof: Conditions of every step.
        rules: Parameters of the descent.
        start: Configuration that it begins at, shape (n,) [rad or m].

    Attributes:
        visited: Configurations so far, each (n,).
        potentials: U at each of them [J].
        slope: The potential at the last of them.
        iterations: Steps that were taken.
        step: The next adaptive step [rad or m].
    """

    def __init__(self, field: Field, proof: Proof, rules: Rules, start: Array) -> None:
        self.field, self.proof, self.rules = field, proof, rules
        self.visited: list[Array] = []
        self.potentials: list[float] = []
        self.iterations, self.step = 0, rules.longest
        self._work = workspace(proof.model)
        self._lowest, self._stale = np.inf, 0
        # Share of the straight line to the goal that is left where it was last blocked.
        self._line_blocked: float | None = None
        self._visit(np.array(start, dtype=np.float64))

    def run(
        self, most: int, deadline: Deadline, across: Array | None = None, walk: int = 0
    ) -> Outcome | None:
        """Walk, then descend until that ends; the outcome, None where the time is up first.

        Args:
            most: Steps, those of earlier runs counted, after which it stops.
            deadline: The end of all of it.
            across: Direction of a walk to begin with, shape (n,), its largest entry 1.
            walk: Longest steps of that walk, which ends before one that is not proved.
        """
        rules = self.rules
        if across is not None and walk > 0:
            self.step, self._lowest, self._stale = rules.longest, np.inf, 0
            for _ in range(walk):
                if self._move(across, rules.longest, np.inf) == 0.0:
                    break
        while not deadline.passed:
            if self._reaches_goal():
                return Outcome.ARRIVED
            if self.iterations >= most:
                return Outcome.GOING
            potential = self.potentials[-1]
            is_progress = potential < (1.0 - rules.progress) * self._lowest
            self._stale = 0 if is_progress else self._stale + 1
            self._lowest = min(self._lowest, potential)
            outcome = self._take_step()
            if outcome != Outcome.GOING:
                return outcome
        return None

    @property
    def is_at_minimum(self) -> bool:
        """Whether the force vanishes at the last configuration, but for joints at their limits."""
        return float(np.abs(self._free_force()).max()) <= self.slope.least_force

    def _visit(self, q: Array, slope: Slope | None = None) -> None:
        self.slope = slope or self.field.slope(q, self.rules.force_tolerance)
        self.visited.append(q)
        self.potentials.append(self.slope.potential)

    def _is_free(self, a: Array, b: Array, outcome: Array) -> bool:
        return bool(is_free_kernel(self.proof, self._work, a, b, outcome))

    def _free_force(self) -> Array:
        """The joint force (n,) without what pushes joints beyond limits that they stand at."""
        q, force, rules = self.visited[-1], self.slope.joint_force, self.rules
        held = ((q <= rules.lower) & (force < 0.0)) | ((q >= rules.upper) & (force > 0.0))
        return np.where(held, 0.0, force)

    def _reaches_goal(self) -> bool:
        """Whether the goal is near enough, or in reach of a proved straight motion."""
        q, goal = self.visited[-1], self.field.goal
        away = float(np.linalg.norm(goal - q))
        if not (self.rules.connect or away < self.rules.tolerance):
            return False
        outcome = np.array([1.0, 0.0, 0.0, 0.0])
        if self._line_blocked is not None:
            # Where the line was blocked a step before, it mostly still is: one state tells it.
            blocked = goal + self._line_blocked * (q - goal)
            if not self._is_free(blocked, blocked, outcome):
                return False
        if not self._is_free(q, goal, outcome):
            self._line_blocked = 1.0 - float(outcome[0])
            return False
        if len(self.visited) == 1 or away > 0.0:
            self._visit(goal)
        return True

    def _take_step(self) -> Outcome:
        """Take one step along the force: GOING, or why there is none."""
        rules, force = self.rules, self._free_force()
        strength = float(np.abs(force).max())
        if strength <= self.slope.least_force:
            return Outcome.MINIMUM
        if self._stale >= rules.patience:
            return Outcome.STALLED
        direction = force / strength
        if len(rules.sizes):
            size = float(rules.sizes[min(self.iterations, len(rules.sizes) - 1)])
            moved = self._move(direction, min(size * strength, rules.longest), np.inf)
            return Outcome.GOING if moved > 0.0 else Outcome.BLOCKED
        moved = self._move(direction, self.step, self.potentials[-1])
        self.step = min(GROWTH * (moved if moved > 0.0 else self.step), rules.longest)
        if moved == _UPHILL:
            return Outcome.KINK
        return Outcome.GOING if moved > 0.0 else Outcome.BLOCKED

    def _move(self, direction: Array, reach: float, highest: float) -> float:
        """Move by ``reach`` at most, halved until that is proved and lower than ``highest``.

        Returns:
            Length of the move of the joint that moves most [rad or m]; 0 where none is proved after
            all halvings, ``_UPHILL`` where all that are proved lead higher.
        """
        q, rules, outcome = self.visited[-1], self.rules, np.empty(4)
        unproved, missed = 0, 0.0
        while unproved <= rules.halvings:
            moved = np.minimum(np.maximum(q + reach * direction, rules.lower), rules.upper)
            if (moved != q).any() and self._is_free(q, moved, outcome):
                slope = self.field.slope(moved, rules.force_tolerance)
                if slope.potential < highest:
                    self._visit(moved, slope)
                    self.iterations += 1
                    return reach
                if reach < _SHORTEST:
                    return _UPHILL
                missed = _UPHILL
            else:
                unproved += 1
            reach /= 2.0
        return missed


@kernel
def is_free_kernel(proof: Proof, work: Workspace, a: Array, b: Array, outcome: Array) -> bool:
    """Whether the straight motion from a to b, both (n,), is proved.

    Where it is not, ``outcome[0]`` is the place that could not be proved, from 0 to 1.
    """
    n, r = a.shape[0], proof.rows.shape[0]
    zero = np.zeros(n)
    if r > 0:
        ends = np.empty((n, 2))
        for j in range(n):
            ends[j, 0], ends[j, 1] = a[j], b[j] - a[j]
        holds, outcome[0] = edge_kernel(proof.model.chain, proof.rows, ends, EDGE_CELLS)
        if holds != EdgeVerdict.HOLDS:
            return False
    line = Cubic(a, b - a, zero, zero)
    # A step whose proof needs more than 800 intervals grazes something all along.
    verdict = certify_in(proof.model, work, line, proof.slack, 800, outcome)
    return bool(verdict == FREE)
