"""Limits of motions, and how methods are chosen for paths."""

from typing import Any

import numpy as np
import pytest
from numpy.typing import ArrayLike
from scipy.interpolate import CubicSpline

from benchmarks.judges.ratios import worst_ratio
from benchmarks.timing import run
from dynamics.inverse import inverse_dynamics
from dynamics.model.payload import with_motors, with_payload
from kinematics.arrays import Array
from kinematics.errors import InvalidOption
from kinematics.jacobian import geometric
from kinematics.model.chain import Chain
from kinematics.robots import builtin_chain
from kinematics.trajectory.trajectory import Trajectory, stay
from planning.proof.limits.effort import effort_uses
from planning.timing.method import TimingMethod, timing_method
from planning.timing.options import Method, TimingFailed
from planning.timing.parametrization import TimeParametrization, merge_repeated
from planning.timing.path.blend import blend, largest_reaches
from planning.timing.speed.minimum_time import time_path
from planning.timing.spline.spline import Ends
from planning.timing.time_scaling import dilate, fit, peak_ratios, worst_kernel
from planning.values.limits import EffortLimits


def test_no_limit_is_exceeded_on_random_paths() -> None:
    # The full thousand are `make bench-timing`.
    found = run(80, seed=1)
    assert found.faults == []
    assert found.motions > 150
    assert all(value <= 1.0 + 1e-9 for value in found.worst.values())


def sampled_uses(
    chain: Chain, motion: Trajectory, effort: Array, tool_speed: float
) -> tuple[float, float]:
    times = np.linspace(0.0, motion.duration, 5001)
    q, qd, qdd = (motion.sample(times, order) for order in range(3))
    torque = np.abs(inverse_dynamics(chain, q, qd, qdd) / effort).max()
    velocity = np.einsum("kij,kj->ki", geometric(chain, q)[:, :3], qd)
    return float(torque), float(np.linalg.norm(velocity, axis=1).max() / tool_speed)


@pytest.mark.parametrize(
    "timing",
    [timing_method("toppra"), timing_method("toppra", "toppra"), timing_method("jerk_limited")],
)
@pytest.mark.parametrize("name", ["panda", "kr6_sixx", "stanford", "scara"])
def test_torques_and_tool_speed_are_kept_and_used(name: str, timing: TimingMethod) -> None:
    chain = with_payload(builtin_chain(name), 1.5, (0.0, 0.0, 0.05))
    if name == "stanford":
        chain = with_motors(chain, viscous_friction=2.0)
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


JOINTS = ("a", "b")
V, A, JERKS = np.array([1.0, 2.0]), np.array([4.0, 3.0]), np.array([40.0, 50.0])
WAYPOINTS = np.array([[0.0, 0.0], [1.0, 0.2], [1.2, 1.0], [0.3, 1.4]])


def timing_by(
    name: Method, start_velocity: Array | None = None, end_velocity: Array | None = None
) -> TimeParametrization:
    method = timing_method(name)
    jerk = JERKS if method.smooth else None
    return TimeParametrization(method, V, A, jerk, None, start_velocity, end_velocity)


def test_corners_are_stops_where_a_narrow_curve_takes_longer() -> None:
    parametrization = timing_by("jerk_limited")
    none = np.zeros(2)
    stops = parametrization.time_polyline(WAYPOINTS, none, JOINTS).trajectory.duration
    for share in (1e-4, 1.0):
        reaches = share * largest_reaches(WAYPOINTS)
        rounded = parametrization.time(blend(WAYPOINTS, reaches, smooth=True), JOINTS)
        timed = parametrization.time_polyline(WAYPOINTS, reaches, JOINTS)
        assert timed.trajectory.duration == min(stops, rounded.trajectory.duration)


def test_boundary_velocities_of_splines_need_times() -> None:
    spline = timing_by("spline", start_velocity=np.array([0.1, 0.2]))
    times = np.arange(4.0)
    motion = spline.time_spline(WAYPOINTS, times, "clamped", JOINTS).trajectory
    np.testing.assert_allclose(motion.sample([0.0, 3.0], 1), [[0.1, 0.2], [0.0, 0.0]], atol=1e-12)
    for given, scale in ((times, True), (None, False)):
        with pytest.raises(InvalidOption, match="boundary velocities of a spline"):
            spline.time_spline(WAYPOINTS, given, "natural", JOINTS, scale)


@pytest.mark.parametrize("ends", ["natural", "clamped"])
@pytest.mark.parametrize("given", [(True, False), (False, True), (True, True), (False, False)])
def test_a_spline_end_with_a_velocity_is_clamped_to_it(
    ends: Ends, given: tuple[bool, bool]
) -> None:
    rng = np.random.default_rng(sum(given))
    points, times = rng.normal(size=(5, 2)), np.cumsum([0.0, 0.4, 0.9, 0.3, 1.1])
    speeds = [v if use else None for v, use in zip(rng.normal(size=(2, 2)), given, strict=True)]
    timed = timing_by("spline", start_velocity=speeds[0], end_velocity=speeds[1])
    motion = timed.time_spline(points, times, ends, JOINTS).trajectory
    free = (2 if ends == "natural" else 1, np.zeros(2))
    conditions: Any = tuple(free if v is None else (1, v) for v in speeds)
    expected = CubicSpline(times, points, bc_type=conditions)
    for order in range(3):
        at = np.linspace(0.0, times[-1], 23)
        np.testing.assert_allclose(motion.sample(at, order), expected(at, order), atol=1e-12)


