"""Paths that follow the tool's motions and bounds of their deviation, beside pinocchio."""

import numpy as np
import pinocchio as pin
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from kinematics.arrays import Array
from kinematics.forward import forward
from kinematics.pose import transform
from planning.timing.path.path import JointPath
from planning.tool_motions.tool_corner import ToolCurve, rounded_corner
from planning.tool_motions.tool_motion import arc_via, line
from planning.tool_motions.tool_path import Tolerances, ToolRun
from planning.tool_paths.tool_deviation import pieces_within, tool_deviations
from planning.tool_paths.tool_following import follow
from planning.values.deadline import Deadline
from tests.planning.pinocchio_arm import PinocchioArm
from tests.planning.scenes import HOME

ORACLE = PinocchioArm()
CHAIN = ORACLE.chain
T = forward(CHAIN, HOME)
TOLERANCES = Tolerances(1e-4, 1e-3)


def shifted(*shift: float) -> Array:
    return transform(T[:3, :3], T[:3, 3] + shift)


LINE = line(T, shifted(0.05, 0.2, -0.1))
TURNING = line(T, transform(Rotation.from_rotvec([0.1, 0.2, 0.4]).as_matrix() @ T[:3, :3],
                            T[:3, 3] + [0.0, 0.15, 0.05]))  # fmt: skip
ARC = arc_via(T, shifted(0.1, 0.1, 0.0), T[:3, 3] + [0.03, 0.07, 0.0])
#: Between lines, the tool turned on the second one; and from an arc to a line.
SHORT = line(T, shifted(0.02, 0.03, -0.02))
CORNER = rounded_corner(SHORT, line(SHORT.T_end, TURNING.T_end), SHORT.length)
BOW = arc_via(T, shifted(0.02, 0.04, 0.0), T[:3, 3] + [0.02, 0.02, 0.0])
BENT = rounded_corner(BOW, line(BOW.T_end, TURNING.T_end), BOW.length)


def led(motion: ToolCurve) -> JointPath:
    run = ToolRun((motion,), (0,), (False,))
    segment = follow(CHAIN, run, HOME, TOLERANCES, Deadline.after(60.0))
    assert segment.path is not None
    assert segment.stop is None
    return segment.path


def within(
    motion: ToolCurve, path: JointPath, tolerances: tuple[float, float]
) -> NDArray[np.bool_]:
    """Whether each piece of a path keeps to a motion."""
    run = ToolRun((motion,), (0,), (False,))
    places = path.breaks / path.length
    return pieces_within(CHAIN, run, places, path.breaks, path.coefficients, tolerances)


@pytest.mark.parametrize(
    "motion",
    [LINE, TURNING, ARC, CORNER, BENT],
    ids=["line", "turning", "arc", "corner", "bent"],
)
def test_a_path_that_follows_is_within_and_as_far_off_as_pinocchio_finds(
    motion: ToolCurve,
) -> None:
    path = led(motion)
    assert within(motion, path, TOLERANCES.pair).all()
    # Beside the motion by far more than the grid of places leaves open.
    aside = path.sample(np.linspace(0.0, path.length, 60)) + 2e-3
    nominal = motion.poses(np.linspace(0.0, 1.0, 4001))
    found = tool_deviations(motion, forward(CHAIN, aside))
    for q, (position, orientation) in zip(aside, found, strict=True):
        pose = ORACLE.pose(q)
        gaps = np.linalg.norm(nominal[:, :3, 3] - pose[:3, 3], axis=1)
        nearest = nominal[int(np.argmin(gaps))]
        turn = Rotation.from_matrix(nearest[:3, :3].T @ pose[:3, :3])
        assert position == pytest.approx(float(gaps.min()), abs=2e-6)
        assert orientation == pytest.approx(turn.magnitude(), abs=4e-4 * motion.angle + 1e-9)


@pytest.mark.parametrize("aside", [5e-4, 1e-3, 0.01])
def test_a_path_that_strays_is_refused_where_it_does(aside: float) -> None:
    """Joint 1 swings aside in the middle of one piece and comes back."""
    path = led(LINE)
    piece = len(path.lengths) // 2
    size = path.coefficients.shape[2]
    c = np.zeros((len(path.lengths), 7, max(size, 5)))
    c[:, :, :size] = path.coefficients
    u = path.lengths[piece]
    # 16 w^2 (1 - w)^2 of the piece, in powers of its own parameter.
    c[piece, 0, 2:5] += 16.0 * aside * np.array([1.0, -2.0, 1.0]) / u ** np.arange(2, 5)
    keeps = within(LINE, JointPath(c, path.lengths), TOLERANCES.pair)
    assert keeps.tolist() == [k != piece for k in range(len(keeps))]


