"""Pieces and bytes of motions: what docs/smooth_motions.md says of them, and finer splines."""

import itertools
import json

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

import armwright as aw
from benchmarks.judges.ratios import worst_ratio
from kinematics.forward import forward
from kinematics.pose import transform
from kinematics.trajectory.trajectory import Trajectory
from obstacles.scenes.scene import Obstacle, Scene
from obstacles.shapes.shape import Cylinder
from planning.options import CartesianOptions, Options, ToolMotionOptions
from planning.pipeline.pipeline import plan
from planning.problem import JointGoal, PoseGoal, Problem
from planning.result import Plan
from planning.timing.jerk.even_corners import Pieces
from planning.timing.options import TimingOptions
from planning.timing.spline.quintic_fit import even_parts, finer_parts, fit_pieces, fit_quintic
from service.translate.trajectories import trajectory_answer
from tests.planning.scenes import HOME, builtin, shelf
from tests.planning.timing.motion_judge import BYTES, LENGTH, MOST, size


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
    answer = plan(
        Problem(robot, Scene(), start, (PoseGoal(ways[-1].T_base_tip),)),
        Options(
            planner="cartesian",
            cartesian=CartesianOptions(motions=ways, blend=0.03),
            timing=TimingOptions("jerk_limited", tool_speed=0.1),
            timeout=30.0,
        ),
    )
    assert isinstance(answer, Plan)
    assert few(answer.trajectory)


def test_parts_are_halved_where_a_spline_is_not_near_enough_and_it_is_nearer_then() -> None:
    """Two sharp turns in a long motion: more spans about them bring the spline nearer to them."""
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
    plain = fit_pieces(pieces, names, limits, parts)
    same = fit_quintic(given, names, limits, 4, 4.0)
    np.testing.assert_array_equal(plain.trajectory.coefficients, same.trajectory.coefficients)

    def away(found: Trajectory) -> tuple[float, float]:
        """How far a spline is from the motion's path at most, and when."""
        fine = given.sample(np.linspace(0.0, given.duration, 4001))
        looked = np.linspace(0.0, found.duration, 801)
        gaps = np.array([np.linalg.norm(fine - q, axis=1).min() for q in found.sample(looked)])
        return float(gaps.max()), float(looked[int(np.argmax(gaps))])

    worst, when = away(plain.trajectory)
    for _ in range(4):
        parts = finer_parts(parts, plain.trajectory, np.array([when]))
        plain = fit_pieces(pieces, names, limits, parts)
        for order, bound in enumerate(limits, 1):
            assert worst_ratio(plain.trajectory, bound, order) <= 1.0 + 1e-9
        now, when = away(plain.trajectory)
    assert len(parts) - 1 == 20
    assert now < 0.7 * worst
