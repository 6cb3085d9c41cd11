"""The descent in Python takes the steps of the kernel; with FCL's projections it is proved too."""

from dataclasses import replace

import numpy as np
import pytest

from kinematics.errors import InvalidOption
from obstacles.collision.checker import Checker
from obstacles.projection.projection import Projector
from obstacles.scenes.scene import Scene
from planning.field import planner as planner_module
from planning.field.options import PRESETS, FieldOptions
from planning.field.planner import potential_field
from planning.values.deadline import Deadline
from tests.planning.field.test_planner import POST, turned
from tests.planning.scenes import HOME, box, builtin

WALL = Scene((box("wall", (0.2, 0.05, 0.4), (0.5, 0.2, 0.4)),))
CASES = {
    "notes": replace(PRESETS["notes"], max_iterations=40),
    "steps": FieldOptions(step_sizes=[0.02, 0.01], longest_step=1.0, max_iterations=12),
    "exact end": FieldOptions(connect=False, max_iterations=30),
    "escapes": replace(PRESETS["thorough"], escapes=3, max_iterations=60),
}


@pytest.mark.parametrize("scene", [POST, WALL], ids=["post", "wall"])
@pytest.mark.parametrize("case", list(CASES))
def test_with_the_same_projections_it_takes_the_steps_of_the_kernel(
    case: str, scene: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    robot = builtin("panda")
    checker = Checker.of(robot, scene)
    arguments = (robot, checker, scene, HOME, [turned()])
    kernel = potential_field(*arguments, CASES[case], 0, Deadline.after(60.0))
    monkeypatch.setattr(planner_module, "FclProjector", Projector)
    options = replace(CASES[case], engine="fcl")
    python = potential_field(*arguments, options, 0, Deadline.after(60.0))
    assert python.iterations == kernel.iterations
    assert python.detail == kernel.detail
    np.testing.assert_allclose(python.visited, kernel.visited, atol=1e-9)
    np.testing.assert_allclose(python.potentials, kernel.potentials, rtol=1e-9)
    assert (python.waypoints is None) == (kernel.waypoints is None)


@pytest.mark.parametrize("preset", list(PRESETS))
def test_with_projections_by_fcl_every_step_is_proved_and_ends_at_the_goal(preset: str) -> None:
    robot, goal = builtin("panda"), turned()
    checker = Checker.of(robot, POST)
    options = replace(PRESETS[preset], engine="fcl")
    descent = potential_field(robot, checker, POST, HOME, [goal], options, 0, Deadline.after(60.0))
    assert descent.waypoints is not None, descent.detail
    assert np.array_equal(descent.waypoints[0], HOME)
    assert np.array_equal(descent.waypoints[-1], goal)
    assert checker.polyline(descent.waypoints)[0].free


def test_it_stops_in_time() -> None:
    robot = builtin("panda")
    checker = Checker.of(robot, POST)
    options = FieldOptions(engine="fcl", max_iterations=100_000, connect=False, tolerance=1e-9)
    descent = potential_field(
        robot, checker, POST, HOME, [turned()], options, 0, Deadline.after(0.002)
    )
    assert descent.waypoints is None
    assert descent.detail == "The time was up."


def test_there_are_two_engines() -> None:
    with pytest.raises(InvalidOption) as refused:
        FieldOptions.of({"engine": "bullet"})
    assert refused.value.message == "planner_options.engine can't be 'bullet'"
    assert refused.value.hint == "Choose one of: exact, fcl."