def test_a_turn_on_the_spot_is_measured_about_its_axis() -> None:
    axis = np.array([0.6, 0.0, 0.8])
    spot = line(T, transform(Rotation.from_rotvec(3.0 * axis).as_matrix() @ T[:3, :3], T[:3, 3]))
    poses = spot.poses(np.linspace(0.0, 1.0, 20))
    assert tool_deviations(spot, poses).max() < 1e-12
    poses[:, :3, :3] = Rotation.from_rotvec([0.0, 2e-3, 0.0]).as_matrix() @ poses[:, :3, :3]
    poses[:, :3, 3] += [0.0, 0.0, 1e-3]
    assert tool_deviations(spot, poses) == pytest.approx(np.tile([1e-3, 2e-3], (20, 1)), rel=1e-4)


def test_the_parameter_may_be_time_or_any_other() -> None:
    path, run = led(ARC), ToolRun((ARC,), (0,), (False,))
    scaled = path.coefficients / 3.0 ** np.arange(path.coefficients.shape[2])
    for allowed in (TOLERANCES.pair, (1e-9, 1e-9)):
        three = pieces_within(CHAIN, run, path.breaks, 3.0 * path.breaks, scaled, allowed)
        np.testing.assert_array_equal(within(ARC, path, allowed), three)


NARROW = Tolerances(1e-5, 1e-4)


def test_every_place_of_the_path_is_within_the_tolerances() -> None:
    end = shifted(0.05, 0.3, -0.1)
    segment = follow(CHAIN, ToolRun.of(line(T, end)), HOME, NARROW, Deadline.after(30.0))
    path = segment.path
    assert path is not None
    assert (segment.stop, segment.reached) == (None, 1.0)
    np.testing.assert_array_equal(segment.start, HOME)
    way = end[:3, 3] - T[:3, 3]
    for s in np.linspace(0.0, path.length, 300):
        M = ORACLE.pose(path.sample([s])[0])
        off = M[:3, 3] - T[:3, 3]
        off = off - way * (off @ way) / (way @ way)
        assert np.linalg.norm(off) <= 1e-5
        assert np.linalg.norm(pin.log3(T[:3, :3].T @ M[:3, :3])) <= 1e-4


def test_the_joints_never_jump_and_the_path_is_smooth() -> None:
    segment = follow(
        CHAIN, ToolRun.of(line(T, shifted(0.0, 0.3, 0.0))), HOME, NARROW, Deadline.after(30.0)
    )
    path = segment.path
    assert path is not None
    places = path.breaks[1:-1]
    for order in (0, 1, 2):
        before, after = path.sample(places - 1e-9, order), path.sample(places + 1e-9, order)
        np.testing.assert_allclose(before, after, atol=1e-4)
    steps = np.diff(path.sample(np.linspace(0.0, path.length, 200)), axis=0)
    assert np.abs(steps).max() < 0.05


@pytest.mark.parametrize(
    ("shift", "tolerances", "reasons"),
    [
        ((1.5, 0.0, 0.0), Tolerances(1e-4, None), {"unreachable", "singularity", "limit"}),
        ((0.0, 0.0, -1.2), Tolerances(1e-4, 1e-3), {"limit", "unreachable", "singularity"}),
    ],
)
def test_where_the_arm_ends_so_does_the_path(
    shift: tuple[float, ...], tolerances: Tolerances, reasons: set[str]
) -> None:
    motion = line(T, shifted(*shift))
    segment = follow(CHAIN, ToolRun.of(motion), HOME, tolerances, Deadline.after(60.0))
    assert segment.stop is not None
    assert segment.stop.reason in reasons
    assert 0.0 < segment.reached < 1.0
    reached = forward(CHAIN, segment.end)[:3, 3]
    np.testing.assert_allclose(reached, motion.pose(segment.reached)[:3, 3], atol=1e-4)
    limits = CHAIN.limits
    assert ((segment.end >= limits.lower) & (segment.end <= limits.upper)).all()


def test_time_is_a_reason_too() -> None:
    segment = follow(
        CHAIN, ToolRun.of(line(T, shifted(1.5, 0.0, 0.0))), HOME, NARROW, Deadline.after(0.0)
    )
    assert segment.stop is not None
    assert segment.stop.reason == "time"
