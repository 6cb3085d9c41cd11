"""Splines beside those of scipy; quintics of few pieces within limits, loads by pinocchio."""

import itertools
import json
from collections.abc import Iterator

import numpy as np
import pytest
from numpy.typing import ArrayLike
from scipy.interpolate import BSpline, CubicSpline

import armwright as aw
from benchmarks.judges.ratios import worst_ratio
from benchmarks.problems.mesh_scenes import own_scenes
from kinematics.arrays import Array
from kinematics.errors import InvalidOption, InvalidTrajectory
from kinematics.forward import forward
from kinematics.pose import transform
from kinematics.trajectory.trajectory import Trajectory
from obstacles.collision.checker import Checker
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.scenes.scene import Obstacle, Scene
from obstacles.shapes.shape import Cylinder
from planning.options import CartesianOptions, Options, ToolMotionOptions
from planning.pipeline.pipeline import plan
from planning.problem import JointGoal, PoseGoal, Problem
from planning.result import Plan
from planning.timing.choice import chosen_parametrization
from planning.timing.jerk.jerk_limited import Pieces, time_path_with_jerk
from planning.timing.motion_timing import motions
from planning.timing.options import Payload, TimingOptions
from planning.timing.parametrization import WORTH
from planning.timing.path.blend import blend, largest_reaches, merge
from planning.timing.spline.quintic_fit import (
    DEGREE,
    MIN_SPANS,
    SPAN_RATES,
    even_parts,
    fit_pieces,
    fit_spans_kernel,
)
from planning.timing.spline.span_loads import no_loads
from planning.timing.spline.spline import chord_knots, spline_path, spline_trajectory
from planning.timing.time_scaling import ScaledTime
from service.translate.trajectories import trajectory_answer
from tests.planning.pinocchio_arm import PinocchioArm
from tests.planning.scenes import HOME, builtin, planned_motion, shelf
from tests.planning.timing.timed_paths import PANDA_ACCELERATION, PANDA_VELOCITY, names

LIMITS = np.stack([PANDA_VELOCITY, PANDA_ACCELERATION, 10.0 * PANDA_ACCELERATION])


def _knots(spans: np.ndarray) -> np.ndarray:
    breaks = np.concatenate([[0.0], np.cumsum(spans)])
    return np.concatenate([np.zeros(DEGREE), breaks, np.full(DEGREE, breaks[-1])])


def _rounded(seed: int, corners: int = 3) -> tuple[np.ndarray, ScaledTime]:
    rng = np.random.default_rng(seed)
    points = merge(np.cumsum(rng.uniform(-0.2, 0.6, (corners + 2, 7)), axis=0))
    path = blend(points, largest_reaches(points), smooth=True)
    return points, time_path_with_jerk(path, names(7), *LIMITS)


@pytest.mark.parametrize("n", [1, 2, 7, 8, 14])
def test_the_spline_is_that_of_least_squares_with_ends_at_rest(n: int) -> None:
    rng = np.random.default_rng(1)
    points, shares = rng.normal(size=(9, 4, n)), np.array([0.1, 0.4, 0.6, 0.9])
    ends, spans = rng.normal(size=(2, n)), rng.uniform(0.1, 0.4, 9)
    coefficients, limits = np.zeros((9, n, 6)), np.ones((3, n))
    factor = fit_spans_kernel(points, shares, ends, limits, no_loads(), spans, coefficients)
    breaks = np.concatenate([[0.0], np.cumsum(spans)])
    times = (breaks[:-1, None] + spans[:, None] * shares).ravel()
    design = BSpline.design_matrix(times, _knots(spans), DEGREE).toarray()
    control = np.concatenate([np.tile(ends[0], (3, 1)), np.zeros((8, n)), np.tile(ends[1], (3, 1))])
    right = points.reshape(-1, n) - design @ control
    control[3:-3] = np.linalg.lstsq(design[:, 3:-3], right, rcond=None)[0]
    spline = BSpline(_knots(spans), control, DEGREE)
    for order in range(3):
        ours = coefficients[:, :, order] * [1.0, 1.0, 2.0][order]
        np.testing.assert_allclose(ours, spline(breaks[:-1], order), rtol=1e-8, atol=1e-8)
    fine = np.linspace(0.0, breaks[-1], 2000)
    worst = max(np.abs(spline(fine, k)).max() ** (1.0 / k) for k in (1, 2, 3))
    assert factor == pytest.approx(worst, rel=0.02)


