"""Values of a joint that no motion passes, whatever the other joints do.

Between a start and a goal a joint without end stops passes all values between the two. Where one
of these collides in every configuration, no path leads there, however long the search takes.
Whether every one does is certain where the two bodies move against each other by that joint alone;
else it is what many random configurations say.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from kinematics.arrays import Array
from kinematics.model.chain import Chain, JointType
from obstacles.collision.checker import Checker
from planning.values.deadline import Deadline

#: Values between start and goal that are checked, and configurations at each: at first, and where
#: none of these is free.
_VALUES, _FIRST, _MORE = 24, 32, 512


@dataclass(frozen=True, slots=True)
class JointBarrier:
    """A value of a joint at which everything collides.

    Args:
        joint: Name of the joint.
        value: Value of the joint [rad or m].
        start: Value of the joint at the start.
        goal: Value of the joint at the goal.
        pair: Pair that collides there.
        certain: Whether the pair collides there whatever the other joints do; else it is what all
            random configurations say.
        around: A whole turn less, or more, of the goal on the start's side, inside the limits; None
            where there is none.
    """

    joint: str
    value: float
    start: float
    goal: float
    pair: tuple[str, str]
    certain: bool
    around: float | None

    @property
    def message(self) -> str:
        """One sentence."""
        a, b = self.pair
        passes = (
            f"joint {self.joint!r} would have to pass {self.value:.4g} on its way from "
            f"{self.start:.4g} to {self.goal:.4g}, where {a!r} and {b!r} collide"
        )
        if self.certain:
            return f"no path exists: {passes} whatever the other joints do"
        return f"no path was found, and likely none exists: {passes} in all configurations drawn"

    @property
    def hint(self) -> str:
        """Remedy."""
        if self.around is not None:
            return (
                f"More time does not help. The same pose is reached with {self.joint!r} at "
                f"{self.around:.4g}: give that, or the goal as a pose."
            )
        return (
            "More time does not help. Choose a goal on the start's side of that value, or move "
            "what is in the way."
        )


def joint_barrier(
    checker: Checker, start: Array, goals: Sequence[Array], seed: int, deadline: Deadline
) -> JointBarrier | None:
    """The value of a joint that cuts off all goals; None where none was found.

    Args:
        checker: The robot in its scene.
        start: Free, shape (n,).
        goals: Free, each (n,).
        seed: Seed of the random configurations.
        deadline: Instant at which the search stops.
    """
    found: JointBarrier | None = None
    for goal in goals:
        barrier = _barrier_to(checker, start, goal, seed, deadline)
        if barrier is None:
            return None
        found = found or barrier
    return found


def _barrier_to(
    checker: Checker, start: Array, goal: Array, seed: int, deadline: Deadline
) -> JointBarrier | None:
    random, chain = np.random.default_rng(seed), checker.model.robot.chain
    endless = chain.continuous & (chain.joint_types == JointType.REVOLUTE)
    # Joints that move less are none that a value could stop [rad or m].
    for j in np.flatnonzero((np.abs(goal - start) > 0.05) & ~endless):
        values = np.linspace(start[j], goal[j], _VALUES + 2)[1:-1]
        states = np.array(list(_draws(chain, int(j), values, _FIRST, random)))
        if deadline.passed:
            return None
        blocked = ~checker.each_valid(states).reshape(_VALUES, _FIRST).any(axis=1)
        for value in values[blocked]:
            more = np.array(list(_draws(chain, int(j), value[None], _MORE, random)))
            more = np.concatenate([more, _between(start, goal, int(j), float(value))])
            if deadline.passed:
                return None
            if not checker.each_valid(more).any():
                return _described(checker, more, start, goal, (int(j), float(value)))
    return None


def _draws(
    chain: Chain, j: int, values: Array, count: int, random: np.random.Generator
) -> Iterator[Array]:
    """Configurations with a joint at each of some values, the other joints anywhere."""
    low, high = chain.sampling_bounds()
    for value in values:
        drawn = random.uniform(low, high, (count, chain.n))
        drawn[:, j] = value
        yield from drawn


def _between(start: Array, goal: Array, j: int, value: float) -> Array:
    """Configurations between start and goal with a joint at a value."""
    rows = start + np.linspace(0.0, 1.0, 9)[:, None] * (goal - start)
    rows[:, j] = value
    return np.asarray(rows)


def _described(
    checker: Checker, states: Array, start: Array, goal: Array, at: tuple[int, float]
) -> JointBarrier:
    """The barrier of a joint at a value, with the pair that is surest to collide there."""
    chain, (j, value) = checker.model.robot.chain, at
    overlap = checker.least_overlap(states)
    pair, certain = ("", "") if overlap is None else overlap[1], False
    near = checker.gradient(states[0], 0.0)
    for number, distance in zip(near.pairs, near.distances, strict=True):
        names = checker.model.pair_name(int(number))
        # An overlap that is deeper is one for certain [m].
        if distance < -1e-4 and _moves_by(chain, names, j):
            pair, certain = names, True
    turn = 2.0 * np.pi * np.sign(start[j] - goal[j])
    around = float(goal[j] + turn)
    side = (around - value) * (start[j] - value) > 0.0
    fits = chain.limits.lower[j] <= around <= chain.limits.upper[j]
    is_turn = chain.joint_types[j] == JointType.REVOLUTE
    return JointBarrier(
        chain.joint_names[j], value, float(start[j]), float(goal[j]), pair, certain,
        around if side and fits and is_turn else None,
    )  # fmt: skip


def _moves_by(chain: Chain, pair: tuple[str, str], j: int) -> bool:
    """Whether two bodies, links or what stands still, move against each other by a joint alone."""
    joints = [chain.links[chain.index[x]].joint if x in chain.index else None for x in pair]
    known = [-1 if joint is None else joint for joint in joints]
    # What is no link stands in the scene, or is held: of that nothing is known here.
    return None not in joints and (min(known), max(known)) == (j - 1, j)
