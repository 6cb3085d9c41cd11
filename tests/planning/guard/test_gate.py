"""What the gate accepts touches nothing and keeps its limits, run or stopped anywhere."""

import runpy
from pathlib import Path

import numpy as np
import pytest

from kinematics.errors import InvalidObjectName, InvalidOption, InvalidTrajectory
from kinematics.forward import forward
from kinematics.pose import transform
from kinematics.velocity import link_twist
from obstacles.collision.checker import Checker
from obstacles.collision.model.collision_model import CollisionModel
from obstacles.scenes.scene import Obstacle, Scene
from obstacles.shapes.shape import Box
from planning.guard.gate import Guard
from planning.guard.proposals import (
    SamplesProposal,
    TrajectoryProposal,
    TwistProposal,
    VelocityProposal,
)
from planning.stops.stop_family import state_at
from planning.timing.jerk.state_to_state import JointState
from planning.values.preferences import StopKinds
from tests.planning.guard.cases import cases, faults
from tests.planning.scenes import builtin
from tests.planning.stops.motions import ARMS, judge

READY = np.array([0.0, -0.5, 0.0, -2.2, 0.0, 1.7, 0.8])
WALL = Obstacle("wall", Box((0.1, 2.0, 2.0)), transform(None, (0.65, 0.0, 0.6)))
#: Into the wall after two thirds of it.
FORTH = np.array([0.0, 0.6, 0.0, 0.4, 0.0, 0.0, 0.0])


def _guard(stop: StopKinds = "path", *obstacles: Obstacle, margin: float = 0.0) -> Guard:
    return Guard(builtin("panda"), Scene(obstacles), stop, margin=margin)


@pytest.mark.parametrize(("kind", "jerk"), [("path", True), ("path", False), ("joints", False)])
@pytest.mark.parametrize("name", ARMS)
def test_what_is_accepted_is_free_and_within_limits(
    name: str, kind: StopKinds, jerk: bool, tmp_path: Path
) -> None:
    clean = []
    for case in cases(name, 8, jerk=jerk):
        around = case.around
        guard = Guard(around.robot, around.scene, kind, limits=around.limits)
        verdict = guard.propose(case.state, case.proposal)
        arm = judge(name, around.scene, tmp_path)
        assert faults(verdict, case, arm, kind, 60, 12) == [], case.kind
        if case.kind == "clean":
            clean.append(verdict.scale == 1.0 and verdict.violations == ())
    assert clean
    assert all(clean)


def test_a_session_never_leaves_the_arm_without_a_proved_stop() -> None:
    random, guard = np.random.default_rng(3), _guard("path", WALL)
    elapsed, state, accepted = None, JointState(READY), 0
    for _ in range(300):
        steps = np.cumsum(random.normal(0.0, 0.01, (6, 7)), axis=0)
        ahead = state.position if guard.running is None else guard.running.motion.sample(
            [min((elapsed or 0.0) + 0.02, guard.running.motion.duration)])[0]  # fmt: skip
        verdict = guard.propose(
            state, SamplesProposal(ahead + steps, 0.06, "natural_spline"), 0.02, elapsed=elapsed
        )
        assert guard.running is not None or verdict.accepted_until == 0.0
        assert verdict.stop.certificate.verified
        assert verdict.stop.stops.proved
        accepted += verdict.accepted_until > 0.0
        if guard.running is None:
            continue
        # Either the new motion runs from the latency on, or the old one goes on.
        passed = random.uniform(0.02, 0.3)
        begun = 0.0 if verdict.accepted_until > 0.0 else (elapsed or 0.0)
        elapsed = begun + passed
        at = min(elapsed, guard.running.motion.duration)
        state = JointState(guard.running.motion.sample([at])[0] + random.normal(0.0, 1e-3, 7))
    assert accepted > 50


def test_a_refusal_answers_the_last_stop_and_all_kinds_of_faults() -> None:
    guard = _guard("path", WALL)
    first = guard.propose(JointState(READY), VelocityProposal(np.full(7, 0.2), 0.2))
    assert first.accepted_until == 0.2
    # Straight into the wall, too fast, and from another place.
    rows = READY + np.linspace(0.2, 4.0, 8)[:, None] * FORTH
    refused = guard.propose(JointState(READY), SamplesProposal(rows, 0.02, "linear"))
    kinds = {fault.kind for fault in refused.violations}
    assert {"start", "velocity", "position", "collision"} <= kinds
    hit = next(fault for fault in refused.violations if fault.kind == "collision")
    assert 0.0 < hit.time < 0.16
    assert hit.details["depth"] > 0.0
    assert "wall" in hit.details["pair"]
    assert (refused.accepted_until, refused.scale, refused.trajectory) == (0.0, 0.0, None)
    assert refused.stop is first.stop