def near(motion: Trajectory, limits: Array, legs: int) -> ScaledTime:
    """The spline near a motion along a path of some legs."""
    parts = even_parts(motion.duration, legs, SPAN_RATES[0])
    return fit_pieces(Pieces(motion.breaks, motion.coefficients), names(7), limits, parts)


@pytest.mark.parametrize("seed", range(8))
def test_few_pieces_keep_all_limits_exactly(seed: int) -> None:
    points, rounded = _rounded(seed)
    spline, _, solver, _ = near(rounded.trajectory, LIMITS, len(points) - 1)
    assert solver == "quintic_spline"
    for order, bound in enumerate(LIMITS, 1):
        assert worst_ratio(spline, bound, order) <= 1.0 + 1e-9
    assert spline.pieces <= max(MIN_SPANS, SPAN_RATES[0] * rounded.trajectory.duration + 1.0)
    np.testing.assert_allclose(spline.start, points[0], atol=1e-12)
    np.testing.assert_allclose(spline.end, points[-1], atol=1e-10)
    for order in (1, 2):
        ends = spline.sample([0.0, spline.duration], order)
        np.testing.assert_allclose(ends, 0.0, atol=1e-8)
    for order in range(5):
        scale = np.abs(spline.peaks(order).value).max()
        assert np.abs(spline.jumps(order)).max() <= 1e-7 * max(scale, 1.0)
    # Near the path, and about as fast.
    on_path = rounded.trajectory.sample(np.linspace(0.0, rounded.trajectory.duration, 4000))
    at = spline.sample(np.linspace(0.0, spline.duration, 50))
    away = np.linalg.norm(at[:, None] - on_path[None], axis=2).min(axis=1)
    assert away.max() < 0.04
    assert spline.duration < 1.2 * rounded.trajectory.duration


def test_slow_motions_have_no_more_pieces_than_their_legs_need() -> None:
    points, rounded = _rounded(0)
    slow = rounded.trajectory.dilate(10.0)
    limits = LIMITS / np.array([[10.0], [100.0], [1000.0]])
    spline = near(slow, limits, len(points) - 1).trajectory
    assert spline.pieces == 12 * (len(points) - 1)


def test_the_path_is_the_same_curve() -> None:
    rng = np.random.default_rng(2)
    points = rng.normal(size=(6, 4))
    knots = chord_knots(points)
    assert knots[-1] == pytest.approx(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())
    path = spline_path(points, knots + 5.0)
    trajectory = spline_trajectory(list("abcd"), points, knots)
    places = np.linspace(0.0, knots[-1], 50)
    np.testing.assert_allclose(path.sample(places), trajectory.sample(places), atol=1e-12)
    assert path.corners == ()


@pytest.mark.parametrize(
    ("points", "times", "match"),
    [
        ([[0.0]], [0.0], "at least two"),
        ([[0.0], [1.0]], [0.0], "2 waypoints with 1"),
        ([[0.0], [1.0]], [0.0, 0.0], "not after"),
        ([[0.0], [1.0], [2.0]], [0.0, 2.0, 1.0], "time 2"),
        ([[0.0], [1.0]], [1.0, 2.0], "start at 0"),
        ([[0.0], [np.nan]], [0.0, 1.0], "finite"),
        ([[0.0], [1.0]], [0.0, np.inf], "finite"),
        ([["a"], [1.0]], [0.0, 1.0], "numbers"),
        ([0.0, 1.0], [0.0, 1.0], "shape"),
    ],
)
def test_malformed_splines_are_refused(points: ArrayLike, times: ArrayLike, match: str) -> None:
    with pytest.raises(InvalidTrajectory) as caught:
        spline_trajectory(["a"], points, times)
    assert match in f"{caught.value.message} {caught.value.hint}"


