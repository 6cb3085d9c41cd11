"""Base placement: each candidate in its own surroundings, the best one first."""

import numpy as np
import pytest

from kinematics.errors import InvalidOption, InvalidPose
from kinematics.pose import inverse, rotation_x, rotation_z, transform
from obstacles.collision.fcl_distance import FclWorld
from obstacles.scenes.scene import Obstacle, Scene
from obstacles.shapes.shape import Box
from planning.reach.evaluation import ReachOptions, moved, place_base
from planning.values.deadline import Deadline
from tests.planning.scenes import builtin

DOWN = rotation_x(np.pi)
TASKS = np.array([transform(DOWN, [x, y, 0.3]) for x in (0.9, 1.1) for y in (-0.3, 0.0, 0.3)])
WALL = Scene([Obstacle("wall", Box(np.array([0.1, 0.6, 1.0])), transform(None, [0.5, 0.0, 0.5]))])
BASES = np.array(
    [transform(None, [0.0, 0.0, 0.0]), transform(rotation_z(np.pi), [1.6, 0.0, 0.0]),
     transform(rotation_z(-np.pi / 2), [1.0, 0.55, 0.0])]
)  # fmt: skip
OPTIONS = ReachOptions(threads=1)


def test_the_best_base_reaches_most_and_is_proved_in_the_world_frame() -> None:
    robot = builtin("ur5e")
    placements = place_base(robot, WALL, TASKS, BASES, OPTIONS)
    assert [item.score for item in placements] == sorted(
        (item.score for item in placements), reverse=True
    )
    best = placements[0]
    # The wall stands between the first candidate and the tasks.
    assert placements[-1].index == 0
    assert not placements[-1].reach.is_reached.all()
    assert best.reach.is_reached.all()
    world = FclWorld(robot, moved(WALL, inverse(best.T_world_base)))
    assert not any(world.collisions(q) for q in best.reach.joints)
    clearance, manipulability, limits = best.worst
    assert clearance == best.reach.clearance.min()
    assert manipulability == best.reach.manipulability.min()
    assert limits == best.reach.limit_distance.min()


def test_a_base_that_reaches_nothing_has_no_figures() -> None:
    far = place_base(builtin("ur5e"), WALL, TASKS, [transform(None, [9.0, 0, 0])], OPTIONS)[0]
    assert not far.reach.is_reached.any()
    assert np.isnan(far.worst).all()
    assert far.score[0] == 0.0


def test_moving_everything_changes_nothing() -> None:
    robot, T = builtin("ur5e"), transform(rotation_z(0.7), [0.4, -0.2, 0.1])
    here = place_base(robot, WALL, TASKS, BASES[:1], OPTIONS)[0]
    there = place_base(robot, moved(WALL, T), T @ TASKS, T @ BASES[:1], OPTIONS)[0]
    assert there.reach.status.tolist() == here.reach.status.tolist()
    assert there.worst == pytest.approx(here.worst, abs=1e-6, nan_ok=True)


def test_candidates_after_the_deadline_are_left_out() -> None:
    assert not place_base(builtin("ur5e"), WALL, TASKS, BASES, deadline=Deadline.after(0.0))


def test_nonsense_is_refused() -> None:
    with pytest.raises(InvalidOption, match="no candidate"):
        place_base(builtin("ur5e"), WALL, TASKS, np.zeros((0, 4, 4)))
    with pytest.raises(InvalidPose):
        place_base(builtin("ur5e"), WALL, TASKS, np.eye(4))