def test_the_first_instant_of_a_collision_is_told_on_request() -> None:
    rows = READY + np.linspace(0.0, 1.0, 9)[1:, None] * FORTH
    proposal = SamplesProposal(rows, 0.5, "natural_spline")
    times = []
    for exact in (False, True):
        verdict = _guard("path", WALL).propose(JointState(READY), proposal, exact=exact)
        times += [fault.time for fault in verdict.violations if fault.kind == "collision"]
    assert times[1] <= times[0] <= times[1] + 0.02


def test_what_is_too_fast_is_slowed_down_to_its_limits() -> None:
    rows = READY + np.linspace(0.1, 1.0, 10)[:, None] * np.array([-1.0, 0, 0, 0, 0, 0, 0])
    guard = _guard()
    verdict = guard.propose(JointState(READY), SamplesProposal(rows, 0.02, "clamped_spline"))
    assert 0.0 < verdict.scale < 1.0
    assert verdict.accepted_until == pytest.approx(0.2 / verdict.scale)
    motion, limits = verdict.trajectory, guard.around.robot.chain.limits
    assert motion is not None
    used = [motion.peaks(k).value / most for k, most in ((1, limits.velocity),
            (2, limits.acceleration))]  # fmt: skip
    assert max(row.max() for row in used) == pytest.approx(1.0, abs=1e-6)
    assert np.allclose(motion.end, rows[-1])
    assert [fault.kind for fault in verdict.violations] != []


def test_a_moving_arm_is_slowed_down_along_the_path() -> None:
    guard, towards = _guard("path", WALL), np.array([0.8, 0, 0, 0, 0, 0, 0.0])
    state, seconds = JointState(READY, towards), np.arange(1, 13)[:, None] * 0.05
    rows = READY + towards * (seconds + 3.0 * np.maximum(seconds - 0.1, 0.0) ** 2)
    faster = SamplesProposal(rows, 0.05, "natural_spline")
    verdict = guard.propose(state, faster)
    assert 0.0 < verdict.scale < 1.0
    assert verdict.trajectory is not None
    assert np.allclose(state_at(verdict.trajectory, 0.0)[:2], [READY, towards])
    assert np.allclose(verdict.trajectory.end, rows[-1])


def test_an_arm_may_leave_a_margin_and_not_come_nearer() -> None:
    near = Checker.of(builtin("panda"), Scene((WALL,))).gradient(READY, 0.5)
    names = [CollisionModel(builtin("panda"), Scene((WALL,)), 0.0).pair_name(k) for k in near.pairs]
    clearance = min(d for d, pair in zip(near.distances, names, strict=True) if "wall" in pair)
    guard = _guard("path", WALL, margin=clearance + 0.03)
    back = guard.propose(JointState(READY), VelocityProposal(-FORTH, 0.3))
    assert (back.scale, back.accepted_until) == (1.0, 0.3)
    assert "inside the margin of 'wall'" in back.notes[0]
    assert back.stop.certificate.min_obstacle_clearance >= clearance - 2e-6
    fresh = _guard("path", WALL, margin=clearance + 0.03)
    assert fresh.propose(JointState(READY), VelocityProposal(FORTH, 0.3)).accepted_until == 0.0


@pytest.mark.parametrize("kind", ["path", "joints"])
def test_a_prefix_ends_where_the_arm_can_still_stop(kind: StopKinds) -> None:
    rows = READY + np.linspace(0.0, 1.0, 9)[1:, None] * FORTH
    guard = _guard(kind, WALL)
    verdict = guard.propose(JointState(READY), SamplesProposal(rows, 0.5, "natural_spline"))
    assert (verdict.scale, verdict.stop.stops.proved) == (1.0, True)
    hit = next(fault.time for fault in verdict.violations if fault.kind == "collision")
    assert 0.7 * hit < verdict.accepted_until < hit


def test_a_twist_leads_the_tool() -> None:
    guard, twist = _guard(), np.array([0.05, 0.0, -0.02, 0.0, 0.1, 0.0])
    verdict = guard.propose(JointState(READY), TwistProposal(twist, 0.3))
    assert verdict.scale == 1.0
    assert verdict.trajectory is not None

    end = state_at(verdict.trajectory, 0.29)
    reached = link_twist(guard.around.robot.chain, end[0], end[1])
    assert np.abs(reached - twist).max() < 2e-3


