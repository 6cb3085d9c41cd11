"""What is seen of a motion at checkpoints: distances in closed form, loads, constraints."""

from dataclasses import replace

import numpy as np
import pytest

from kinematics.arrays import Array
from obstacles.collision.checker import Checker
from obstacles.scenes.scene import Scene
from planning.constraints.constraint_set import ConstraintSet
from planning.constraints.kinds.constraint import JointConstraint
from planning.optimize.iterate import Iterate
from planning.optimize.linearization import (
    DEPTH,
    SHARE,
    Checkpoints,
    Linearization,
    least_factor,
    linearize,
)
from planning.optimize.rows import stack_rows
from planning.optimize.task import Task
from planning.values.deadline import Deadline
from planning.values.limits import EffortLimits
from tests.planning.optimize.table import BLOCK, ROBOT, gap, line, task

NONE = Scene()


def checkpoints(at: Iterate, spare: float = 0.0) -> Checkpoints:
    return Checkpoints.uniform(at.space.breaks, 3, spare)


def see(asked: Task, at: Iterate, reach: float = 0.3, spare: float = 0.0) -> Linearization:
    return linearize(asked, at, checkpoints(at, spare), reach, Deadline.after(60.0))


def unknowns(at: Iterate, slack: float = 0.0) -> Array:
    return np.append(at.points.ravel(), [at.duration, slack])


@pytest.mark.parametrize(("height", "inside"), [(0.02, True), (0.12, True), (0.2, False)])
def test_the_violation_is_the_deepest_overlap(height: float, inside: bool) -> None:
    at = line(height)
    depth = -float(gap(at.sample(checkpoints(at).at)).min())
    found = see(task(), at)
    assert (depth > 0.0) is inside
    assert found.violation == pytest.approx(max(depth, 0.0) / DEPTH, abs=1e-6)
    if inside:
        assert found.obstruction is not None
        assert found.obstruction.message.startswith("'ball' and 'block' are closer than")
        assert f"{depth:.4g} m" in found.obstruction.message
    else:
        assert found.obstruction is None


def test_a_margin_makes_a_near_pass_a_violation_and_spare_does_not() -> None:
    at = line(0.17)
    least = float(gap(at.sample(checkpoints(at).at)).min())
    assert 0.0 < least < 0.03
    assert see(task(), at).violation == 0.0
    assert see(task(margin=0.03), at).violation == pytest.approx((0.03 - least) / DEPTH, abs=1e-4)
    slack = replace(task(), checker=Checker(task().checker.model, 0.03))
    assert see(slack, at).violation == pytest.approx((0.03 - least) / DEPTH, abs=1e-4)
    assert see(task(), at, spare=0.03).violation == 0.0


@pytest.mark.parametrize("spare", [0.0, 0.01])
def test_rows_of_distances_have_their_room_and_slopes(spare: float) -> None:
    at, rng = line(0.16), np.random.default_rng(0)
    found = see(task(), at, spare=spare)
    rows = stack_rows(found.rows)
    z = unknowns(at)
    room = np.sort(rows.upper - rows.A @ z)
    samples = at.sample(checkpoints(at).at)
    distances = gap(samples) - spare
    # Those that the trust region can bring to contact: half of it in either slide.
    assert 0 < len(room) < len(samples)
    np.testing.assert_allclose(room, np.sort(distances)[: len(room)], atol=1e-6)
    # A small step changes every room by what its row says.
    step = np.append(1e-6 * rng.normal(size=len(z) - 2), [0.0, 0.0])
    moved = Iterate(at.space, at.points + step[:-2].reshape(at.points.shape), at.duration)
    again = stack_rows(see(task(), moved, spare=spare).rows)
    before, after = rows.upper - rows.A @ (z + step), again.upper - again.A @ unknowns(moved)
    np.testing.assert_allclose(np.sort(before), np.sort(after), atol=1e-9)


def test_when_time_is_up_nothing_good_is_known() -> None:
    at = line()
    late = linearize(task(NONE), at, checkpoints(at), 0.3, Deadline.after(-1.0))
    assert late.violation == np.inf
    assert late.obstruction is not None
    assert "time was up" in late.obstruction.message


@pytest.mark.parametrize("speed", [0.2, 5.0])
def test_the_tools_speed_is_violated_by_its_share(speed: float) -> None:
    at = line(0.02, duration=2.0)
    loads = EffortLimits(ROBOT.chain, tool_speed=speed)
    asked = task(NONE, loads)
    fastest = np.linalg.norm(at.sample(checkpoints(at).at, 1) / 2.0, axis=1).max()
    found = see(asked, at)
    over = max(fastest / speed - 1.0, 0.0)
    assert found.violation == pytest.approx(over / SHARE, abs=1e-3)
    factor = least_factor(asked, at, checkpoints(at))
    assert factor == pytest.approx(fastest / (speed * 0.995), abs=1e-3)
    slower = replace(at, duration=2.0 * factor)
    assert see(asked, slower).violation == 0.0
    if over:
        assert found.obstruction is not None
        assert "the tool's speed" in found.obstruction.message


def test_rows_of_the_tools_speed_lie_on_the_safe_side_of_every_duration() -> None:
    at = line(0.02, duration=2.0)
    asked = task(NONE, EffortLimits(ROBOT.chain, tool_speed=0.7))
    rows = stack_rows(see(asked, at).rows)
    for T in np.linspace(0.5, 6.0, 40):
        other = replace(at, duration=float(T))
        if (rows.A @ unknowns(other) <= rows.upper).all():
            speeds = np.linalg.norm(other.sample(checkpoints(at).at, 1) / T, axis=1)
            assert speeds.max() <= 0.7


def test_the_worst_of_all_is_told() -> None:
    """Block, constraint and tool speed are violated: by 4, by 2 and by 30 of their units."""
    at = line(0.11, duration=0.3)
    held = ConstraintSet(ROBOT.chain, (JointConstraint("jy", 0.0, 0.09, 0.5),))
    asked = replace(task(BLOCK, EffortLimits(ROBOT.chain, tool_speed=1.0)), constraints=held)
    found = see(asked, at)
    assert found.obstruction is not None
    assert "the tool's speed" in found.obstruction.message
    alone = see(replace(asked, loads=None), at)
    assert alone.obstruction is not None
    assert "block" in alone.obstruction.message
    assert found.violation > alone.violation > 1.0
    assert len(found.rows) == 3
