"""What a straight motion lacks to the margins, against FCL's distances."""

from itertools import pairwise

import numpy as np
import pytest

from compiled.kernel import kernel
from kinematics.arrays import Array
from obstacles.collision.checker import Checker
from obstacles.collision.fcl_distance import FclWorld
from obstacles.collision.model.collision_model import ModelArrays
from obstacles.collision.model.kernel_work import workspace
from obstacles.collision.proximity import line_deficit
from obstacles.scenes.scene import Scene
from tests.planning.scenes import box, builtin

PREFERRED, SPACING = 0.3, 0.2
SCENE = Scene(
    (box("bar", (0.1, 1.0, 0.1), (1.3, 0.0, 0.4)), box("post", (0.1, 0.1, 0.6), (-1.2, 0.0, 0.3)))
)


@kernel
def shortfall_on(model: ModelArrays, a: Array, b: Array, spacing: float, most: float) -> float:
    return line_deficit(model, workspace(model), a, b, spacing, most)


def lines(count: int) -> Array:
    return np.random.default_rng(3).uniform(-2.5, 2.5, (count + 1, 2))


def test_it_is_the_mean_of_what_the_distances_lack() -> None:
    robot = builtin("planar_rr")
    model = Checker.of(robot, SCENE, PREFERRED).model.with_margins(PREFERRED, 0.0).arrays
    world, told, expected = FclWorld(robot, SCENE), [], []
    for a, b in pairwise(lines(40)):
        parts = max(1, int(np.ceil(np.linalg.norm(b - a) / SPACING)))
        states = a + ((np.arange(parts) + 0.5) / parts)[:, None] * (b - a)
        nearest = np.array([max(world.clearance(q).distance, 0.0) for q in states])
        if not (nearest > 0.0).all():
            continue  # how deep things overlap is not told exactly
        expected.append(np.maximum(PREFERRED - nearest, 0.0).mean())
        told.append(shortfall_on(model, a, b, SPACING, np.inf))
    assert len(told) > 10
    assert max(told) > 0.05
    np.testing.assert_allclose(told, expected, atol=1e-6)


@pytest.mark.parametrize("share", [0.5, 0.99])
def test_more_than_asked_for_is_infinite(share: float) -> None:
    model = Checker.of(builtin("planar_rr"), SCENE, PREFERRED).model.arrays
    for a, b in pairwise(lines(20)):
        lacks = shortfall_on(model, a, b, SPACING, np.inf)
        if lacks > 0.0:
            assert shortfall_on(model, a, b, SPACING, share * lacks) == np.inf
            assert shortfall_on(model, a, b, SPACING, lacks / share) == lacks


def test_a_spacious_motion_lacks_nothing() -> None:
    model = Checker.of(builtin("planar_rr"), Scene(), PREFERRED).model.arrays
    a, b = lines(1)
    assert shortfall_on(model, a, b, SPACING, 0.0) == 0.0
