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
from tests.planning.optimize.table import ROBOT, START, line, task

NONE = Scene()
SOON = Deadline.after(1e6)


def descent(height: float = 0.25, scene: Scene | None = None, **more: object) -> Descent:
    options = RefineOptions.of(more)
    asked = task() if scene is None else task(scene)
    return Descent(asked, options, line(height), np.inf, Deadline.after(60.0))


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
