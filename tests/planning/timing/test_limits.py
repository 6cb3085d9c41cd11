"""Random paths of all kinds, timed by every method and judged by numpy alone; torques besides."""

import numpy as np
import pytest
from numpy.polynomial import polynomial as power_basis

from benchmarks.judges.ratios import worst_ratio
from benchmarks.timing import run
from dynamics.inverse import inverse_dynamics
from dynamics.model.payload import with_motors, with_payload
from kinematics.arrays import Array
from kinematics.errors import InvalidOption
from kinematics.jacobian import geometric
from kinematics.model.chain import Chain
from kinematics.robots import builtin_chain
from kinematics.trajectory.trajectory import Trajectory
from planning.proof.limits.effort import effort_uses
from planning.timing.method import JerkLimited, TimeOptimal, TimingMethod
from planning.timing.options import TimingFailed
from planning.timing.parametrization import TimeParametrization
from planning.timing.path.blend import blend, largest_reaches
from planning.timing.speed.minimum_time import time_path
from planning.values.limits import EffortLimits


def test_no_limit_is_exceeded_on_random_paths() -> None:
    # The full thousand are `make bench-timing`.
    found = run(80, seed=1)
    assert found.faults == []
    assert found.motions > 150
    assert all(value <= 1.0 + 1e-9 for value in found.worst.values())


def test_the_judge_finds_the_peaks_that_numpys_roots_have() -> None:
    rng = np.random.default_rng(0)
    for degree in (1, 3, 5, 9):
        breaks = np.concatenate([[0.0], np.cumsum(rng.uniform(0.1, 1.0, 6))])
        motion = Trajectory(("a", "b"), breaks, rng.uniform(-1.0, 1.0, (6, 2, degree + 1)))
        for order in (1, 2, 3):
            worst = 0.0
            for h, piece in zip(np.diff(breaks), motion.coefficients, strict=True):
                for row in piece:
                    c = power_basis.polyder(row, order)
                    inner = power_basis.polyder(c)
                    roots = power_basis.polyroots(inner) if len(inner) > 1 else np.zeros(0)
                    places = np.clip([0.0, h, *np.real(roots)], 0.0, h)
                    worst = max(worst, float(np.abs(power_basis.polyval(places, c)).max()))
            assert worst_ratio(motion, np.ones(2), order) == pytest.approx(worst, rel=1e-9)


def sampled_uses(
    chain: Chain, motion: Trajectory, effort: Array, tool_speed: float
) -> tuple[float, float]:
    times = np.linspace(0.0, motion.duration, 5001)
    q, qd, qdd = (motion.sample(times, order) for order in range(3))
    torque = np.abs(inverse_dynamics(chain, q, qd, qdd) / effort).max()
    velocity = np.einsum("kij,kj->ki", geometric(chain, q)[:, :3], qd)
    return float(torque), float(np.linalg.norm(velocity, axis=1).max() / tool_speed)


@pytest.mark.parametrize("timing", [TimeOptimal(), TimeOptimal("toppra"), JerkLimited()])
@pytest.mark.parametrize("name", ["panda", "kr6_sixx", "stanford", "scara"])
def test_torques_and_tool_speed_are_kept_and_used(name: str, timing: TimingMethod) -> None:
    chain = with_payload(builtin_chain(name), 1.5, (0.0, 0.0, 0.05))
    rng = np.random.default_rng(1)
    waypoints = rng.uniform(-1.0, 1.0, (5, chain.n))
    path = blend(waypoints, largest_reaches(waypoints), smooth=timing.smooth)
    q = path.sample(np.linspace(0.0, path.breaks[-1], 400))
    still = np.abs(inverse_dynamics(chain, q, 0.0 * q, 0.0 * q)).max(axis=0)
    v, a, j = (np.full(chain.n, value) for value in (3.0, 15.0, 300.0))
    effort = 1.3 * still + 2.0
    for loads in (
        EffortLimits(chain, effort),
        EffortLimits(chain, None, 0.6),
        EffortLimits(chain, effort, 0.6),
    ):
        parametrization = TimeParametrization(timing, v, a, j, loads)
        motion = parametrization.time(path, chain.joint_names).trajectory
        torque, speed = sampled_uses(chain, motion, effort, 0.6)
        uses = effort_uses(loads, motion)
        used = [use.ratio for use in uses.values()]
        assert max(used) <= 1.0 + 1e-9
        # Something is used almost wholly, and what the samples say is below what is told.
        assert max(used) > 0.97
        if "torque" in uses:
            assert torque <= uses["torque"].ratio + 1e-12
        if "tool_speed" in uses:
            assert speed <= uses["tool_speed"].ratio + 1e-12
        for order, limit in ((1, v), (2, a)):
            assert worst_ratio(motion, limit, order) <= 1.0 + 1e-9


