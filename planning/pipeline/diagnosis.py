"""Diagnosis of a search that found no path: what is in the way.

It counts which pairs stop short motions most often, near the start, near the goals and on the way
between them; how many of those motions are free; and which obstacles, each taken away, leave a
path.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from kinematics.arrays import Array
from kinematics.errors import ArmwrightError
from kinematics.model.chain import Chain
from obstacles.collision.checker import Checker
from planning.planner import Ready
from planning.problem import Problem
from planning.sampling.search import sample
from planning.search.rrt_connect import straight_line
from planning.values.deadline import Deadline

#: Options of that search: edges as long as those of a plan [rad].
_SEARCH_OPTIONS = {"range": 0.5}


@dataclass(slots=True)
class _Tally:
    """Motions that were checked, and the pairs that stopped those that are not free."""

    checked: int = 0
    free: int = 0
    stopped: Counter[tuple[str, str]] = field(default_factory=Counter)

    def check(self, checker: Checker, a: Array, b: Array) -> None:
        motion = checker.segment(a, b)
        self.checked += 1
        self.free += motion.free
        if motion.pair is not None:
            first, second = motion.pair
            self.stopped[(first, second)] += 1

    @property
    def share(self) -> float:
        """Share of the motions that are free."""
        return self.free / self.checked if self.checked else 0.0


@dataclass(frozen=True, slots=True, eq=False)
class Diagnosis:
    """Obstruction of motions from a start to goals.

    Args:
        blocked_by: Pairs that stopped motions, with their share of those that were stopped, the
            most frequent first.
        start_freedom: Share of short random motions from the start that are free.
        goal_freedom: Share of short random motions from the goals that are free.
        would_unblock: Obstacles of which each, taken away alone, leaves a path that was found.
        tried: Obstacles that were taken away in turn.
        motions: Number of motions that were checked.
    """

    blocked_by: tuple[tuple[tuple[str, str], float], ...]
    start_freedom: float
    goal_freedom: float
    would_unblock: tuple[str, ...]
    tried: tuple[str, ...]
    motions: int

    @property
    def details(self) -> dict[str, Any]:
        """The diagnosis as values a program can use."""
        return {
            "blocked_by": [{"pair": list(pair), "share": share} for pair, share in self.blocked_by],
            "start_freedom": self.start_freedom,
            "goal_freedom": self.goal_freedom,
            "would_unblock": list(self.would_unblock),
            "tried_without": list(self.tried),
            "motions": self.motions,
        }

    @property
    def sentence(self) -> str:
        """The diagnosis in one sentence."""
        if not self.blocked_by:
            return "Nothing was found to be in the way of short motions."
        (a, b), share = self.blocked_by[0]
        text = f"{a!r} and {b!r} stopped {100.0 * share:.0f} % of the motions that were stopped"
        if self.would_unblock:
            text += f"; without {self.would_unblock[0]!r} there is a way"
        return f"{text}."


def diagnose(
    problem: Problem, checker: Checker, ready: Ready, deadline: Deadline, seed: int = 0
) -> Diagnosis:
    """Find out what is in the way of a path that was not found.

    Args:
        problem: The robot, the scene and the margin.
        checker: The robot in that scene.
        ready: Start and goals, the most wanted first.
        deadline: When to stop looking.
        seed: Of the motions that are drawn; the same seed gives the same answer, time permitting.
    """
    start, goals, scene = ready.start, ready.goals, problem.scene
    random = np.random.default_rng(seed)
    # Share of the time for checking motions.
    checking = deadline.within(0.4 * deadline.remaining)
    at_start, at_goals, between = _Tally(), _Tally(), _Tally()
    chain = checker.model.robot.chain
    # Motions that are checked of each kind.
    for k in range(60):
        if checking.passed:
            break
        goal = goals[k % len(goals)]
        at_start.check(checker, start, _short_motion(chain, start, random))
        at_goals.check(checker, goal, _short_motion(chain, goal, random))
        between.check(checker, *_random_motion(chain, start, goal, random))
    stopped = at_start.stopped + at_goals.stopped + between.stopped
    total = sum(stopped.values())
    pairs = sorted(stopped.items(), key=lambda item: (-item[1], item[0]))
    suspects = list(dict.fromkeys(name for pair, _ in pairs for name in pair if name in scene.ids))
    # Obstacles that are taken away in turn.
    tried, helping = _try_without(problem, ready, suspects[:3], deadline, seed)
    # Pairs that are reported, the most frequent first.
    return Diagnosis(
        blocked_by=tuple((pair, count / total) for pair, count in pairs[:8]),
        start_freedom=at_start.share,
        goal_freedom=at_goals.share,
        would_unblock=helping,
        tried=tried,
        motions=at_start.checked + at_goals.checked + between.checked,
    )


def _short_motion(chain: Chain, q: Array, random: np.random.Generator) -> Array:
    """The end of a short motion from q (n,) in a random direction, inside the limits."""
    direction = random.normal(size=len(q))
    # Length of the motions about start and goals, Euclidean in joint space [rad or m].
    direction *= 0.35 / float(np.linalg.norm(direction))
    return np.asarray(np.clip(q + direction, chain.limits.lower, chain.limits.upper))


def _random_motion(
    chain: Chain, start: Array, goal: Array, random: np.random.Generator
) -> tuple[Array, Array]:
    """A fifth of the straight line from start to goal, somewhere along it and a little beside."""
    line = goal - start
    # Standard deviation of motions beside the straight line, as part of its length.
    aside = 0.15 * float(np.linalg.norm(line)) * random.normal(size=len(line)) / len(line) ** 0.5
    # Length of the motions along the straight line, as part of it.
    stretch = 0.2
    at = random.uniform(0.0, 1.0 - stretch)
    ends = np.array([start + at * line + aside, start + (at + stretch) * line + aside])
    a, b = np.clip(ends, chain.limits.lower, chain.limits.upper)
    return a, b


def _try_without(
    problem: Problem, ready: Ready, suspects: Sequence[str], deadline: Deadline, seed: int
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Obstacles that were taken away in turn, and those without which a path was found."""
    tried: list[str] = []
    helping: list[str] = []
    for name in suspects:
        if deadline.passed:
            break
        # Share of the time that is then left for the search without each obstacle.
        until = deadline.within(0.5 * deadline.remaining)
        others = tuple(one for one in problem.scene.obstacles if one.id != name)
        scene = replace(problem.scene, obstacles=others)
        if _has_path(Checker.of(problem.robot, scene, problem.margin), ready, until, seed):
            helping.append(name)
        tried.append(name)
    return tuple(tried), tuple(helping)


def _has_path(checker: Checker, ready: Ready, deadline: Deadline, seed: int) -> bool:
    start, goals = ready.start, list(ready.goals)
    waypoints, _ = straight_line(checker, start, goals)
    if waypoints is not None:
        return True
    try:
        attempt = sample(
            "rrt_connect", checker.model.robot.chain, checker, start, goals, _SEARCH_OPTIONS, seed,
            deadline,
        )  # fmt: skip
    except ArmwrightError:
        # A diagnosis never adds a failure of its own to the one it explains.
        return False
    return attempt.waypoints is not None
