"""Looks at the legs of a path together, against looks at each and at its waypoints."""

import numpy as np

from kinematics.arrays import Array
from obstacles.collision.checker import Checker
from obstacles.collision.model.kernel_work import workspace
from planning.search.sampled_check import Look, all_look_free, look_of, looks_free
from tests.planning.scenes import HOME, builtin, shelf


def looks_at_each(checker: Checker, look: Look, points: Array, first: int, last: int) -> bool:
    """Whether the legs from row ``first`` to ``last`` look free, and the waypoints between."""
    arrays, work = checker.model.arrays, workspace(checker.model.arrays)
    legs = (looks_free(arrays, work, look, points[k], points[k + 1]) for k in range(first, last))
    return all(legs) and all(checker.valid(points[k]) for k in range(first + 1, last))


def test_legs_look_free_together_where_each_does_and_the_waypoints_between() -> None:
    checker = Checker.of(builtin("panda"), shelf(), 0.02)
    look, arrays = look_of(checker), checker.model.arrays
    random, told = np.random.default_rng(0), list[bool]()
    for _ in range(400):
        # Legs of very different lengths: other numbers of states are looked at on each.
        steps = random.normal(size=(5, 7)) * random.choice([0.004, 0.05, 0.4, 1.2], size=(5, 1))
        points = HOME + np.cumsum(random.choice([0.3, 1.0]) * steps, axis=0)
        first, last = 0, int(random.integers(1, 5))
        free = all_look_free(arrays, workspace(arrays), look, points, first, last)
        assert free == looks_at_each(checker, look, points, first, last)
        told.append(free)
    assert 50 < sum(told) < 350


def test_a_waypoint_between_legs_is_looked_at() -> None:
    checker = Checker.of(builtin("panda"), shelf(), 0.02)
    arrays, random = checker.model.arrays, np.random.default_rng(1)
    low, high = checker.model.chain.sampling_bounds()
    blocked = next(q for q in random.uniform(low, high, (200, 7)) if not checker.valid(q))
    # Legs of no length at a state that is not free: none of their own states is another one.
    assert not all_look_free(
        arrays, workspace(arrays), look_of(checker), np.array([blocked] * 3), 0, 2
    )
