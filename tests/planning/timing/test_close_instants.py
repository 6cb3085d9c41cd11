"""Instants of a motion at which it is too near, against looks at single states of it."""

import numpy as np
import pytest

from kinematics.trajectory.trajectory import Trajectory
from obstacles.collision.checker import Checker
from planning.options import Options
from planning.problem import JointGoal, Problem
from planning.timing.close_instants import close_instants, not_beside, spans_beside
from tests.planning.scenes import HOME, builtin, pillar, planned_motion

GOAL = np.array([1.2, -0.3, 0.0, -2.0, 0.0, 1.8, 0.785])
POST = pillar(0.6, 0.505)


@pytest.fixture(scope="module")
def motion() -> Trajectory:
    """Past a post, which most of it is near by 30 cm."""
    answer = planned_motion(Problem(builtin("panda"), POST, HOME, (JointGoal(GOAL),)), Options())
    return answer.trajectory


def level(margin: float) -> Checker:
    return Checker(Checker.of(builtin("panda"), POST).model.with_margins(margin, 0.0))


@pytest.mark.parametrize("margin", [0.05, 0.1, 0.3])
def test_instants_are_those_of_states_that_are_not_valid(motion: Trajectory, margin: float) -> None:
    looked = level(margin)
    found = close_instants(looked, motion.breaks, motion.coefficients)
    assert len(found.times)
    assert not looked.each_valid(motion.sample(found.times)).any()
    assert (found.spans[:, 0] <= found.times).all()
    assert (found.times <= found.spans[:, 1]).all()
    # The looks beside a run of them are valid: they are where it ends.
    beside = np.setdiff1d(found.spans, found.times)
    assert looked.each_valid(motion.sample(beside)).all()


@pytest.mark.parametrize("seed", range(10))
def test_within_spans_it_finds_what_it_finds_there_at_all(motion: Trajectory, seed: int) -> None:
    random = np.random.default_rng(seed)
    pieces = motion.breaks, motion.coefficients
    whole = close_instants(level(0.1), *pieces)
    shares = np.sort(random.uniform(0.0, 1.0, random.integers(1, 6)))
    spans = motion.duration * spans_beside(shares)
    part = close_instants(level(0.1), *pieces, within=spans)
    inside = (whole.times[:, None] >= spans[:, 0]) & (whole.times[:, None] <= spans[:, 1])
    np.testing.assert_array_equal(part.times, whole.times[inside.any(axis=1)])
    np.testing.assert_array_equal(part.spans, whole.spans[inside.any(axis=1)])
    # So what lies beside nothing is told by either.
    by_part = not_beside(shares, part.times / motion.duration)
    np.testing.assert_array_equal(by_part, not_beside(shares, whole.times / motion.duration))


def test_what_keeps_more_keeps_less(motion: Trajectory) -> None:
    pieces = motion.breaks, motion.coefficients
    above = close_instants(level(0.1), *pieces)
    lower = close_instants(level(0.06), *pieces)
    assert 0 < len(lower.times) < len(above.times)
    within = close_instants(level(0.06), *pieces, within=above.spans)
    np.testing.assert_array_equal(within.times, lower.times)
