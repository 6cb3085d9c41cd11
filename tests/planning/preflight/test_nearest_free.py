"""Free configurations near others, against closed forms of a ball that slides, and FCL."""

import numpy as np
import pytest

from obstacles.collision.checker import Checker
from obstacles.collision.fcl_distance import FclWorld
from obstacles.scenes.scene import Scene
from planning.options import Options
from planning.pipeline.pipeline import plan
from planning.preflight.nearest_free import nearest_free
from planning.problem import JointGoal, Problem
from planning.result import Failure, Plan
from tests.planning.scenes import box, builtin, shelf
from tests.planning.slider import slider


@pytest.mark.parametrize("case", range(12))
def test_the_nearest_free_place_of_a_ball_in_a_box(case: int) -> None:
    """Out of a box by its nearest face: 5 cm and what is asked for beyond it."""
    random = np.random.default_rng(case)
    half = random.uniform(0.05, 0.2, 2)
    center = random.uniform(-0.3, 0.3, 2)
    crate = box("crate", (2 * half[0], 2 * half[1], 0.4), (center[0], center[1], 0.0))
    q = center + random.uniform(-0.9, 0.9, 2) * half
    checker = Checker.of(slider(), Scene((crate,)))
    found = nearest_free(checker, q, seed=case)
    assert found is not None
    out = float((half - np.abs(q - center)).min()) + 0.05
    assert found.distance == pytest.approx(out, abs=4e-3)
    assert found.distance >= out
    assert found.tip_distance == pytest.approx(found.distance)
    assert found.clearance > 0.0
    np.testing.assert_allclose(found.distance, np.linalg.norm(found.joints - q))


@pytest.mark.parametrize("case", range(12))
def test_free_configurations_of_an_arm(case: int) -> None:
    robot, scene = builtin("panda"), shelf()
    checker = Checker.of(robot, scene, 0.005)
    low, high = robot.chain.sampling_bounds()
    random = np.random.default_rng(case)
    q = next(q for q in random.uniform(low, high, (200, 7)) if not checker.valid(q))
    found = nearest_free(checker, q, seed=3)
    assert found is not None
    assert ((found.joints >= low) & (found.joints <= high)).all()
    clearance = FclWorld(robot, scene).clearance(found.joints)
    assert clearance.distance > 0.0
    again = nearest_free(checker, q, seed=3)
    assert again is not None
    np.testing.assert_array_equal(again.joints, found.joints)


def test_a_start_in_collision_tells_where_it_would_be_free() -> None:
    robot, scene = slider(), Scene((box("crate", (0.2, 0.2, 0.2), (0.0, 0.0, 0.0)),))
    away = JointGoal(np.array([0.5, 0.5]))
    problem = Problem(robot, scene, np.array([0.09, 0.0]), (away,))
    answer = plan(problem, Options())
    assert isinstance(answer, Failure)
    nearest = answer.details["nearest_valid"]
    assert nearest["joints"] == pytest.approx([0.151, 0.0], abs=2e-3)
    assert nearest["distance"] == pytest.approx(0.061, abs=2e-3)
    mended = Problem(robot, scene, np.array(nearest["joints"]), (away,))
    assert isinstance(plan(mended, Options()), Plan)
