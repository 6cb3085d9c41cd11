"""Splines of few pieces within limits of torque and tool speed, beside pinocchio."""

import numpy as np
import pinocchio
import pytest

from benchmarks.judges.ratios import worst_ratio
from kinematics.arrays import Array
from kinematics.robots import builtin_urdf
from kinematics.trajectory.trajectory import Trajectory
from obstacles.collision.checker import Checker
from obstacles.scenes.scene import Scene
from planning.options import Options
from planning.pipeline.pipeline import plan
from planning.problem import JointGoal, Problem
from planning.result import Plan
from planning.timing.choice import chosen_parametrization
from planning.timing.jerk.even_corners import Pieces
from planning.timing.motion_timing import motions
from planning.timing.options import Payload, TimingOptions
from planning.timing.parametrization import WORTH
from planning.timing.spline.quintic_fit import even_parts, fit_pieces
from planning.timing.spline.span_loads import (
    no_loads,
    span_loads,
    span_memory,
    widen_for_loads_kernel,
)
from planning.values.limits import EffortLimits
from tests.planning.scenes import builtin
from tests.planning.timing.motion_judge import TOOL_SPEED, Judge, random_problems


def _random_piece(n: int, seed: int) -> tuple[Array, Array]:
    random = np.random.default_rng(seed)
    piece = random.uniform(-1.0, 1.0, (2, 6, n)) / np.array([1, 1, 2, 6, 24, 120])[:, None]
    return np.ascontiguousarray(piece), random.uniform(0.2, 0.5, 2)


def _by_pinocchio(name: str, piece: Array, times: Array) -> tuple[Array, Array, Array]:
    """Speeds of the tip, torques and torques at rest along a piece (k, n)."""
    model = pinocchio.buildModelFromXML(builtin_urdf(name))
    data = model.createData()
    tip = model.getFrameId(builtin(name).chain.tip_link, pinocchio.FrameType.BODY)
    columns = [
        model.joints[model.getJointId(joint)].idx_q for joint in builtin(name).chain.joint_names
    ]
    speeds, torques, still = [], [], []
    for t in times:
        state = np.zeros((3, model.nq))
        for order in range(3):
            state[order, columns] = np.polynomial.polynomial.polyval(
                t, np.polynomial.polynomial.polyder(piece, order)
            )
        pinocchio.forwardKinematics(model, data, state[0], state[1])
        twist = pinocchio.getFrameVelocity(model, data, tip, pinocchio.LOCAL_WORLD_ALIGNED)
        speeds.append(np.linalg.norm(twist.linear))
        torques.append(pinocchio.rnea(model, data, *state)[columns])
        still.append(pinocchio.computeGeneralizedGravity(model, data, state[0])[columns])
    return np.array(speeds), np.array(torques), np.array(still)


@pytest.mark.parametrize("name", ["panda", "ur5e", "kr6_sixx"])
def test_factors_are_those_of_speeds_and_torques_by_pinocchio(name: str) -> None:
    chain = builtin(name).chain
    pieces, spans = _random_piece(chain.n, 3)
    places = 9
    looked = [np.linspace(0.0, span, places) for span in spans]
    found = [_by_pinocchio(name, *each) for each in zip(pieces, looked, strict=True)]
    speed = EffortLimits(chain, tool_speed=0.7)
    excess = np.zeros(2)
    widen_for_loads_kernel(pieces, spans, span_loads(speed), places, span_memory(chain.n), excess)
    # The end of the last span is at rest in a motion, and is not looked at.
    expected = [found[0][0][:-1].max() / 0.7, found[1][0][:-1].max() / 0.7]
    ends = found[1][0][0] / 0.7
    np.testing.assert_allclose(excess, [max(expected[0], ends), expected[1]], rtol=1e-9)
    # Torques: with the factor the motion needs just what there is.
    still = np.abs(np.concatenate([f[2] for f in found])).max(axis=0)
    effort = 1.2 * still + 1.0
    excess[:] = 0.0
    loads = span_loads(EffortLimits(chain, effort=effort))
    widen_for_loads_kernel(pieces, spans, loads, places, span_memory(chain.n), excess)
    torques, gravity = (np.array([f[k][:-1] for f in found]) for k in (1, 2))
    for i, factor in enumerate(excess):
        slower = gravity[i] + (torques[i] - gravity[i]) / factor**2
        use = np.abs(slower / loads.torques).max()
        first = gravity[1][0] + (torques[1][0] - gravity[1][0]) / factor**2
        use = max(use, np.abs(first / loads.torques).max()) if i == 0 else use
        if not chain.viscous_friction.any():
            assert use == pytest.approx(1.0, abs=1e-6)


def test_without_loads_the_spline_is_the_same() -> None:
    chain = builtin("panda").chain
    breaks, c = np.array([0.0, 1.0]), np.zeros((1, 7, 4))
    c[0, :, 2], c[0, :, 3] = 0.9, -0.6
    limits = np.stack([chain.limits.velocity, chain.limits.acceleration, chain.limits.jerk])
    given = Pieces(breaks, c), chain.joint_names, limits, even_parts(1.0, 3, 8.0)
    plain = fit_pieces(*given).trajectory
    same = fit_pieces(*given, no_loads()).trajectory
    np.testing.assert_array_equal(plain.coefficients, same.coefficients)


