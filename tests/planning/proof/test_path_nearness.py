"""How near a motion is to a path: bounds against dense samples and a discrete Frechet distance."""

from collections.abc import Callable

import numpy as np
import pytest

from kinematics.arrays import Array
from kinematics.errors import InvalidOption, InvalidTrajectory
from kinematics.trajectory.trajectory import Trajectory, interpolate
from planning.proof.path_nearness import path_nearness

SHAPES: tuple[Callable[[np.random.Generator, int], Array], ...] = (
    lambda rng, k: np.cumsum(rng.normal(0.0, 0.3, (k, 3)), axis=0),
    lambda rng, k: np.repeat(np.cumsum(rng.normal(0.0, 0.3, (k, 3)), axis=0), 2, axis=0),
    # There and back, so that places are visited twice.
    lambda rng, k: np.concatenate([w := np.cumsum(rng.normal(0, 0.3, (k, 3)), axis=0), w[-2::-1]]),
)


def along(points: Array, rng: np.random.Generator, off: float) -> Trajectory:
    """A cubic motion from rest to rest on each line, its ends up to ``off`` from the corners."""
    moved = points + rng.uniform(-off, off, points.shape)
    steps = np.diff(moved, axis=0)
    legs = np.stack([moved[:-1], 0.0 * steps, 3.0 * steps, -2.0 * steps], axis=-1)
    return Trajectory(("a", "b", "c"), np.arange(float(len(moved))), legs)


def frechet(first: Array, second: Array) -> float:
    """The discrete Frechet distance of two dense polylines, which is too large by their steps."""
    away = np.abs(first[:, None] - second[None]).max(axis=2)
    reached = np.maximum.accumulate(away[0])
    for row in away[1:]:
        before, reached = reached, reached.copy()
        reached[0] = max(before[0], row[0])
        for k in range(1, len(row)):
            reached[k] = max(min(before[k], before[k - 1], reached[k - 1]), row[k])
    return float(reached[-1])


def dense(points: Array, count: int = 40) -> Array:
    """A polyline with so many places on each line."""
    at = np.linspace(0.0, len(points) - 1.0, count * (len(points) - 1) + 1)
    return np.stack([np.interp(at, np.arange(len(points)), row) for row in points.T], axis=-1)


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("seed", range(6))
def test_bound_agrees_with_discrete_distance(
    shape: Callable[[np.random.Generator, int], Array], seed: int
) -> None:
    rng = np.random.default_rng(seed)
    points = shape(rng, 6)
    motion = along(points, rng, 0.05)
    line, moved = dense(points), motion.sample(np.linspace(0.0, motion.duration, 400))
    true = frechet(moved, line)
    steps = max(np.abs(np.diff(rows, axis=0)).max() for rows in (line, moved))
    near, wrong = path_nearness(motion, points, 0.2)
    assert wrong is None
    assert near.deviation is not None
    # The bound is within 1/32 and a chord of the tolerance.
    assert true - steps - 0.2 / 32 <= near.deviation <= true + 0.2 / 16
    refused, wrong = path_nearness(motion, points, 0.9 * (true - steps))
    assert wrong is not None
    assert refused.deviation is None
    assert wrong.kind == "path_deviation"


@pytest.mark.parametrize("seed", range(10))
def test_motion_just_off_its_path_is_told_from_one_just_on_it(seed: int) -> None:
    rng = np.random.default_rng(seed)
    n, off = 3, 1e-3 * 10.0 ** rng.uniform(-3.0, 1.0)
    start, end = rng.uniform(-1.0, 1.0, (2, n))
    points = start + np.linspace(0.0, 1.0, 30)[:, None] * (end - start)
    # A bump of height ``off`` across a line: joint 0 alone, where the line stands still in it.
    points[:, 0] = start[0]
    knots = np.linspace(0.0, 2.0, 5)
    through = np.stack([np.interp(knots, [0.0, 2.0], row) for row in points[[0, -1]].T], axis=-1)
    through[2, 0] += off
    motion = interpolate(("a", "b", "c"), knots, through, "clamped_spline")
    assert path_nearness(motion, points, 1.01 * off)[1] is None
    wrong = path_nearness(motion, points, 0.99 * off)[1]
    assert wrong is not None
    assert 0.5 < wrong.time <= 1.0


def test_order_and_ends_of_the_path_count() -> None:
    rng = np.random.default_rng(1)
    points = np.cumsum(rng.uniform(0.2, 0.5, (5, 3)), axis=0)
    motion = along(points, rng, 0.0)
    assert path_nearness(motion, points, 1e-4)[1] is None
    for other in (points[::-1], points[:-1], points[1:], points[[0, 2, 1, 3, 4]]):
        assert path_nearness(motion, other, 1e-2)[1] is not None
    still = Trajectory(("a", "b", "c"), np.array([0.0, 1.0]), points[:1, :, None])
    assert path_nearness(still, points[:1], 1e-6)[0].deviation is not None
    assert path_nearness(still, points[:2], 1e-2)[1] is not None


def test_what_is_too_fine_is_not_proved() -> None:
    motion = along(np.cumsum(np.ones((5, 3)), axis=0), np.random.default_rng(0), 0.0)
    wrong = path_nearness(motion, motion.sample(np.arange(5.0)), 1e-13)[1]
    assert wrong is not None
    assert wrong.kind == "unproved"


def test_odd_input_is_refused() -> None:
    motion = along(np.zeros((2, 3)), np.random.default_rng(0), 0.1)
    for points in (np.zeros((2, 2)), np.full((2, 3), np.nan), np.zeros(3)):
        with pytest.raises((InvalidTrajectory, InvalidOption), match=r"path|waypoints"):
            path_nearness(motion, points, 1e-3)
    for tolerance in (0.0, -1.0, np.inf, np.nan):
        with pytest.raises(InvalidOption, match="tolerance"):
            path_nearness(motion, np.zeros((2, 3)), tolerance)