def test_unknown_ends_and_repeated_waypoints_are_refused() -> None:
    with pytest.raises(InvalidOption, match="periodic"):
        spline_trajectory(["a"], [[0.0], [1.0]], [0.0, 1.0], "periodic")  # type: ignore[arg-type]
    with pytest.raises(InvalidTrajectory, match="waypoint 2 repeats waypoint 1"):
        chord_knots([[0.0], [1.0], [1.0]])
    with pytest.raises(InvalidTrajectory):
        chord_knots([0.0, 1.0])


def few(motion: Trajectory) -> bool:
    """Whether a motion has at most 20 pieces in 1.6 s, or 8 kB."""
    share = LENGTH / max(motion.duration, LENGTH)
    return motion.pieces * share <= MOST or size(motion) * share <= BYTES


def test_bytes_are_those_of_the_segments_in_an_answer() -> None:
    robot = aw.load_robot("planar_rr")
    found = aw.plan(robot, aw.Scene([]), [0.0, 0.0], [1.57, 0.0])
    assert isinstance(found, Plan)
    motion = found.trajectory
    segments = trajectory_answer(motion, None)["segments"]
    assert size(motion) == len(json.dumps(segments, separators=(",", ":")))


def random_plans(count: int) -> list[Plan]:
    """Plans past posts and into a shelf by the Panda, limits of the robot."""
    robot, random = builtin("panda"), np.random.default_rng(12)
    found: list[Plan] = []
    low, high = robot.chain.sampling_bounds()
    while len(found) < count:
        posts = tuple(
            Obstacle(f"post{k}", Cylinder(0.04, 1.0), transform(None, [*place, 0.5]))
            for k, place in enumerate(random.uniform([0.3, -0.6], [0.7, 0.6], (2, 2)))
        )
        scene = shelf() if random.random() < 0.4 else Scene(posts)
        goal = np.clip(HOME + random.normal(scale=0.6, size=7), low, high)
        answer = plan(
            Problem(robot, scene, HOME, (JointGoal(goal),)), Options(timeout=10.0, seed=len(found))
        )
        if isinstance(answer, Plan):
            found.append(answer)
    return found


def test_motions_between_obstacles_have_few_pieces_within_exact_limits() -> None:
    plans = random_plans(20)
    limits = builtin("panda").chain.limits
    for found in plans:
        assert found.certificate.verified
        for order, bound in enumerate((limits.velocity, limits.acceleration, limits.jerk), 1):
            assert worst_ratio(found.trajectory, bound, order) <= 1.0 + 1e-9
    shares = [few(found.trajectory) for found in plans]
    # 97 of 100 of MotionBenchMaker's; of these at most one in ten may be on its path.
    assert np.mean(shares) >= 0.9
    assert np.median([one.trajectory.pieces * LENGTH / max(one.trajectory.duration, LENGTH)
                      for one in plans]) <= 14.0  # fmt: skip


@pytest.mark.parametrize("name", ["panda", "kr6_sixx"])
def test_a_tool_motion_at_a_constant_speed_has_few_pieces(name: str) -> None:
    robot = builtin(name)
    start = HOME if name == "panda" else np.array([0.1, -1.2, 1.6, 0.2, 0.9, 0.0])
    T = forward(robot.chain, start)
    shifts = [[0.0, 0.12, 0.0], [0.0, 0.12, -0.12], [0.0, 0.0, -0.12]]
    ways = tuple(ToolMotionOptions("lin", transform(T[:3, :3], T[:3, 3] + s)) for s in shifts)
    answer = planned_motion(
        Problem(robot, Scene(), start, (PoseGoal(ways[-1].T_base_tip),)),
        Options(
            planner="cartesian",
            cartesian=CartesianOptions(motions=ways, blend=0.03),
            timing=TimingOptions("jerk_limited", tool_speed=0.1),
            timeout=30.0,
        ),
    )
    assert few(answer.trajectory)