@pytest.mark.parametrize("name", ["panda", "ur5e", "kr6_sixx"])
def test_motions_with_a_slow_tool_have_few_pieces_and_keep_all_limits(name: str) -> None:
    robot = builtin(name)
    limits, judge = robot.chain.limits, Judge(builtin_urdf(name), robot, 0.0)
    rates = []
    for problem, options in random_problems(robot, 6, 0.0):
        answer = plan(problem, options)
        assert isinstance(answer, Plan)
        motion = answer.trajectory
        rates.append(motion.pieces * 1.6 / max(motion.duration, 1.6))
        assert answer.certificate.verified
        jerk = 10.0 * limits.acceleration if np.isnan(limits.jerk).any() else limits.jerk
        jerk = np.where(np.isfinite(jerk), jerk, 10.0 * limits.acceleration)
        for order, bound in enumerate((limits.velocity, limits.acceleration, jerk), 1):
            assert worst_ratio(motion, bound, order) <= 1.0 + 1e-9
        assert judge.uses(motion, limits.effort)[0] <= TOOL_SPEED * (1.0 + 1e-9)
    assert np.median(rates) <= 20.5


def test_a_spline_that_takes_much_longer_is_not_taken() -> None:
    """At most a twentieth longer than by the interior-point method; a tenth where little binds."""
    robot = builtin("panda")
    chain = robot.chain
    for k, (problem, _) in enumerate(random_problems(robot, 4, 0.0)):
        timing = TimingOptions(tool_speed=(0.2, 0.5, 1.0, 2.0)[k])
        parametrization = chosen_parametrization(timing, chain.joint_names, chain.limits, {}, chain)
        ends = np.array([problem.start, problem.goals[0].joints])  # type: ignore[union-attr]
        checker = Checker.of(robot, Scene(()))
        (first, *_) = motions(checker, ends, parametrization, timing, None)  # type: ignore[arg-type]
        spline = first()
        exact = chosen_parametrization(
            TimingOptions("jerk_limited", tool_speed=timing.tool_speed),
            chain.joint_names, chain.limits, {}, chain,
        )  # fmt: skip
        (other, *_) = motions(checker, ends, exact, timing, None)  # type: ignore[arg-type]
        assert spline.trajectory.duration <= WORTH * other().trajectory.duration
        _assert_straight(spline.trajectory, ends)


def _assert_straight(motion: Trajectory, ends: Array) -> None:
    """A spline near a straight path is on it."""
    q = motion.sample(np.linspace(0.0, motion.duration, 200))
    along = (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])
    off = q - ends[0] - np.outer((q - ends[0]) @ along, along)
    assert np.abs(off).max() < 1e-9


def test_a_heavy_load_is_carried_in_fewer_pieces_where_that_costs_little() -> None:
    robot = builtin("panda")
    judge = Judge(builtin_urdf("panda"), robot, 5.0)
    taken = 0
    for problem, _ in random_problems(robot, 14, 5.0):
        timing = TimingOptions(torque_limits=True, payload=Payload(5.0))
        answer = plan(
            Problem(robot, problem.scene, problem.start, (JointGoal(_joints(problem)),)),
            Options(timing=timing, timeout=20.0),
        )
        if not isinstance(answer, Plan):
            continue  # A joint can't hold the load there.
        assert answer.certificate.verified
        assert answer.timing is not None
        taken += answer.timing.solver == "quintic_spline"
        strongest = judge.uses(answer.trajectory, robot.chain.limits.effort)[1]
        assert strongest <= 1.0 + 1e-9
    assert taken >= 2


def _joints(problem: Problem) -> Array:
    goal = problem.goals[0]
    assert isinstance(goal, JointGoal)
    return np.asarray(goal.joints)


@pytest.mark.parametrize("name", ["panda", "ur5e", "kr6_sixx"])
def test_short_straight_motions_with_a_slow_tool_have_few_pieces_too(name: str) -> None:
    """Ten spans a second are too few where all of a motion is ramps of speed: twenty in all do."""
    robot, random = builtin(name), np.random.default_rng(8)
    chain, judge = robot.chain, Judge(builtin_urdf(name), robot, 0.0)
    low, high = chain.sampling_bounds()
    few, count = 0, 0
    while count < 12:
        start = random.uniform(low, high)
        goal = np.clip(start + random.normal(scale=0.15, size=chain.n), low, high)
        speed = float(random.choice([0.1, 0.2, 0.5]))
        answer = plan(
            Problem(robot, Scene(), start, (JointGoal(goal),)),
            Options(planner="straight_line", timing=TimingOptions(tool_speed=speed)),
        )
        if not isinstance(answer, Plan) or answer.trajectory.duration > 1.6:
            continue
        count, motion = count + 1, answer.trajectory
        few += motion.pieces <= 20
        assert answer.timing is not None
        assert judge.uses(motion, chain.limits.effort)[0] <= speed * (1.0 + 1e-9)
        _assert_straight(motion, np.array([start, goal]))
    assert few >= 10
