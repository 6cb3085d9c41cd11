"""Times at which motions pass the ends of tool motions, against dense samples and a closed form."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from kinematics.forward import forward
from kinematics.pose import transform
from kinematics.trajectory.trajectory import Trajectory
from planning.timing.path.path import JointPath
from planning.tool_motions.passing_times import passing_times
from planning.tool_motions.tool_motion import line
from planning.tool_motions.tool_path import ToolRun
from planning.tool_motions.tool_tolerance import ToolTolerance
from planning.tool_paths.tool_deviation import pieces_within
from tests.planning.scenes import HOME, builtin

CHAIN = builtin("panda").chain
PLACES = np.array([0.0, 0.2, 0.45, 0.7, 1.0])


def curve() -> CubicSpline:
    """A joint path near a straight line of the tool: joints in proportion to the place."""
    q = np.array([HOME + s * np.array([0.3, 0.1, 0.0, 0.1, 0.0, 0.0, 0.2]) for s in PLACES])
    return CubicSpline(PLACES, q)


def as_path(spline: CubicSpline) -> JointPath:
    return JointPath(
        np.ascontiguousarray(np.moveaxis(spline.c[::-1], 0, 2)), np.diff(np.asarray(spline.x))
    )


def in_time(duration: float) -> Trajectory:
    """The path with s = 3 u^2 - 2 u^3, u = t / T, as one polynomial: joints are linear in s."""
    rate = np.array([0.3, 0.1, 0.0, 0.1, 0.0, 0.0, 0.2])
    c = np.zeros((1, 7, 4))
    c[0, :, 0] = HOME
    c[0, :, 2], c[0, :, 3] = 3.0 * rate / duration**2, -2.0 * rate / duration**3
    return Trajectory(CHAIN.joint_names, np.array([0.0, duration]), c)


def polyline(tolerant: bool) -> ToolRun:
    """The tool's poses at the places, joined by lines."""
    T = forward(CHAIN, curve()(PLACES))
    motions = tuple(line(a, b) for a, b in pairwise(T))
    boxes = (ToolTolerance.of({}),) * 4 if tolerant else ()
    return ToolRun(motions, tuple(range(4)), (False,) * 4, boxes)


def closed_form(duration: float, places: np.ndarray) -> np.ndarray:
    """Times of 3 u^2 - 2 u^3 = s."""
    u = [np.roots([-2.0, 3.0, 0.0, -s]) for s in places]
    inside = [r[(np.abs(r.imag) < 1e-9) & (r.real >= 0.0) & (r.real <= 1.0)] for r in u]
    return duration * np.array([float(r.real[0]) for r in inside])


@pytest.mark.parametrize("duration", [0.5, 2.0])
def test_a_tolerant_run_passes_the_plane_across_its_corners(duration: float) -> None:
    run, motion = polyline(tolerant=True), in_time(duration)
    times = passing_times(CHAIN, as_path(curve()), motion, run.parts)
    assert times[-1] == duration
    np.testing.assert_allclose(times[:-1], closed_form(duration, PLACES[1:-1]), rtol=1e-9)
    for part, other, time in zip(run.parts[:-1], run.parts[1:], times[:-1], strict=True):
        p = forward(CHAIN, motion.sample([time]))[0, :3, 3]
        across = part.motion.direction(1.0) + other.motion.direction(0.0)
        assert abs((p - part.motion.T_end[:3, 3]) @ across) < 1e-12


def test_beside_a_sharp_corner_the_plane_halves_the_angle() -> None:
    T = forward(CHAIN, HOME)
    motion = in_time(2.0)
    p = forward(CHAIN, motion.sample(np.linspace(0.0, 2.0, 3)))[:, :3, 3]
    # The corner lies beside the way of the tool, whose middle is in the plane that halves it.
    way = (p[2] - p[0]) / np.linalg.norm(p[2] - p[0])
    side = np.cross(way, [0.0, 0.0, 1.0])
    along = [way + 0.8 * side, way - 0.8 * side]
    corner = p[1] + 0.05 * side
    ends = [corner - 0.2 * along[0], corner, corner + 0.2 * along[1]]
    poses = [transform(T[:3, :3], end) for end in ends]
    lines = tuple(line(one, other) for one, other in pairwise(poses))
    boxes = (ToolTolerance.of({"x": (-0.1, 0.1)}),) * 2
    run = ToolRun(lines, (0, 1), (False,) * 2, boxes)
    time, _ = passing_times(CHAIN, as_path(curve()), motion, run.parts)
    assert time == pytest.approx(1.0, abs=1e-9)


def test_an_exact_run_ends_its_parts_where_the_joints_are_nearest() -> None:
    run, motion = polyline(tolerant=False), in_time(2.0)
    # Corners are looked for among the breaks of the joint path, in its own parameter.
    spline = CubicSpline(run.breaks, curve()(PLACES))
    times = passing_times(CHAIN, as_path(spline), motion, run.parts)
    np.testing.assert_allclose(times[:-1], closed_form(2.0, PLACES[1:-1]), rtol=1e-6)
    assert times[-1] == 2.0


def test_one_part_ends_with_the_motion() -> None:
    run = polyline(tolerant=True)
    motion = in_time(1.5)
    assert passing_times(CHAIN, as_path(curve()), motion, run.parts[:1]) == [1.5]


@pytest.mark.parametrize("factor", [1.2, 0.8])
def test_pieces_near_their_lines_are_told_from_others(factor: float) -> None:
    run, spline = polyline(tolerant=False), curve()
    path = as_path(spline)
    away = []
    for k, (low, high) in enumerate(pairwise(PLACES)):
        p = forward(CHAIN, spline(np.linspace(low, high, 400)))[:, :3, 3]
        a, b = run.motions[k].T_start[:3, 3], run.motions[k].T_end[:3, 3]
        along = (b - a) / np.linalg.norm(b - a)
        off = p - a
        away.append(float(np.linalg.norm(off - np.outer(off @ along, along), axis=1).max()))
    limit = factor * sorted(away)[2]
    within = pieces_within(CHAIN, run, run.breaks, path.breaks, path.coefficients, (limit, np.inf))
    sure = np.abs(np.array(away) / limit - 1.0) > 0.1
    assert sure.sum() >= 2
    np.testing.assert_array_equal(within[sure], np.array(away)[sure] <= limit)
    far = pieces_within(CHAIN, run, run.breaks, path.breaks, path.coefficients, (1e-9, np.inf))
    assert not far.any()