def test_repeated_waypoints_are_merged_and_collinear_ones_stay() -> None:
    points = [[0.0, 0.0], [0.0, 0.0], [1.0, 1.0], [2.0, 2.0], [2.0, 2.0]]
    np.testing.assert_array_equal(merge_repeated(points), [[0.0, 0.0], [1.0, 1.0], [2.0, 2.0]])


def random_trajectory(rng: np.random.Generator, n: int) -> Trajectory:
    breaks = np.concatenate([[0.0], np.cumsum(rng.uniform(0.1, 1.0, 6))])
    names = tuple(f"j{i}" for i in range(n))
    return Trajectory(names, breaks, rng.normal(size=(6, n, 5)) * 10.0 ** rng.uniform(-3, 3))


@pytest.mark.parametrize("seed", range(40))
def test_the_least_factor_is_found(seed: int) -> None:
    rng = np.random.default_rng(seed)
    trajectory = random_trajectory(rng, 4)
    limits = [10.0 ** rng.uniform(-2, 2, 4) for _ in range(3)]
    slow, factor, *_ = dilate(trajectory, *limits)
    needed = [
        float((trajectory.peaks(order).value / limit).max()) ** (1.0 / order)
        for order, limit in enumerate(limits, start=1)
    ]
    assert factor == pytest.approx(max(1.0, *needed), rel=1e-11)
    ratios = [peak_ratios(slow, limit, order).max() for order, limit in enumerate(limits, start=1)]
    assert max(ratios) <= 1.0
    fast, speed_up, *_ = fit(trajectory, *limits)
    assert speed_up == pytest.approx(max(needed), rel=1e-11)
    ratios = [peak_ratios(fast, limit, order).max() for order, limit in enumerate(limits, start=1)]
    assert 1.0 - 1e-11 < max(ratios) <= 1.0


def test_what_is_inside_its_limits_stays_as_it_is() -> None:
    trajectory = random_trajectory(np.random.default_rng(1), 3)
    same, factor, *_ = dilate(trajectory, trajectory.peaks(1).value, np.full(3, np.inf))
    assert factor == 1.0
    assert same is trajectory
    assert dilate(trajectory).factor == 1.0


def test_one_limit_alone_is_enough() -> None:
    trajectory = random_trajectory(np.random.default_rng(2), 2)
    half = trajectory.peaks(2).value / 4.0
    assert dilate(trajectory, acceleration=half).factor == pytest.approx(2.0, rel=1e-11)
    eighth = trajectory.peaks(3).value / 8.0
    assert dilate(trajectory, jerk=eighth).factor == pytest.approx(2.0, rel=1e-11)


@pytest.mark.parametrize(
    "limits", [[1.0], [1.0, 0.0], [1.0, -1.0], [1.0, np.nan], ["a", "b"], [[1.0, 1.0]]]
)
def test_malformed_limits_are_refused(limits: ArrayLike) -> None:
    trajectory = random_trajectory(np.random.default_rng(3), 2)
    for stretch in (dilate, fit):
        with pytest.raises(InvalidOption, match="velocity limits"):
            stretch(trajectory, limits)


def test_no_motion_or_no_limit_has_no_fastest_scaling() -> None:
    trajectory = random_trajectory(np.random.default_rng(4), 2)
    for still, limit in ((stay(["a", "b"], [0.0, 1.0]), 1.0), (trajectory, np.inf)):
        with pytest.raises(InvalidOption, match="no limit bounds"):
            fit(still, np.full(2, limit))


def _by_roots(breaks: np.ndarray, coefficients: np.ndarray, limits: np.ndarray) -> np.ndarray:
    """The ratios from the eigenvalues of companion matrices."""
    names = tuple(f"joint{i}" for i in range(coefficients.shape[1]))
    motion = Trajectory(names, breaks, coefficients)
    return np.array([worst_ratio(motion, limits[row], row + 1) for row in range(3)])


@pytest.mark.parametrize("n", [1, 2, 6, 7, 8, 9, 14, 16, 17])
@pytest.mark.parametrize("size", [2, 3, 4, 6, 7])
def test_worst_ratios_are_those_at_the_roots_of_numpy(n: int, size: int) -> None:
    rng = np.random.default_rng(100 * n + size)
    for _ in range(8):
        lengths = 10.0 ** rng.uniform(-1.5, 0.5, 6)
        breaks = np.concatenate([[0.0], np.cumsum(lengths)])
        # About the same in each power at the end of a piece, so that insides count.
        scales = lengths[:, None, None] ** -np.arange(float(size))
        coefficients = rng.normal(size=(6, n, size)) * scales
        coefficients[rng.uniform(size=(6, n)) < 0.1, -1] = 0.0
        limits = 10.0 ** rng.uniform(-1.0, 1.0, (3, n))
        limits[rng.uniform(size=(3, n)) < 0.2] = np.inf
        worst = np.zeros(3)
        worst_kernel(breaks, coefficients, limits, worst)
        np.testing.assert_allclose(worst, _by_roots(breaks, coefficients, limits), rtol=1e-9)


def test_what_has_no_limit_is_not_looked_at() -> None:
    coefficients = np.random.default_rng(0).normal(size=(2, 3, 6))
    limits = np.full((3, 3), np.inf)
    limits[1] = 2.0
    worst = np.zeros(3)
    worst_kernel(np.arange(3.0), coefficients, limits, worst)
    assert worst[0] == worst[2] == 0.0
    assert worst[1] > 0.0
