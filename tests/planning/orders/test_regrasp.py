"""Objects that are put down and grasped again, by the library."""

import numpy as np
import pytest

import armwright as aw
from kinematics.errors import InvalidOption
from planning.sequence.result import SequenceFailure, SequencePlan, TaskOptions
from planning.sequence.stage import Grasp, Place, Stage
from tests.planning.sequence import crate


def halves() -> tuple[list[Stage], list[Stage]]:
    """The crate grasped from above, and put down on another of its sides."""
    stages = crate.stages(crate.grasps(4))
    lying = aw.pose([*crate.PLACE, 0.125]) @ aw.pose([0, 0, 0], [0, np.sqrt(0.5), 0, np.sqrt(0.5)])
    turns = np.array([aw.pose([0, 0, 0], [0, 0, np.sin(a), np.cos(a)]) for a in (0.0, 0.8, 1.6)])
    poses = np.tile(lying, (3, 1, 1))
    poses[:, :3, :3] = turns[:, :3, :3] @ lying[:3, :3]
    return list(stages[:6]), [*stages[6:8], Place(None, poses, support="table"), *stages[9:]]


def test_what_no_grasp_from_above_turns_over_is_put_down_and_taken_from_the_side() -> None:
    first, last = halves()
    world, home = crate.world(), crate.HOME
    alone = aw.plan_work(world, home, [*first, *last], TaskOptions(60.0))
    assert isinstance(alone, SequenceFailure)
    places = aw.resting_places(aw.Box((0.05, 0.05, 0.1)), [crate.scene().obstacle("table")], (3, 5))
    on_this_side = places[(places[:, 1, 3] < -0.1) & (np.abs(places[:, 2, 2]) > 0.9)]
    side = np.array([[0, 0, 1, 0], [0, 1, 0, 0], [-1, 0, 0, 0], [0, 0, 0, 1.0]])
    sides = aw.grasp_region(side, (0.0, 0.0, 1.0), (0.0, 2.0 * np.pi), samples=(12, 1))
    grasps = np.concatenate([sides, crate.grasps(4)])
    again = aw.regrasp(first, on_this_side, ["table"], grasps, distance=(0.02, 0.05))
    found = aw.plan_work(world, home, [*first, again, *last], TaskOptions(120.0))
    assert isinstance(found, SequencePlan), found
    assert [one.kind for one in found.stages].count("grasp") == 2
    assert all(one.certificate.verified for one in found.stages)
    T = found.stages[-1].after.scene.obstacle("crate").T_world_obstacle
    np.testing.assert_allclose(np.abs(T[2, 0]), 1.0, atol=1e-9)


def test_nothing_is_grasped_again_that_is_not_held() -> None:
    first, _ = halves()
    grasp = next(k for k, one in enumerate(first) if isinstance(one, Grasp))
    for stages in (first[:grasp], first[: grasp + 1]):
        with pytest.raises(InvalidOption, match="nothing is grasped and attached before it"):
            aw.regrasp(stages, np.eye(4)[None])
