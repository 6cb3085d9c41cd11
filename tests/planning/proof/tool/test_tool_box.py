"""Tolerances, lines, arcs and speeds of the tool: closed forms and dense samples with scipy."""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from kinematics.arrays import Array
from kinematics.forward import forward
from kinematics.jacobian import geometric
from kinematics.robots import builtin_chain
from kinematics.trajectory.trajectory import Trajectory
from planning.proof.relative_motion import RelativeMotion
from planning.proof.tool.tool_box import check_tool_boxes
from planning.proof.tool.tool_curve import (
    ALONG,
    AXIS,
    CENTER,
    KIND,
    LENGTH,
    NORMAL,
    ROTATION,
    START,
    SWEEP,
    TURN,
    WIDTH,
    Deviations,
    angle_to_nominal,
    arc_deviation,
    line_deviation,
)
from planning.proof.tool.tool_speed_band import check_speed_bands
from planning.tool_motions.timed_tool_motions import SpeedBand, TimedToolMotions
from planning.tool_motions.tool_motion import ToolMotion, arc_via, line
from planning.tool_motions.tool_tolerance import ToolTolerance

CHAIN = builtin_chain("panda")
MIDDLE = np.array([0.0, -0.4, 0.0, -2.0, 0.0, 1.8, 0.7])
TIMES = np.linspace(0.0, 2.0, 8001)
#: The proof widens a tolerance by the deviations, at least.
HAIR = 1e-7


def random_motion(seed: int) -> Trajectory:
    random = np.random.default_rng(seed)
    q = MIDDLE + np.cumsum(random.normal(0.0, 0.06, (6, 7)), axis=0)
    knots = np.linspace(0.0, 2.0, 6)
    c = CubicSpline(knots, q).c[::-1]
    return Trajectory(CHAIN.joint_names, knots, np.ascontiguousarray(np.moveaxis(c, 0, 2)))


def places(motion: ToolMotion, T: np.ndarray) -> np.ndarray:
    """Place on a motion that each pose is nearest to, not yet cut to [0, 1]."""
    if motion.kind == "lin":
        way = motion.T_end[:3, 3] - motion.T_start[:3, 3]
        return np.asarray((T[:, :3, 3] - motion.T_start[:3, 3]) @ way / (way @ way))
    away = T[:, :3, 3] - motion.center
    first = (motion.T_start[:3, 3] - motion.center) / motion.radius
    angles = np.arctan2(away @ np.cross(motion.normal, first), away @ first)
    return np.unwrap(angles) / motion.sweep


def nominal(motion: ToolMotion, s: np.ndarray) -> np.ndarray:
    """Poses at places from 0 to 1 (k,) by scipy's rotations, shape (k, 4, 4)."""
    N = np.tile(np.eye(4), (len(s), 1, 1))
    turned = Rotation.from_rotvec(s[:, None] * motion.turn).as_matrix()
    N[:, :3, :3] = turned @ motion.T_start[:3, :3]
    start = motion.T_start[:3, 3]
    if motion.kind == "lin":
        N[:, :3, 3] = start + s[:, None] * (motion.T_end[:3, 3] - start)
    else:
        spokes = Rotation.from_rotvec(s[:, None] * motion.sweep * motion.normal)
        N[:, :3, 3] = motion.center + spokes.apply(start - motion.center)
    return N


def euler(motion: ToolMotion, T: np.ndarray, axes: np.ndarray | None) -> np.ndarray:
    """Deviations by scipy, shape (k, 6)."""
    s = np.clip(places(motion, T), 0.0, 1.0)
    N = nominal(motion, s)
    A = N[:, :3, :3] if axes is None else np.broadcast_to(axes, (len(s), 3, 3))
    relative = T[:, :3, :3] @ np.swapaxes(N[:, :3, :3], 1, 2)
    D = np.swapaxes(A, 1, 2) @ relative @ A
    e = np.einsum("kji,kj->ki", A, T[:, :3, 3] - N[:, :3, 3])
    return np.column_stack([e, Rotation.from_matrix(D).as_euler("XYZ")])


