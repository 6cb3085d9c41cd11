"""Why there is no plan: what is in the way, and what would do instead.

Of a start or goal that is not free, the nearest configuration found that is. Of a search that found
nothing, which pairs stopped motions most often, near the start, near the goals and on the way; how
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
from kinematics.forward import forward
from obstacles.checker import Checker
from obstacles.robot_geometry import RobotGeometry
from obstacles.scene import Scene
from planning.deadline import Deadline
from planning.sampling.search import sample
from planning.search.straight_line import straight_line

#: Clearance that a configuration found to be free has at least, margins taken off [m].
_ROOM = 1e-3
#: Steps of the descent out of what is touched, and how near pairs count in it [m].
_STEPS, _NEAR = 40, 0.02
#: Farthest step of any joint in it [rad or m].
_STRIDE = 0.2
#: Random configurations about the one that is not free, if the descent fails, and how far off they
#: are drawn: from hardly to all over the joints' ranges.
_DRAWS = 240
_NARROWEST = 0.02
#: Halvings of the way back to what was asked for.
_HALVINGS = 12
#: Motions looked at of each kind, and how long those about start and goals are [rad or m].
_MOTIONS, _SHORT = 60, 0.35
#: Spread of motions along the straight way, as part of its length.
_SPREAD = 0.15
#: Pairs told, and obstacles that are tried to be taken away.
_TOLD, _TRIED = 8, 3
#: Shares of the time left for looking, and of what is then left for each obstacle.
_LOOKING, _TRYING = 0.4, 0.5
_RANGE = {"range": 0.5}


@dataclass(frozen=True, slots=True, eq=False)
class NearestFree:
    """A configuration that is free, near one that is not.

    Args:
        joints: Shape (n,).
        distance: Euclidean, in joint space.
        tip_distance: How far the tip's origin is moved [m].
        clearance: Margins taken off [m].
    """

    joints: Array
    distance: float
    tip_distance: float
    clearance: float

    @property
    def details(self) -> dict[str, Any]:
        """As values a program can use."""
        return {
            "joints": self.joints.tolist(),
            "distance": self.distance,
            "tip_distance": self.tip_distance,
            "clearance": self.clearance,
        }


def nearest_free(checker: Checker, q: Array, seed: int = 0) -> NearestFree | None:
    """A free configuration near one that is not, inside the limits; None if none was found.

    Descends on what overlaps: the least step that brings all near pairs apart, to first order,
    again and again. Where that fails, random draws farther and farther off are tried. From what is
    found it goes back towards ``q`` as far as all stays free. It is near, not proved to be nearest.

    Args:
        checker: The robot in its scene, margins included.
        q: Shape (n,).
        seed: Of the draws; the same seed gives the same answer.
    """
    chain = checker.model.chain
    roomy = Checker(checker.model, checker.slack + _ROOM)
    inside = np.clip(q, chain.limits.lower, chain.limits.upper)
    found = _descended(roomy, inside)
    if found is None:
        found = _drawn(roomy, inside, np.random.default_rng(seed))
    if found is None:
        return None
    found = _back(roomy, found, inside)
    moved = forward(chain, found)[:3, 3] - forward(chain, q)[:3, 3]
    clearance, _ = checker.clearance(found)
    return NearestFree(
        found, float(np.linalg.norm(found - q)), float(np.linalg.norm(moved)), clearance
    )


def _descended(roomy: Checker, q: Array) -> Array | None:
    limits = roomy.model.chain.limits
    here = q
    for _ in range(_STEPS):
        if roomy.valid(here):
            return here
        near = roomy.gradient(here, _NEAR)
        touching = near.distances <= _ROOM
        if not touching.any():
            return None
        # What is near but apart may come nearer, though not into touch.
        wanted = np.where(touching, 2.0 * _ROOM - near.distances, 0.0)
        held = touching | (near.gradients @ _away(near.gradients[touching], wanted[touching]) < 0)
        step = _away(near.gradients[held], wanted[held])
        longest = float(np.abs(step).max())
        if not longest > 0.0:
            return None
        step *= min(1.0, _STRIDE / longest)
        here = np.clip(here + step, limits.lower, limits.upper)
    return None


def _away(gradients: Array, wanted: Array) -> Array:
    """The least step that changes distances as wanted, to first order, shape (n,)."""
    return np.asarray(np.linalg.lstsq(gradients, wanted, rcond=1e-3)[0])


def _drawn(roomy: Checker, q: Array, random: np.random.Generator) -> Array | None:
    chain = roomy.model.chain
    low, high = chain.sampling_bounds()
    best: Array | None = None
    for k in range(_DRAWS):
        share = _NARROWEST ** (1.0 - k / _DRAWS)
        drawn = q + share * (high - low) * random.uniform(-1.0, 1.0, chain.n)
        drawn = np.clip(drawn, chain.limits.lower, chain.limits.upper)
        if best is not None and np.linalg.norm(drawn - q) >= np.linalg.norm(best - q):
            continue
        if roomy.valid(drawn):
            best = _back(roomy, drawn, q)
    return best


def _back(roomy: Checker, free: Array, q: Array) -> Array:
    """The free configuration nearest to ``q`` that a bisection finds on the way there."""
    sure, maybe = 0.0, 1.0
    for _ in range(_HALVINGS):
        middle = 0.5 * (sure + maybe)
        if roomy.valid(free + middle * (q - free)):
            sure = middle
        else:
            maybe = middle
    return np.asarray(free + sure * (q - free))


# ---------------------------------------------------------------------------------- searches


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
