"""Plans timed by every method: certified, within limits, at rest at both ends."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from benchmarks.judges.ratios import worst_ratio
from kinematics.errors import InvalidOption, MissingLimit
from kinematics.trajectory.trajectory import Trajectory
from obstacles.collision.checker import Checker
from obstacles.scenes.scene import Scene
from planning.options import Options
from planning.pipeline import pipeline
from planning.pipeline.pipeline import plan
from planning.problem import JointGoal, Problem
from planning.proof import certificate
from planning.proof.certificate import Certificate
from planning.proof.limits.limit_uses import Violation
from planning.result import Failure, Plan
from planning.timing import motion_timing
from planning.timing.options import Payload, TimingOptions
from planning.values.optimize_options import RefineOptions
from tests.planning.scenes import HOME, builtin, pillar, planned_motion, shelf

#: In the straight line's way.
POST = pillar(0.6, 0.505)
ASIDE = np.array([1.2, -0.3, 0.0, -2.0, 0.0, 1.8, 0.785])


def planned(scene: Scene, limits: dict[str, Any] | None = None, **timing: Any) -> Plan | Failure:
    problem = Problem(builtin("panda"), scene, HOME, (JointGoal(ASIDE),))
    options = Options(timing=TimingOptions(**timing), limits=limits or {}, timeout=30.0)
    return plan(problem, options)


@pytest.mark.parametrize("scene", [POST, Scene()])
@pytest.mark.parametrize(
    ("load", "limits"),
    [
        ("torque", {"torque_limits": True, "payload": Payload(1.0)}),
        ("tool_speed", {"tool_speed": 1.04}),
    ],
)
def test_loads_that_hardly_slow_a_motion_down_leave_it_few_pieces(
    scene: Scene, load: str, limits: dict[str, Any]
) -> None:
    answer, free = planned(scene, **limits), planned(scene)
    assert isinstance(answer, Plan)
    assert isinstance(free, Plan)
    assert answer.timing is not None
    assert answer.timing.solver in ("quintic_spline", "interior_point")
    assert answer.trajectory.pieces <= 20
    assert answer.certificate.limits[load].worst_ratio <= 1.0 + 1e-9
    assert answer.trajectory.duration <= 1.1 * free.trajectory.duration
    chain = builtin("panda").chain
    for order, bound in enumerate((chain.limits.velocity, chain.limits.acceleration), 1):
        assert worst_ratio(answer.trajectory, bound, order) <= 1.0 + 1e-9


def test_a_tool_speed_that_slows_a_motion_down_is_kept_where_it_binds_alone() -> None:
    answer = planned(POST, tool_speed=0.5)
    assert isinstance(answer, Plan)
    assert answer.timing is not None
    assert answer.timing.solver == "quintic_spline"
    assert answer.trajectory.pieces <= 20
    assert 0.95 <= answer.certificate.limits["tool_speed"].worst_ratio <= 1.0 + 1e-9
    exact = planned(POST, method="jerk_limited", tool_speed=0.5)
    assert isinstance(exact, Plan)
    assert exact.certificate.limits["tool_speed"].worst_ratio >= 0.99
    assert answer.trajectory.duration <= 1.06 * exact.trajectory.duration


@pytest.mark.parametrize("method", ["toppra", "spline", "jerk_limited"])
def test_every_method_gives_certified_motions(method: str) -> None:
    limits = builtin("panda").chain.limits
    answer = planned(POST, method=method, torque_limits=True, payload=Payload(1.0))
    assert isinstance(answer, Plan), answer
    assert len(answer.path.waypoints) > 2
    certificate, motion = answer.certificate, answer.trajectory
    assert certificate.verified
    assert certificate.limits["torque"].worst_ratio <= 1.0 + 1e-9
    bounds = [limits.velocity, limits.acceleration, limits.jerk]
    for order, bound in enumerate(bounds[: 2 if method == "toppra" else 3], 1):
        assert worst_ratio(motion, bound, order) <= 1.0 + 1e-9
    np.testing.assert_allclose(motion.sample([0.0, motion.duration], 1), 0.0, atol=1e-9)
    if method != "toppra":
        assert motion.continuity().acceleration < 1e-6
        assert certificate.limits["jerk"].worst_ratio > 0.0
    else:
        assert "jerk" not in certificate.limits


def test_the_toppra_package_times_plans_and_tells_what_that_cost() -> None:
    package = planned(POST, solver="toppra")
    assert isinstance(package, Plan)
    assert package.certificate.verified
    assert [note for note in package.notes if "toppra's answer" in note]
    problem = Problem(builtin("panda"), Scene(), HOME, (JointGoal(ASIDE),))
    refined = Options(timing=TimingOptions(solver="toppra"), refine=RefineOptions())
    with pytest.raises(InvalidOption, match=r"timing\.solver"):
        plan(problem, refined)


def test_splines_take_the_times_given_or_say_how_much_more_they_need() -> None:
    slow = planned(Scene(), method="spline", times=[0.0, 4.0])
    assert isinstance(slow, Plan)
    assert slow.trajectory.duration == 4.0
    short = planned(Scene(), method="spline", times=[0.0, 0.2])
    assert isinstance(short, Failure)
    assert (short.code, short.stage) == ("INVALID_MOTION_PLAN", "timing")
    assert "times as long" in short.message
    scaled = planned(Scene(), method="spline", times=[0.0, 0.2], scale_times=True)
    assert isinstance(scaled, Plan)
    assert scaled.trajectory.duration > 0.2
    with pytest.raises(InvalidOption, match="waypoints"):
        planned(Scene(), method="spline", times=[0.0, 1.0, 2.0])


def test_a_natural_spline_is_refused_with_its_velocities_since_plans_rest_at_their_ends() -> None:
    for times in ([0.0, 4.0], None):
        with pytest.raises(InvalidOption, match="natural spline would begin with") as refused:
            planned(Scene(), method="spline", times=times, interpolation="natural_spline")
        assert "clamped_spline" in (refused.value.hint or "")
    velocities = np.subtract(ASIDE, HOME) / 4.0
    with pytest.raises(InvalidOption) as refused:
        planned(Scene(), method="spline", times=[0.0, 4.0], interpolation="natural_spline")
    np.testing.assert_allclose(refused.value.details["start_velocity"], velocities, atol=1e-12)
    resting = planned(Scene(), method="spline", times=[0.0, 4.0])
    assert isinstance(resting, Plan)
    np.testing.assert_array_equal(resting.trajectory.sample([0.0], 1), np.zeros((1, 7)))


def test_corners_are_cut_within_the_tolerance() -> None:
    # In least time: motions of few pieces may take a tenth longer, some more than others.
    wide = planned(POST, method="toppra")
    narrow = planned(POST, method="toppra", blend_tolerance=0.01)
    sharp = planned(POST, method="toppra", blend_tolerance=0.0)
    assert isinstance(wide, Plan)
    assert isinstance(narrow, Plan)
    assert isinstance(sharp, Plan)
    durations = [answer.trajectory.duration for answer in (wide, narrow, sharp)]
    assert durations == sorted(durations)
    samples = narrow.trajectory.sample(np.linspace(0.0, narrow.trajectory.duration, 5000))
    for corner in narrow.path.waypoints[1:-1]:
        assert np.linalg.norm(samples - corner, axis=1).min() <= 0.0101


def test_limits_of_the_request_replace_those_of_the_robot() -> None:
    slow = planned(Scene(), limits={"velocity": np.full(7, 0.2)})
    assert isinstance(slow, Plan)
    assert worst_ratio(slow.trajectory, np.full(7, 0.2), 1) == pytest.approx(1.0, abs=1e-9)
    without = builtin("scara")
    problem = Problem(without, Scene(), np.zeros(4), (JointGoal(np.full(4, 0.1)),))
    if np.isnan(without.chain.limits.jerk).any():
        with pytest.raises(MissingLimit, match="jerk"):
            plan(problem, Options(timing=TimingOptions("jerk_limited")))


def test_a_plan_is_a_smooth_spline_of_few_pieces_where_nothing_is_asked_of_its_timing() -> None:
    limits = builtin("panda").chain.limits
    jerk = 10.0 * limits.acceleration
    answer = planned(POST, {"jerk": jerk})
    assert isinstance(answer, Plan)
    assert answer.timing is not None
    assert (answer.timing.method, answer.timing.solver) == ("jerk_limited", "quintic_spline")
    assert answer.trajectory.pieces <= 20
    assert answer.certificate.verified
    assert answer.certificate.limits["jerk"].worst_ratio <= 1.0 + 1e-9
    bounds = (limits.velocity, limits.acceleration, jerk)
    for order, bound in enumerate(bounds, 1):
        assert worst_ratio(answer.trajectory, bound, order) <= 1.0 + 1e-9
    assert answer.trajectory.continuity().acceleration < 1e-7


def test_a_spline_that_is_not_proved_gives_way_to_the_motion_on_the_path(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def certify(motion: Trajectory, *given: Any, **more: Any) -> Certificate:
        answer = true(motion, *given, **more)
        if motion.degree != 5:
            return answer
        violation = Violation("collision", 0.1, "refused", {})
        return replace(answer, verified=False, violation=violation)

    true = certificate.certify
    monkeypatch.setattr(pipeline, "certify", certify)
    answer = planned(POST, {"jerk": 10.0 * builtin("panda").chain.limits.acceleration})
    assert isinstance(answer, Plan)
    assert answer.timing is not None
    assert answer.timing.solver == "interior_point"
    assert [stage.name for stage in answer.stages].count("certificate") == 2


@pytest.mark.parametrize("margin", [0.05, 0.2, 0.3, 0.5])
def test_a_motion_keeps_a_distance_where_all_its_states_do(margin: float) -> None:
    """Past a post, which most of it is near by 30 cm."""
    goal, post = np.array([1.2, -0.3, 0.0, -2.0, 0.0, 1.8, 0.785]), pillar(0.6, 0.505)
    answer = planned_motion(Problem(builtin("panda"), post, HOME, (JointGoal(goal),)), Options())
    motion, model = answer.trajectory, Checker.of(builtin("panda"), post).model
    level = Checker(model.with_margins(margin, 0.0))
    states = motion.sample(np.linspace(0.0, motion.duration, 2000))
    assert motion_timing._keeps(level, motion) == level.all_valid(states)


@pytest.mark.parametrize(
    ("scene", "goal"),
    [
        (pillar(0.6, 0.505), [1.070284, -0.41152, -0.112171, -1.95398, 2.8973, 1.964798, 0.95968]),
        (shelf(), [0.9119, -0.550885, -0.170128, -2.05121, -2.8973, 2.030713, 0.674995]),
    ],
)
def test_a_spline_that_would_leave_the_limits_of_a_joint_is_not_sent_to_the_proof(
    scene: Scene, goal: list[float]
) -> None:
    """The fifth joint of both goals is at its limit, which splines near the path swing over."""
    problem = Problem(builtin("panda"), scene, HOME, (JointGoal(np.array(goal)),))
    answer = planned_motion(problem, Options())
    assert [stage.outcome for stage in answer.stages if stage.name == "certificate"] == [
        "succeeded"
    ]


@pytest.mark.parametrize("timing", [{"blend_tolerance": 0.1}, {"solver": "double_s"}])
def test_motions_stay_on_the_path_where_that_is_asked_for(timing: dict[str, Any]) -> None:
    answer = planned(POST, **timing)
    assert isinstance(answer, Plan)
    assert answer.timing is not None
    assert answer.timing.solver == "interior_point"