@pytest.mark.parametrize("seed", range(12))
def test_a_box_is_proved_exactly_where_dense_samples_keep_it(seed: int) -> None:
    trajectory = random_motion(seed)
    T = forward(CHAIN, trajectory.sample(TIMES))
    motion = line(T[0], T[-1])
    if seed % 2:
        motion = arc_via(T[0], T[-1], T[len(T) // 2, :3, 3] + [0.0, 0.0, 0.01])
    at = places(motion, T)
    if at.min() < -HAIR or at.max() > 1.0 + HAIR:
        motion = _long_line(T)
    _check_box_is_sharp(trajectory, motion, T, seed)


@pytest.mark.parametrize("seed", range(6))
def test_a_box_is_proved_exactly_beyond_the_ends_of_a_motion(seed: int) -> None:
    trajectory = random_motion(seed)
    T = forward(CHAIN, trajectory.sample(TIMES))
    first, last = len(T) // 4, 3 * len(T) // 4
    motion = line(T[first], T[last])
    if seed % 2:
        motion = arc_via(T[first], T[last], T[len(T) // 2, :3, 3] + [0.0, 0.0, 0.01])
    at = places(motion, T)
    assert at.min() < -0.01 or at.max() > 1.01
    _check_box_is_sharp(trajectory, motion, T, seed)


def _check_box_is_sharp(
    trajectory: Trajectory, motion: ToolMotion, T: np.ndarray, seed: int
) -> None:
    """A box a little wider than the deviations is proved, one a little narrower is refused."""
    axes = Rotation.random(random_state=seed).as_matrix() if seed % 3 else None
    d = euler(motion, T, axes)
    middle, half = 0.5 * (d.max(axis=0) + d.min(axis=0)), 0.5 * np.ptp(d, axis=0)
    for factor, kept in ((1.04, True), (0.96, False)):
        box = ToolTolerance(middle - factor * half, middle + factor * half, axes=axes)
        asked = TimedToolMotions((motion,), np.array([0.0, 2.0]), HAIR, HAIR, (box,))
        use, violation = check_tool_boxes(CHAIN, trajectory, asked)
        assert use is not None
        assert use.verified is kept
        assert (violation is None) is kept
        if kept:
            assert 0.95 < use.share <= 1.0


def _long_line(T: np.ndarray) -> ToolMotion:
    """The line through the ends of some poses, that goes on beyond them on either side."""
    way = T[-1, :3, 3] - T[0, :3, 3]
    way *= 1.5 / np.linalg.norm(way)
    start, end = T[0].copy(), T[-1].copy()
    start[:3, 3] -= way
    end[:3, 3] += way
    return line(start, end)


def test_a_tilt_is_proved_exactly_where_dense_samples_keep_it() -> None:
    trajectory = random_motion(3)
    T = forward(CHAIN, trajectory.sample(TIMES))
    motion = _long_line(T)
    s = np.clip(places(motion, T), 0.0, 1.0)
    cosine = np.einsum("ki,ki->k", nominal(motion, s)[:, :3, 2], T[:, :3, 2])
    most = float(np.arccos(cosine.min()))
    wide = np.array([0.9] * 3 + [1.35] * 2 + [np.inf])
    for factor, kept in ((1.03, True), (0.97, False)):
        box = ToolTolerance(-wide, wide, tilt=factor * most)
        asked = TimedToolMotions((motion,), np.array([0.0, 2.0]), HAIR, HAIR, (box,))
        use, _ = check_tool_boxes(CHAIN, trajectory, asked)
        assert use is not None
        assert use.verified is kept


def test_speeds_are_those_of_the_jacobian() -> None:
    trajectory = random_motion(1)
    q, rates = trajectory.sample(TIMES), trajectory.sample(TIMES, 1)
    speeds = np.array(
        [np.linalg.norm(geometric(CHAIN, a)[:3] @ b) for a, b in zip(q, rates, strict=True)]
    )
    low, high = np.quantile(speeds, 0.3), 1.01 * speeds.max()
    use, violation = check_speed_bands(CHAIN, trajectory, [SpeedBand(low, high, ((0.0, 2.0),))])
    assert use is not None
    assert violation is None
    inside = speeds[speeds >= low].sum() / speeds.sum()
    assert inside - 2e-3 <= use.share <= inside + 1e-3
    assert speeds.max() <= use.most <= high
    assert use.least == pytest.approx(speeds.min(), abs=2e-2)
    slow = SpeedBand(0.0, 0.97 * speeds.max(), ((0.0, 2.0),))
    use, violation = check_speed_bands(CHAIN, trajectory, [slow])
    assert use is not None
    assert not use.verified
    assert violation is not None
    assert speeds[np.argmin(np.abs(TIMES - violation.time))] >= 0.96 * speeds.max()
    assert check_speed_bands(CHAIN, trajectory, []) == (None, None)


ARC, RADIUS, SWEPT = 1.0, 0.5, 2.0


def tool_curve_line(start: Array, along: Array, length: float) -> Array:
    m = np.zeros(WIDTH)
    m[START : START + 3], m[ALONG : ALONG + 3], m[LENGTH] = start, along, length
    m[ROTATION:] = np.eye(3).ravel()
    return m


def arc(sweep: float = SWEPT) -> Array:
    """Half a metre about the origin, from the x axis towards y."""
    m = np.zeros(WIDTH)
    m[KIND], m[ALONG : ALONG + 3], m[NORMAL : NORMAL + 3] = ARC, [1, 0, 0], [0, 0, 1]
    m[CENTER : CENTER + 3], m[LENGTH], m[SWEEP] = [0, 0, 0], RADIUS, sweep
    m[ROTATION:] = np.eye(3).ravel()
    return m


def vector(v: Array) -> tuple[float, float, float]:
    return float(v[0]), float(v[1]), float(v[2])


def steady(velocity: Array, half: float, turn_rate: Array | None = None) -> RelativeMotion:
    """A point at a constant velocity, of a link that turns at a constant rate."""
    w = np.zeros(3) if turn_rate is None else turn_rate
    speed, turning = float(np.linalg.norm(velocity)), float(np.linalg.norm(w))
    return RelativeMotion(
        vector(velocity), vector(w), speed * half, 0.0, 0.0, turning * half, 0.0, turning, 0.0
    )


def empty(R: Array | None = None) -> Deviations:
    T = np.zeros((3, 4))
    T[:, :3] = np.eye(3) if R is None else R
    return Deviations(np.zeros(2), np.zeros(2), T)


def off_segment(points: Array, start: Array, along: Array, length: float) -> Array:
    x = np.clip((points - start) @ along, 0.0, length)
    return np.asarray(np.linalg.norm(points - start - x[:, None] * along, axis=1))


def unit(v: Array) -> Array:
    return np.asarray(v / np.linalg.norm(v))


def test_off_a_line_it_is_the_distance_from_the_segment() -> None:
    random = np.random.default_rng(1)
    for _ in range(60):
        start, along, length = random.normal(size=3), unit(random.normal(size=3)), 0.7
        p, v, half = start + random.normal(size=3) * 0.5, random.normal(size=3), 0.1
        found = empty()
        judged, s, pace, bend = line_deviation(
            tool_curve_line(start, along, length),
            vector(p),
            steady(v, half),
            half,
            np.zeros(3),
            found,
        )
        assert judged
        assert found.now[0] == pytest.approx(off_segment(p[None], start, along, length)[0])
        assert s == pytest.approx((p - start) @ along / length)
        assert pace == pytest.approx(v @ along / length)
        assert bend == 0.0
        times = np.linspace(-half, half, 41)[:, None]
        dense = off_segment(p + times * v, start, along, length)
        assert dense.max() <= found.upper[0] + 1e-12
        assert found.upper[0] <= dense.max() + 2.0 * half * float(np.linalg.norm(v))


def test_along_a_line_motion_costs_nothing() -> None:
    along, half = np.array([1.0, 0.0, 0.0]), 0.2
    found = empty()
    p = (0.5, 0.03, 0.0)
    line_deviation(
        tool_curve_line(np.zeros(3), along, 1.0), p, steady(along, half), half, np.zeros(3), found
    )
    assert found.now[0] == found.upper[0] == pytest.approx(0.03)
    # Across it, it does; and so does what is not known of the motion.
    across = steady(np.array([0.0, 1.0, 0.0]), half)._replace(bend=0.01)
    line_deviation(tool_curve_line(np.zeros(3), along, 1.0), p, across, half, np.zeros(3), found)
    assert found.upper[0] == pytest.approx(0.03 + 0.2 + 0.01)


@pytest.mark.parametrize(("x", "over"), [(-0.2, 0.2), (1.3, 0.3), (0.95, 0.0)])
def test_beyond_its_ends_a_line_ends(x: float, over: float) -> None:
    along, found = np.array([1.0, 0.0, 0.0]), empty()
    m = tool_curve_line(np.zeros(3), along, 1.0)
    line_deviation(m, (x, 0.1, 0.0), steady(along, 0.1), 0.1, np.zeros(3), found)
    assert found.now[0] == pytest.approx(np.hypot(0.1, over))
    assert found.upper[0] == pytest.approx(np.hypot(0.1, max(0.0, 0.1 - x, x + 0.1 - 1.0)))


def test_a_turn_on_the_spot_is_followed_by_its_angle() -> None:
    m = tool_curve_line(np.zeros(3), np.zeros(3), 0.0)
    m[AXIS : AXIS + 3], m[TURN] = [0.0, 0.0, 1.0], 4.0
    w, place = np.array([0.0, 0.0, 2.0]), np.zeros(3)
    for angle in (0.0, 0.5, 1.5, 3.0, 3.5, 4.0):
        found = empty(Rotation.from_rotvec([0.0, 0.0, angle]).as_matrix())
        spread = steady(np.zeros(3), 0.01, w)
        judged, s, pace, _ = line_deviation(m, (0.0, 0.1, 0.0), spread, 0.01, place, found)
        assert judged
        # Beyond half a turn too: the angle goes on from where it was.
        assert s == pytest.approx(angle / 4.0)
        assert pace == pytest.approx(0.5)
        assert found.now[0] == pytest.approx(0.1)
    judged, *_ = line_deviation(m, (0.0, 0.0, 0.0), steady(w, 1.0, w), 1.0, place, empty())
    assert not judged


def test_standing_still_has_one_place() -> None:
    found = empty()
    m = tool_curve_line(np.array([1.0, 0.0, 0.0]), np.zeros(3), 0.0)
    asked = line_deviation(
        m, (1.0, 0.0, 0.2), steady(np.ones(3), 5.0, np.ones(3)), 5.0, np.zeros(3), found
    )
    assert asked == (True, 0.0, 0.0, 0.0)
    assert found.now[0] == pytest.approx(0.2)


def off_arc(points: Array, sweep: float) -> Array:
    """An upper bound of the distance from the arc: radial and axial, and along it past its ends."""
    phi = np.arctan2(points[:, 1], points[:, 0])
    over = RADIUS * np.maximum(0.0, np.maximum(-phi, phi - sweep))
    radial = np.hypot(np.hypot(points[:, 0], points[:, 1]) - RADIUS, points[:, 2])
    return np.asarray(np.hypot(radial, over))


def test_off_an_arc_it_is_radial_and_axial_distance() -> None:
    random = np.random.default_rng(2)
    judged_ones = 0
    for _ in range(80):
        phi = random.uniform(-0.3, SWEPT + 0.3)
        r, z = random.uniform(0.3, 0.8), random.normal() * 0.1
        p = np.array([r * np.cos(phi), r * np.sin(phi), z])
        v, half, found = random.normal(size=3) * 0.3, 0.1, empty()
        judged, s, pace, bend = arc_deviation(
            arc(), vector(p), steady(v, half), half, np.zeros(3), found
        )
        if not judged:
            continue
        judged_ones += 1
        assert found.now[0] == pytest.approx(off_arc(p[None], SWEPT)[0])
        assert s == pytest.approx(phi / SWEPT)
        # How fast the angle changes, and by how much that can change.
        times = np.linspace(-half, half, 41)
        path = p + times[:, None] * v
        angles = np.unwrap(np.arctan2(path[:, 1], path[:, 0]))
        slope = (angles[21] - angles[19]) / (times[21] - times[19])
        assert pace == pytest.approx(slope / SWEPT, abs=1e-3)
        rest = np.abs(angles - angles[20] - pace * SWEPT * times)
        assert (rest <= 0.5 * bend * SWEPT * times**2 + 1e-9).all()
        assert off_arc(path, SWEPT).max() <= found.upper[0] + 1e-12
    assert judged_ones > 60


def test_around_an_arc_the_angle_is_followed_past_a_turn() -> None:
    m, place = arc(3.0 * np.pi), np.zeros(3)
    for phi in np.arange(0.0, 3.0 * np.pi, 0.3):
        p, v = RADIUS * np.array([np.cos(phi), np.sin(phi), 0.0]), np.zeros(3)
        judged, s, _, _ = arc_deviation(m, vector(p), steady(v, 0.1), 0.1, place, empty())
        assert judged
        assert s == pytest.approx(phi / (3.0 * np.pi))


@pytest.mark.parametrize(
    ("place", "velocity"),
    [((0.1, 0.0, 0.0), (-1.0, 0.0, 0.0)), ((0.5, 0.0, 0.0), (0.0, 1.9, 0.0))],
    ids=["towards the centre", "too far around"],
)
def test_what_turns_too_far_is_not_judged(
    place: tuple[float, float, float], velocity: tuple[float, float, float]
) -> None:
    spread = steady(np.array(velocity), 0.1)
    assert not arc_deviation(arc(), place, spread, 0.1, np.zeros(3), empty())[0]
    short = steady(np.array(velocity), 0.01)
    assert arc_deviation(arc(), place, short, 0.01, np.zeros(3), empty())[0]


@pytest.mark.parametrize("turn", [0.0, 1e-9, 0.7, 3.0])
def test_the_angle_to_the_nominal_orientation_is_that_of_scipy(turn: float) -> None:
    random = np.random.default_rng(3)
    for s in (0.0, 0.25, 1.0, 1.2):
        R0, off = Rotation.random(random_state=random), random.normal(size=3) * 0.4
        axis = unit(random.normal(size=3))
        m = tool_curve_line(np.zeros(3), np.zeros(3), 1.0)
        m[AXIS : AXIS + 3], m[TURN], m[ROTATION:] = axis, turn, R0.as_matrix().ravel()
        nominal = Rotation.from_rotvec(s * turn * axis) * R0
        T = np.zeros((3, 4))
        T[:, :3] = (Rotation.from_rotvec(off) * nominal).as_matrix()
        assert angle_to_nominal(m, s, T) == pytest.approx(float(np.linalg.norm(off)), abs=1e-9)
        T[:, :3] = nominal.as_matrix()
        assert angle_to_nominal(m, s, T) == pytest.approx(0.0, abs=1e-15 + 1e-8 * (turn > 0))
