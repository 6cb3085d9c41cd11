"""Rounds of the optimisation on a table: what is kept, refused, shrunk and told."""

from dataclasses import replace

import numpy as np
import pytest

from obstacles.scenes.scene import Scene
from planning.optimize.scp import Descent
from planning.optimize.task import End
from planning.values.deadline import Deadline
from planning.values.limits import EffortLimits
from planning.values.optimize_options import RefineOptions
from tests.planning.optimize.table import BOUNDS, GOAL, ROBOT, START, gap, line, task

NONE = Scene()
SOON = Deadline.after(1e6)


def descent(height: float = 0.25, scene: Scene | None = None, **more: object) -> Descent:
    options = RefineOptions.of(more)
    asked = task() if scene is None else task(scene)
    return Descent(asked, options, line(height), np.inf, Deadline.after(60.0))


def test_rounds_bring_a_motion_out_of_the_block_and_make_it_fast() -> None:
    work = descent(0.06)
    work.run(SOON)
    assert work.best is not None
    motion = work.best.trajectory
    times = np.linspace(0.0, motion.duration, 4001)
    assert gap(motion.sample(times)).min() > 0.0
    np.testing.assert_allclose(motion.sample([0.0])[0], START, atol=1e-12)
    np.testing.assert_allclose(motion.end, GOAL, atol=1e-9)
    for order, limits in ((1, BOUNDS["velocity"]), (2, BOUNDS["acceleration"])):
        assert (np.abs(motion.sample(times, order)).max(axis=0) <= limits * (1.0 + 1e-9)).all()
    # 1.2 m at 1 m/s and 2 m/s^2 take 1.7 s in a straight line; the way round bends little more.
    assert 1.7 <= motion.duration < 1.85


@pytest.mark.parametrize("rounds", [1, 2])
def test_no_more_rounds_are_run_than_allowed(rounds: int) -> None:
    work = descent(0.3, rounds=rounds)
    work.run(SOON)
    assert work.rounds <= rounds
    before = work.rounds
    work.run(SOON)
    assert work.rounds == before
    work.add_rounds(1)
    assert work.most_rounds == before + 1


def test_a_rejected_motion_is_out_and_its_place_is_looked_at_with_more_to_spare() -> None:
    work = descent(0.2)
    count = len(work.places.at)
    work.reject(0.4)
    assert work.best is None
    assert len(work.places.at) == count + 1
    assert work.places.at[-1] == 0.4
    near = np.abs(work.places.at[:-1] - 0.4) < 0.5 / work.iterate.space.pieces
    assert near.any()
    assert work.places.spare[:-1][near].min() == 2.0 * work.places.spare[:-1][~near].max()
    work.run(SOON)
    assert work.best is not None


def test_a_duration_that_only_the_optimised_motion_keeps_is_reached() -> None:
    """The first motion takes twice as long as it may, the best one less."""
    first = Descent(task(NONE), RefineOptions(), line(0.02), np.inf, Deadline.after(60.0))
    assert first.iterate.duration > 2.0 * 1.9
    for weights in ({"time": 1.0}, {"path_length": 1.0}):
        options = RefineOptions.of({"objective": weights})
        work = Descent(task(NONE), options, line(0.02), 1.9, Deadline.after(60.0))
        work.run(SOON)
        assert work.best is not None, work.obstruction
        assert work.best.trajectory.duration <= 1.9 * (1.0 + 1e-9)


@pytest.mark.parametrize(
    ("speed", "tool_speed", "words"),
    [
        (0.5, 0.4, ("the tool's speed", "1.25 times its limit")),
        (1.5, None, ("of joint 'jx' is", "times its limit")),
    ],
)
def test_a_limit_that_the_start_exceeds_is_told_by_its_name(
    speed: float, tool_speed: float | None, words: tuple[str, str]
) -> None:
    moving = End(START, np.array([speed, 0.0]))
    loads = None if tool_speed is None else EffortLimits(ROBOT.chain, tool_speed=tool_speed)
    asked = replace(task(NONE, loads), start=moving)
    at = line(0.02, duration=5.0).with_ends(moving, asked.end)
    work = Descent(asked, RefineOptions(rounds=2), at, np.inf, Deadline.after(60.0))
    assert work._candidate(at) is None
    assert work.obstruction is not None
    assert all(word in work.obstruction.message for word in words)
