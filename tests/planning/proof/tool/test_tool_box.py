"""The proof of tolerances and speeds of the tool against dense samples with scipy."""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from kinematics.forward import forward
from kinematics.jacobian import geometric
from kinematics.robots import builtin_chain
from kinematics.trajectory.trajectory import Trajectory
from planning.proof.tool.tool_box import check_tool_boxes
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