def test_a_motion_may_be_given_by_pieces_and_parts() -> None:
    """Two sharp turns in a long motion."""
    names = tuple("abc")
    limits = np.array([[2.0] * 3, [8.0] * 3, [200.0] * 3])
    random = np.random.default_rng(3)
    knots = np.cumsum(random.normal(scale=0.6, size=(5, 3)), axis=0)
    legs = [np.linspace(a, b, 20)[:-1] for a, b in itertools.pairwise(knots)]
    path = np.concatenate([*legs, knots[-1:]])
    times = np.linspace(0.0, 4.0, len(path))
    c = CubicSpline(times, path, bc_type="clamped").c[::-1]
    given = Trajectory(names, times, np.ascontiguousarray(np.moveaxis(c, 0, 2)))
    parts = even_parts(given.duration, 4, 4.0)
    assert np.diff(parts) == pytest.approx(given.duration / 16)
    pieces = Pieces(given.breaks, given.coefficients)
    spline = fit_pieces(pieces, names, limits, parts).trajectory
    assert spline.pieces == 16
    for order, bound in enumerate(limits, 1):
        assert worst_ratio(spline, bound, order) <= 1.0 + 1e-9


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
    arm = PinocchioArm(load=5.0)
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
        torques = arm.torques(answer.trajectory, instants(answer.trajectory))
        strongest = np.abs(torques / robot.chain.limits.effort).max()
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
    chain, arm = robot.chain, PinocchioArm(name)
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
        assert arm.tip_speeds(motion, instants(motion)).max() <= speed * (1.0 + 1e-9)
        _assert_straight(motion, np.array([start, goal]))
    assert few >= 10


#: Length of a motion that pieces and bytes are told for, unless it is shorter [s].
LENGTH = 1.6
#: Pieces of such a motion at most; a span more where its length is rounded up [-].
MOST = 20.5
#: Bytes of such a motion at most [-].
BYTES = 8000.0
#: Random motions: speed of the tool [m/s], largest angle of a joint, least clearance of ends [m],
#: and instants that are judged.
TOOL_SPEED, TURN, CLEAR, INSTANTS = 0.5, 2.6, 2e-3, 500


def instants(motion: Trajectory) -> Array:
    """Instants that are judged."""
    return np.linspace(0.0, motion.duration, INSTANTS)


def size(motion: Trajectory) -> int:
    """Bytes of a motion's segments in an answer."""
    segments = [
        {"t0": a, "t1": b, "coefficients": c.tolist()}
        for a, b, c in zip(motion.breaks, motion.breaks[1:], motion.coefficients, strict=False)
    ]
    return len(json.dumps(segments, separators=(",", ":")))


def random_problems(
    robot: RobotGeometry, count: int, load: float
) -> Iterator[tuple[Problem, Options]]:
    """Random motions among boxes, the tool no faster than ``TOOL_SPEED`` or with a load."""
    random, (low, high) = np.random.default_rng(0), robot.chain.sampling_bounds()
    timing = TimingOptions(tool_speed=TOOL_SPEED)
    if load:
        timing = TimingOptions(torque_limits=True, payload=Payload(load))
    scenes, made = list(own_scenes(30, 0.9, 0)), 0
    while made < count:
        scene = scenes[made % len(scenes)]
        start, end = np.clip(random.uniform(low, high, (2, robot.chain.n)), -TURN, TURN)
        if min(Checker.of(robot, scene).clearance(q)[0] for q in (start, end)) < CLEAR:
            continue
        made += 1
        options = Options(timing=timing, timeout=20.0)
        yield Problem(robot, scene, start, (JointGoal(end),)), options
