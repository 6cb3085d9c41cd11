"""Plans that are asked for stops: slowed down as little as these need, or refused."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import armwright as aw
from kinematics.pose import transform
from kinematics.robots import builtin_urdf
from obstacles.scenes.scene import Obstacle, Scene
from obstacles.shapes.shape import Box
from planning.options import Options
from planning.pipeline.pipeline import plan
from planning.pipeline.stoppable import with_stops
from planning.problem import JointGoal, Problem
from planning.result import Failure, Plan
from planning.stops.certificate import certify_stops
from planning.timing.options import TimingOptions
from planning.values.deadline import Deadline
from tests.planning.scenes import HOME, builtin, planned_motion
from tests.planning.stops.judge import Brakes, CoalArm

#: Brakes that need half a radian from full speed.
WEAK = {"acceleration": np.full(7, 3.0), "jerk": np.full(7, 300.0)}


def around_a_slab(**changes: Any) -> Problem:
    """The arm lowers its hand behind a slab that it would hit if it braked later."""
    goal = np.array([0.9, 0.4, 0.0, -1.9, 0.0, 2.3, 0.785])
    slab = Obstacle("slab", Box((0.4, 0.04, 0.5)), transform(None, (0.5, 0.12, 0.25)))
    return Problem(builtin("panda"), Scene((slab,)), HOME, (JointGoal(goal),), **changes)


def test_nothing_is_proved_of_stops_unless_asked() -> None:
    found = planned_motion(around_a_slab(), Options(limits=WEAK))
    assert found.stops is None
    assert "stops" not in [stage.name for stage in found.stages]


def test_a_motion_that_can_be_stopped_is_not_slowed_down() -> None:
    free = replace(around_a_slab(), scene=Scene())
    plain = planned_motion(free, Options(limits=WEAK))
    for kind in ("path", "joints", "both"):
        found = planned_motion(free, Options(limits=WEAK, stops=kind))
        assert found.stops is not None
        assert found.stops.proved
        assert found.stops.slowed == 0.0
        assert found.trajectory == plain.trajectory


@pytest.fixture(scope="module")
def slowed() -> tuple[Plan, Plan]:
    """A plan whose joints can't brake in time, and what is made of it."""
    for seed in range(30):
        plain = plan(around_a_slab(), Options(limits=WEAK, seed=seed))
        assert isinstance(plain, Plan)
        assert plain.surroundings is not None
        stops = certify_stops(plain.trajectory, plain.certificate, plain.surroundings, "joints")
        if not stops.proved:
            return plain, planned_motion(
                around_a_slab(), Options(limits=WEAK, seed=seed, stops="both")
            )
    raise AssertionError("all seeds brake in time")


def test_a_motion_is_slowed_down_until_its_stops_are_proved(slowed: tuple[Plan, Plan]) -> None:
    plain, found = slowed
    assert found.certificate.verified
    assert found.stops is not None
    assert found.stops.proved
    assert found.stops.slowed == pytest.approx(
        found.trajectory.duration - plain.trajectory.duration, abs=1e-9
    )
    assert found.stops.slowed > 0.0
    np.testing.assert_allclose(found.trajectory.end, plain.trajectory.end, atol=1e-9)
    assert found.stages[-1].name == "stops"
    assert "slowed down" in found.stages[-1].detail


def test_the_slow_motion_stops_in_time_by_ruckig_and_coal(slowed: tuple[Plan, Plan]) -> None:
    coal = CoalArm(builtin_urdf("panda"), builtin("panda"), around_a_slab().scene)
    plain, found = slowed
    touches = []
    for one in (plain, found):
        assert one.surroundings is not None
        starts = np.linspace(0.0, one.trajectory.duration, 1000)
        states, _ = Brakes(one.surroundings.braking).stops(one.trajectory, starts, 8)
        touches.append(coal.overlaps(states.reshape(-1, 7)).any())
    assert touches == [True, False]


def test_a_stop_of_a_plan_is_a_proved_motion(slowed: tuple[Plan, Plan]) -> None:
    plain, found = slowed
    for kind in ("path", "joints"):
        for at in np.linspace(0.0, found.trajectory.duration, 12):
            stop = aw.stop(found, float(at), kind)
            assert stop.certificate.verified, stop.certificate.violation
            assert (stop.kind, stop.at) == (kind, at)
    stops = aw.certify_stops(plain, "joints")
    assert not stops.proved
    met = aw.stop(plain, stops.worst.time, "joints")
    assert met.certificate.violation is not None
    assert met.certificate.violation.kind == "collision"
    assert met.certificate.violation.time <= stops.worst.after + 1e-9


def test_a_motion_that_can_not_be_slowed_down_is_refused(slowed: tuple[Plan, Plan]) -> None:
    """As one whose start moves: slower it would be another start."""
    plain, _ = slowed
    assert plain.surroundings is not None
    answer = with_stops(
        (plain.trajectory, plain.certificate),
        plain.surroundings,
        Options(stops="joints"),
        Deadline.after(20.0),
        None,
    )
    assert isinstance(answer, Failure)
    assert (answer.code, answer.stage) == ("INVALID_MOTION_PLAN", "stops")
    stops = aw.certify_stops(plain, "joints")
    assert answer.details["time"] == stops.worst.time
    assert answer.details["pair"] == list(stops.worst.pair or ())
    assert stops.message in answer.message
    assert "velocity_scaling" in answer.hint


def test_wrong_questions_are_refused(slowed: tuple[Plan, Plan]) -> None:
    _, found = slowed
    for at in (-0.1, found.trajectory.duration + 0.1, float("nan")):
        with pytest.raises(aw.ArmwrightError, match="outside the motion"):
            aw.stop(found, at)
    with pytest.raises(aw.ArmwrightError, match="kind"):
        aw.stop(found, 0.1, "both")  # type: ignore[arg-type]
    with pytest.raises(aw.ArmwrightError, match="stops of kind 'brake'"):
        Options(stops="brake")  # type: ignore[arg-type]
    with pytest.raises(aw.ArmwrightError, match="does not know"):
        aw.stop(replace(found, surroundings=None), 0.1)


def test_a_timed_path_tells_of_its_longest_stop() -> None:
    limits = {"velocity": [1.0, 1.0], "acceleration": [4.0, 4.0]}
    how = TimingOptions("toppra")
    timed = aw.retime([[0.0, 0.0], [1.0, 1.0]], timing_options=how, limits=limits, stops="path")
    assert timed.stops is not None
    assert timed.stops.longest == pytest.approx(0.25, abs=0.02)
    with pytest.raises(aw.ArmwrightError, match="leave the path"):
        aw.retime([[0.0, 0.0], [1.0, 1.0]], limits=limits, stops="both")
