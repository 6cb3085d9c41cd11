"""Straight motions: forwards, backwards, and how they end."""

import numpy as np
import pytest

import armwright as aw
from kinematics.forward import forward
from planning.sequence.stage import Straight
from planning.sequence.step import Line, LineStopped, lead_straight
from planning.sequence.world import Cells
from planning.timing.path.path import JointPath
from planning.values.deadline import Deadline
from tests.planning.sequence import crate

SOON = Deadline.after(1e6)


def test_a_joint_path_backwards_passes_the_same_places() -> None:
    random = np.random.default_rng(1)
    path = JointPath(random.normal(size=(3, 2, 4)), np.array([0.2, 0.5, 0.3]))
    back = path.reverse()
    for piece in range(3):
        u = np.linspace(0.0, path.lengths[piece], 7)
        powers = u[:, None] ** np.arange(4)
        reversed_u = (path.lengths[piece] - u)[:, None] ** np.arange(4)
        there = powers @ path.coefficients[piece].T
        again = reversed_u @ back.coefficients[2 - piece].T
        np.testing.assert_allclose(there, again, atol=1e-12)


@pytest.mark.parametrize(("kind", "sign"), [("approach", -1.0), ("retreat", 1.0)])
def test_an_approach_ends_and_a_retreat_begins_at_the_configuration(kind: str, sign: float) -> None:
    cell = Cells().cell(crate.world())
    stage = Straight(kind, [0, 0, 1], "tool", 0.05, 0.1)  # type: ignore[arg-type]
    led = lead_straight(cell, stage, crate.HOME, SOON)
    assert isinstance(led, Line)
    fixed, other = (led.end, led.start) if kind == "approach" else (led.start, led.end)
    np.testing.assert_array_equal(fixed, crate.HOME)
    chain = crate.panda().chain
    T, T_other = forward(chain, fixed), forward(chain, other)
    np.testing.assert_allclose(T_other[:3, 3], T[:3, 3] + sign * 0.1 * T[:3, 2], atol=1e-5)
    np.testing.assert_allclose(T_other[:3, :3], T[:3, :3], atol=1e-4)
    points = led.path.segments[0].path
    assert points is not None
    np.testing.assert_allclose(points.sample([0.0])[0], led.start, atol=1e-12)
    np.testing.assert_allclose(points.sample([points.length])[0], led.end, atol=1e-12)


def test_a_motion_that_meets_something_is_as_long_as_it_can_be() -> None:
    tool = forward(crate.panda().chain, crate.HOME)[:3, 3]
    floor = aw.Obstacle("floor", aw.Box((0.2, 0.2, 0.02)), aw.pose([tool[0], 0.0, tool[2] - 0.12]))
    cell = Cells().cell(crate.world(floor))
    led = lead_straight(cell, Straight("lift", [0, 0, -1], "root", 0.02, 0.3), crate.HOME, SOON)
    assert isinstance(led, Line)
    assert 0.05 < led.distance < 0.12
    short = lead_straight(cell, Straight("lift", [0, 0, -1], "root", 0.2, 0.3), crate.HOME, SOON)
    assert isinstance(short, LineStopped)
    assert short.stop.reason == "collision"
    assert short.distance < 0.12
