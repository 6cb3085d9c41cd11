"""Durations that are asked for: exact or at least, in retimed paths and in plans."""

import numpy as np
import pytest

import armwright as aw
from kinematics.errors import InvalidOption
from planning.timing.options import TimingFailed

POINTS = np.array([[0.0, 0.0], [1.0, 0.2], [1.2, 1.0], [0.3, 1.4]])
LIMITS = {"velocity": [1.0, 1.5], "acceleration": [4.0, 3.0], "jerk": [40.0, 30.0]}
HOME = np.array([0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785])
ASIDE = np.array([0.6, -0.3, 0.0, -2.0, 0.0, 1.8, 0.785])


@pytest.mark.parametrize("method", [None, "toppra", "jerk_limited", "spline"])
def test_a_path_takes_as_long_as_asked(method: str | None) -> None:
    def retimed(duration: float | None = None, *, at_least: bool = False) -> aw.Retimed:
        options = aw.TimingOptions(method, duration=duration, at_least=at_least)  # type: ignore[arg-type]
        return aw.retime(POINTS, limits=LIMITS, timing_options=options)

    fast = retimed().trajectory
    for factor in (1.0, 1.0 + 1e-15, 1.37, 20.0):
        duration = factor * fast.duration
        found = retimed(duration)
        assert found.trajectory.duration == duration
        assert found.certificate.verified
        # The same way at another pace.
        at = np.linspace(0.0, 1.0, 50)
        np.testing.assert_allclose(
            found.trajectory.sample(at * duration), fast.sample(at * fast.duration), atol=1e-9
        )
    with pytest.raises(TimingFailed, match="within its limits") as refused:
        retimed(0.9 * fast.duration)
    assert refused.value.details["least_duration"] == pytest.approx(fast.duration)
    assert retimed(0.9 * fast.duration, at_least=True).trajectory.duration == fast.duration
    longer = 1.1 * fast.duration
    assert retimed(longer, at_least=True).trajectory.duration == longer


def test_a_plan_takes_as_long_as_asked() -> None:
    robot = aw.load_robot("panda")
    post = aw.Obstacle("post", aw.Box((0.05, 0.05, 0.3)), aw.pose([0.45, 0.12, 0.45]))

    def planned(scene: aw.Scene, **timing: float) -> aw.Plan:
        options = aw.Options(timing=aw.TimingOptions(**timing))  # type: ignore[arg-type]
        found = aw.plan(robot, scene, HOME, ASIDE, options)
        assert isinstance(found, aw.Plan)
        assert found.certificate.verified
        return found

    for scene in (aw.Scene(), aw.Scene([post])):
        least = planned(scene).trajectory.duration
        assert planned(scene, duration=3.0).trajectory.duration == 3.0
        assert planned(scene, duration=0.1, at_least=True).trajectory.duration == least
    short = aw.Options(timing=aw.TimingOptions(duration=0.1))
    refused = aw.plan(robot, aw.Scene(), HOME, ASIDE, short)
    assert isinstance(refused, aw.Failure)
    assert refused.stage == "timing"
    assert "timing.duration is 0.1 s" in refused.message


def test_a_robot_that_stays_does_so_as_long_as_asked() -> None:
    options = aw.TimingOptions(duration=2.5)
    found = aw.retime(POINTS[[0, 0]], limits=LIMITS, timing_options=options)
    assert found.trajectory.duration == 2.5


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ({"duration": 0.0}, "timing.duration is 0"),
        ({"duration": np.inf}, "timing.duration is inf"),
        ({"at_least": True}, "needs timing.duration"),
        ({"duration": 1.0, "start_velocity": (0.1, 0.0)}, "timing.start_velocity"),
        ({"duration": 1.0, "method": "spline", "times": (0.0, 1.0)}, "timing.times"),
    ],
)
def test_durations_that_mean_nothing_are_refused(given: dict[str, object], says: str) -> None:
    with pytest.raises(InvalidOption, match=says):
        aw.TimingOptions(**given)  # type: ignore[arg-type]


def test_tool_motions_take_their_speed() -> None:
    robot = aw.load_robot("panda")
    goal = aw.fk(robot, HOME)
    goal[2, 3] -= 0.05
    options = aw.Options(planner="cartesian", timing=aw.TimingOptions(duration=5.0))
    with pytest.raises(InvalidOption, match="tool"):
        aw.plan(robot, aw.Scene(), HOME, goal, options)
