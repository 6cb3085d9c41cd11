"""Diagnosis of a search that found no path: what is in the way.

Which pairs stopped motions most often, near the start, near the goals and on the way; how
free start and goals are; and which obstacles, each taken away, leave a way.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from kinematics.arrays import Array
from kinematics.chain import Chain
from kinematics.errors import ArmwrightError
from obstacles.checker import Checker
from obstacles.robot_geometry import RobotGeometry
from obstacles.scene import Scene
from planning.deadline import Deadline
from planning.sampling.search import sample
from planning.search.straight_line import straight_line

#: Motions looked at of each kind, and how long those about start and goals are [rad or m].
_MOTIONS, _SHORT = 60, 0.35
#: Spread of motions along the straight way, as part of its length.
_SPREAD = 0.15
#: Pairs told, and obstacles that are tried to be taken away.
_TOLD, _TRIED = 8, 3
#: Shares of the time left for looking, and of what is then left for each obstacle.
_LOOKING, _TRYING = 0.4, 0.5
_RANGE = {"range": 0.5}


@dataclass(slots=True)
class _Looks:
    """Motions that were looked at, and what stopped those that are not free."""

    seen: int = 0
    free: int = 0
    stopped: Counter[tuple[str, str]] = field(default_factory=Counter)

    def look(self, checker: Checker, a: Array, b: Array) -> None:
        motion = checker.segment(a, b)
        self.seen += 1
        self.free += motion.free
        if motion.pair is not None:
            first, second = motion.pair
            self.stopped[(first, second)] += 1

    @property
    def share(self) -> float:
        """Of the motions that are free."""
        return self.free / self.seen if self.seen else 0.0


@dataclass(frozen=True, slots=True, eq=False)
class Diagnosis:
    """What is in the way of a motion from a start to goals.

    Args:
        blocked_by: Pairs that stopped motions, with their share of those that were stopped, the
            most frequent first.
        start_freedom: Share of short random motions from the start that are free.
        goal_freedom: The same of the goals.
        would_unblock: Obstacles of which each, taken away alone, leaves a way that was found.
        tried: Obstacles that were taken away.
        motions: How many were looked at.
    """

    blocked_by: tuple[tuple[tuple[str, str], float], ...]
    start_freedom: float
    goal_freedom: float
    would_unblock: tuple[str, ...]
    tried: tuple[str, ...]
    motions: int

    @property
    def details(self) -> dict[str, Any]:
        """As values a program can use."""
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
        """What it comes to, for a person."""
        if not self.blocked_by:
            return "Nothing was found to be in the way of short motions."
        (a, b), share = self.blocked_by[0]
        text = f"{a!r} and {b!r} stopped {100.0 * share:.0f} % of the motions that were stopped"
        if self.would_unblock:
            text += f"; without {self.would_unblock[0]!r} there is a way"
        return f"{text}."


def diagnose(
    robot: RobotGeometry,
    scene: Scene,
    checker: Checker,
    start: Array,
    goals: Sequence[Array],
    deadline: Deadline,
    *,
    margin: float = 0.0,
    seed: int = 0,
) -> Diagnosis:
    """Look for what is in the way of a motion that was not found.

    Args:
        robot: The arm with its geometry.
        scene: The obstacles.
        checker: Of the two.
        start: Free, shape (n,).
        goals: Free, each (n,), the most wanted first.
        deadline: When to stop looking.
        margin: Kept from the obstacles beyond their own [m].
        seed: Of the motions that are drawn; the same seed gives the same answer, time permitting.
    """
    random = np.random.default_rng(seed)
    looking = Deadline.after(_LOOKING * deadline.remaining)
    kinds = [_Looks(), _Looks(), _Looks()]
    for k in range(_MOTIONS):
        if looking.passed:
            break
        goal = goals[k % len(goals)]
        kinds[0].look(checker, start, _beside(checker, start, _SHORT, random))
        kinds[1].look(checker, goal, _beside(checker, goal, _SHORT, random))
        kinds[2].look(checker, *_on_the_way(checker.model.chain, start, goal, random))
    stopped: Counter[tuple[str, str]] = Counter()
    for looks in kinds:
        stopped.update(looks.stopped)
    total = sum(stopped.values())
    most = sorted(stopped.items(), key=lambda item: (-item[1], item[0]))
    suspects = list(dict.fromkeys(name for pair, _ in most for name in pair if name in scene.ids))
    tried, found = _without(
        robot, scene, start, goals, suspects[:_TRIED], deadline, margin=margin, seed=seed
    )
    return Diagnosis(
        blocked_by=tuple((pair, count / total) for pair, count in most[:_TOLD]),
        start_freedom=kinds[0].share,
        goal_freedom=kinds[1].share,
        would_unblock=found,
        tried=tried,
        motions=sum(looks.seen for looks in kinds),
    )


def _beside(checker: Checker, q: Array, length: float, random: np.random.Generator) -> Array:
    limits = checker.model.chain.limits
    direction = random.normal(size=len(q))
    direction *= length / float(np.linalg.norm(direction))
    return np.asarray(np.clip(q + direction, limits.lower, limits.upper))


def _on_the_way(
    chain: Chain, start: Array, goal: Array, random: np.random.Generator
) -> tuple[Array, Array]:
    """A motion of a fifth of the straight way, somewhere along it and a little beside."""
    way = goal - start
    aside = _SPREAD * float(np.linalg.norm(way)) * random.normal(size=len(way)) / len(way) ** 0.5
    at = random.uniform(0.0, 0.8)
    ends = np.array([start + at * way + aside, start + (at + 0.2) * way + aside])
    a, b = np.clip(ends, chain.limits.lower, chain.limits.upper)
    return a, b


def _without(
    robot: RobotGeometry,
    scene: Scene,
    start: Array,
    goals: Sequence[Array],
    suspects: Sequence[str],
    deadline: Deadline,
    *,
    margin: float,
    seed: int,
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Obstacles that were taken away in turn, and those without which there is a way."""
    tried: list[str] = []
    found: list[str] = []
    for name in suspects:
        if deadline.passed:
            break
        own = Deadline.after(_TRYING * deadline.remaining)
        left = tuple(obstacle for obstacle in scene.obstacles if obstacle.id != name)
        checker = Checker.of(robot, replace(scene, obstacles=left), margin)
        if _connected(robot.chain, checker, start, list(goals), own, seed):
            found.append(name)
        tried.append(name)
    return tuple(tried), tuple(found)


def _connected(
    chain: Chain, checker: Checker, start: Array, goals: list[Array], deadline: Deadline, seed: int
) -> bool:
    waypoints, _ = straight_line(checker, start, goals)
    if waypoints is not None:
        return True
    try:
        found = sample("rrt_connect", chain, checker, start, goals, _RANGE, seed, deadline)
    except ArmwrightError:
        # A diagnosis never adds a failure of its own to the one it explains.
        return False
    return found.waypoints is not None
