"""Rounded corners against Bezier curves, quadrature, clothoids and finite differences."""

import math

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.interpolate import BPoly
from scipy.spatial.transform import Rotation

from kinematics.arrays import Array
from kinematics.pose import transform
from planning.tool_motions.tool_corner import ToolCorner, ToolCurve, rounded_corner
from planning.tool_motions.tool_motion import ToolMotion, arc_via, line


def at(*place: float) -> Array:
    return transform(None, list(place))


def bend(angle: float, distance: float = 0.1) -> ToolCorner:
    """A corner of this angle at (1, 0, 0) between lines of one metre."""
    end = at(1.0 + math.cos(angle), math.sin(angle), 0.0)
    return rounded_corner(line(at(0, 0, 0), at(1, 0, 0)), line(at(1, 0, 0), end), distance)


def random_motions(random: np.random.Generator) -> tuple[ToolMotion, ToolMotion]:
    """Two motions that meet, lines or arcs, with turns of the tool."""
    poses = [
        transform(Rotation.from_rotvec(0.6 * random.normal(size=3)).as_matrix(), place)
        for place in random.normal(size=(3, 3))
    ]
    kinds = random.random(2) < 0.5
    first, second = (
        line(a, b) if straight else arc_via(a, b, random.normal(size=3))
        for straight, a, b in zip(kinds, poses[:-1], poses[1:], strict=True)
    )
    return first, second


def bezier(corner: ToolCorner) -> BPoly:
    """The curve between lines, as scipy has it."""
    p, c, r = (T[:3, 3] for T in (corner.T_start, corner.T_corner, corner.T_end))
    steps = [0.2 * corner.slope, 0.4 * corner.slope]
    points = [p, *(p + s * (c - p) for s in steps), *(r + s * (c - r) for s in steps[::-1]), r]
    return BPoly(np.array(points)[:, None, :], [0.0, 1.0])


@pytest.mark.parametrize("degrees", [0.5, 20.0, 90.0, 150.0, 169.0])
def test_between_lines_it_is_a_bezier_curve_run_through_by_its_length(degrees: float) -> None:
    corner = bend(math.radians(degrees))
    curve = bezier(corner)
    rate = curve.derivative()

    def speed(u: float) -> float:
        return float(np.linalg.norm(rate(u)))

    assert corner.length == pytest.approx(quad(speed, 0.0, 1.0, epsabs=1e-13)[0], rel=1e-10)
    for u in (0.03, 0.21, 0.5, 0.77, 0.99):
        place = quad(speed, 0.0, u, epsabs=1e-13)[0] / corner.length
        np.testing.assert_allclose(corner.pose(place)[:3, 3], curve(u), atol=1e-10)
        np.testing.assert_allclose(corner.direction(place), rate(u) / speed(u), atol=1e-7)


def test_no_part_is_farther_from_the_corner_than_the_blend_begins() -> None:
    random = np.random.default_rng(5)
    for _ in range(100):
        first, second = random_motions(random)
        distance = random.uniform(0.01, 0.5) * min(first.length, second.length)
        corner = rounded_corner(first, second, distance)
        away = corner.poses(np.linspace(0.0, 1.0, 101))[:, :3, 3] - first.T_end[:3, 3]
        assert np.linalg.norm(away, axis=1).max() <= distance * (1.0 + 1e-9)


def derivatives(motion: ToolCurve, s: float, h: float) -> list[Array]:
    """Tangent, curvature, angular velocity and its change by the length at an end, one-sided."""
    step = h / motion.length
    sign = 1.0 if s == 0.0 else -1.0
    T = motion.poses(np.asarray(s + sign * step * np.arange(6.0), dtype=np.float64))
    p = T[:, :3, 3]
    w = Rotation.from_matrix(T[1:, :3, :3] @ T[:-1, :3, :3].transpose(0, 2, 1)).as_rotvec()
    w = sign * w / h
    # One-sided differences of fourth order; angular velocities are those half a step on.
    first = (
        sign * (-25.0 * p[0] + 48.0 * p[1] - 36.0 * p[2] + 16.0 * p[3] - 3.0 * p[4]) / (12.0 * h)
    )
    second = (45.0 * p[0] - 154.0 * p[1] + 214.0 * p[2] - 156.0 * p[3] + 61.0 * p[4]
              - 10.0 * p[5]) / (12.0 * h * h)  # fmt: skip
    rate = (35.0 * w[0] - 35.0 * w[1] + 21.0 * w[2] - 5.0 * w[3]) / 16.0
    change = sign * (-71.0 * w[0] + 141.0 * w[1] - 93.0 * w[2] + 23.0 * w[3]) / (24.0 * h)
    return [first, second, rate, change]


def test_tangent_curvature_and_turning_join_both_motions_without_a_jump() -> None:
    random = np.random.default_rng(8)
    for _ in range(60):
        first, second = random_motions(random)
        distance = 0.4 * min(first.length, second.length)
        corner = rounded_corner(first, second, distance)
        h = 2e-3 * distance
        before, after = corner.first, corner.second
        for one, other, motion in ((corner, before, first), (corner, after, second)):
            s = 0.0 if other is before else 1.0
            mine = derivatives(one, s, h)
            place = 1.0 - distance / first.length if s == 0.0 else distance / second.length
            turn = motion.turn / motion.length
            curvature = (
                np.zeros(3)
                if motion.kind == "lin"
                else np.cross(motion.normal, motion.direction(place)) / motion.radius
            )
            wanted = [motion.direction(place), curvature, turn, np.zeros(3)]
            for value, known, order in zip(mine, wanted, (0, 1, 1, 2), strict=True):
                np.testing.assert_allclose(value * distance**order, known * distance**order,
                                           atol=5e-3)  # fmt: skip


def curvature_change(corner: ToolCorner) -> float:
    """Largest change of curvature by the length [1/m^2]."""
    p = corner.poses(np.linspace(0.0, 1.0, 4001))[:, :2, 3]
    h = corner.length / 4000.0
    t = np.diff(p, axis=0)
    angle = np.unwrap(np.arctan2(t[:, 1], t[:, 0]))
    return float(np.abs(np.diff(angle, 2)).max() / h**2)


@pytest.mark.parametrize("degrees", [5.0, 40.0, 75.0, 110.0, 145.0, 165.0])
def test_curvature_changes_little_faster_than_along_two_clothoids(degrees: float) -> None:
    """A pair of clothoids has the least largest change of curvature between two lines."""
    half = 0.5 * math.radians(degrees)
    # Of a clothoid of length 1 that turns by half of the corner.
    x, y = (quad(lambda s, f=f: f(half * s * s), 0.0, 1.0)[0] for f in (math.cos, math.sin))
    reach = x + y * math.tan(half)
    least = 2.0 * half * (reach / 0.1) ** 2
    assert curvature_change(bend(2.0 * half)) <= 1.2 * least