def test_a_finer_grid_gains_little_under_loads() -> None:
    chain = builtin_chain("ur5e")
    waypoints = np.random.default_rng(2).uniform(-1.0, 1.0, (5, 6))
    path = blend(waypoints, largest_reaches(waypoints))
    loads = EffortLimits(chain, chain.limits.effort, 0.7)
    limits = np.full(6, 3.0), np.full(6, 15.0)
    usual = time_path(path, chain.joint_names, *limits, loads=loads).trajectory.duration
    fine = time_path(path, chain.joint_names, *limits, loads=loads, resolution=5000)
    assert usual <= 1.02 * fine.trajectory.duration


def test_friction_is_paid_for() -> None:
    chain = builtin_chain("planar_rr")
    rough = with_motors(chain, viscous_friction=2.0)
    waypoints = np.array([[0.0, 0.0], [1.0, -0.5], [1.5, 0.7]])
    path = blend(waypoints, largest_reaches(waypoints))
    q = path.sample(np.linspace(0.0, path.breaks[-1], 300))
    effort = 1.5 * np.abs(inverse_dynamics(chain, q, 0.0 * q, 0.0 * q)).max(axis=0) + 1.0
    limits = np.full(2, 3.0), np.full(2, 20.0)
    durations = []
    for robot in (chain, rough):
        loads = EffortLimits(robot, effort)
        motion = time_path(path, robot.joint_names, *limits, loads=loads).trajectory
        torque, _ = sampled_uses(robot, motion, effort, 1.0)
        assert torque <= 1.0 + 1e-9
        durations.append(motion.duration)
    assert durations[1] > durations[0]


def test_a_joint_that_cannot_hold_itself_is_named() -> None:
    chain = with_payload(builtin_chain("panda"), 40.0)
    loads = EffortLimits(chain, chain.limits.effort)
    path = blend([[0.0, 0.5, 0.0, -1.0, 0.0, 1.5, 0.0], [0.5] * 7], [])
    with pytest.raises(TimingFailed, match=r"panda_joint2.*hold"):
        time_path(path, chain.joint_names, np.full(7, 2.0), np.full(7, 10.0), loads=loads)
    with pytest.raises(InvalidOption, match="tool speed"):
        EffortLimits(chain, None, 0.0)


def test_boundary_speeds_are_kept_at_minimum_time() -> None:
    rng = np.random.default_rng(3)
    v, a = np.full(3, 1.0), np.full(3, 4.0)
    for _ in range(20):
        waypoints = rng.uniform(-1.0, 1.0, (5, 3))
        path = blend(waypoints, 0.5 * largest_reaches(waypoints))
        speeds = (float(rng.uniform(0.0, 0.5)), float(rng.uniform(0.0, 0.5)))
        motion = time_path(path, "abc", v, a, end_speeds=speeds).trajectory
        reached = np.linalg.norm(motion.sample([0.0, motion.duration], 1), axis=1)
        assert reached == pytest.approx(speeds, abs=1e-9)
        assert worst_ratio(motion, a, 2) <= 1.0 + 1e-9
        rest = time_path(path, "abc", v, a).trajectory
        assert motion.duration <= rest.duration + 1e-12
    with pytest.raises(TimingFailed, match="boundary"):
        time_path(path, "abc", v, a, end_speeds=(50.0, 0.0))