def test_a_changed_scene_proves_the_stop_again_or_voids_it() -> None:
    guard = _guard()
    assert guard.change(add=[WALL]) is None
    rows = READY + np.linspace(0.0, 1.0, 9)[1:, None] * np.array([-1.0, 0, 0, 0, 0, 0, 0])
    guard.propose(JointState(READY), SamplesProposal(rows, 0.3, "clamped_spline"))
    still = guard.change(move={"wall": transform(None, (0.9, 0.0, 0.6))})
    assert still is not None
    assert still.verified
    assert guard.running is not None
    place = forward(guard.around.robot.chain, guard.running.motion.end)[:3, 3]
    void = guard.change(add=[Obstacle("block", Box((0.2, 0.2, 0.2)), transform(None, place))])
    assert void is not None
    assert not void.verified
    told = guard.propose(JointState(READY), VelocityProposal(np.full(7, 90.0), 0.1), elapsed=0.0)
    assert not told.stop.certificate.verified or told.accepted_until > 0.0
    again = guard.change(remove=["block"])
    assert again is not None
    assert again.verified


def test_odd_input_has_a_clear_answer() -> None:
    guard, jog = _guard("path", WALL), VelocityProposal(np.full(7, 0.1), 0.1)
    with pytest.raises(InvalidTrajectory, match="position"):
        JointState(np.array([np.nan] * 7))
    with pytest.raises(InvalidOption, match="no motion was accepted"):
        guard.propose(JointState(READY), jog, elapsed=0.1)
    with pytest.raises(InvalidOption, match="elapsed is -1"):
        guard.propose(JointState(READY), jog, elapsed=-1.0)
    with pytest.raises(InvalidOption, match="latency"):
        guard.propose(JointState(READY), jog, -0.1)
    with pytest.raises(InvalidTrajectory, match="7 joints"):
        guard.propose(JointState(READY), SamplesProposal(np.zeros((2, 6)), 0.1, "linear"))
    other = TrajectoryProposal(
        Guard(builtin("ur5e"), Scene())
        .propose(JointState(np.zeros(6)), VelocityProposal(np.full(6, 0.1), 0.1))
        .trajectory
        or pytest.fail("refused")
    )
    with pytest.raises(InvalidTrajectory, match="shoulder_pan_joint"):
        guard.propose(JointState(READY), other)
    with pytest.raises(InvalidObjectName, match="no obstacle 'hall'"):
        guard.change(remove=["hall"])
    with pytest.raises(InvalidOption, match="no interpolation"):
        SamplesProposal(np.zeros((2, 7)), 0.1, "linaer")
    with pytest.raises(InvalidOption, match="no stop of kind"):
        _guard("none")

    def kinds(state: JointState, **given: object) -> list[str]:
        return [fault.kind for fault in guard.propose(state, jog, **given).violations]  # type: ignore[arg-type]

    assert kinds(JointState(READY), scene_hash="0" * 64) == ["scene"]
    beyond = READY.copy()
    beyond[3] = 0.5
    assert "position" in kinds(JointState(beyond))
    inside = _guard(
        "path", Obstacle("block", Box((0.5, 0.5, 0.5)), transform(None, (0.4, 0.3, 0.5)))
    )
    told = inside.propose(JointState(READY), jog)
    assert next(fault.kind for fault in told.violations) == "collision"
    assert (told.accepted_until, told.stop.certificate.verified) == (0.0, False)
    guard.propose(JointState(READY), jog)
    assert kinds(JointState(READY), elapsed=0.05) == []
    guard.propose(JointState(READY), jog)
    assert kinds(JointState(READY + 0.3), elapsed=0.04) == ["state"]
    assert kinds(JointState(READY), elapsed=0.02) == ["stale"]
    # Longer than the stop: the arm is at rest by then.
    late = guard.propose(JointState(READY), jog, 3.0, elapsed=0.04)
    assert late.accepted_until > 0.0


def test_the_example_guards_a_random_policy(capsys: pytest.CaptureFixture[str]) -> None:
    path = Path(__file__).parents[3] / "examples/guard_policy.py"
    example = runpy.run_path(str(path))
    assert example["run"](120, 1)
    assert "a proved stop at every step: True" in capsys.readouterr().out
