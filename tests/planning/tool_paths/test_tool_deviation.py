"""Bounds of the tool's deviation from lines and arcs, against pinocchio at dense samples."""

import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation

from kinematics.arrays import Array
from kinematics.forward import forward
from kinematics.pose import transform
from planning.timing.path.path import JointPath
from planning.tool_motions.tool_corner import ToolCurve, rounded_corner
from planning.tool_motions.tool_motion import arc_via, line
from planning.tool_motions.tool_path import Tolerances, ToolRun
from planning.tool_paths.tool_deviation import piece_deviations
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


def deviations(motion: ToolCurve, path: JointPath, pieces: int, samples: int = 41) -> Array:
    """Largest deviations of position and orientation on each piece, by pinocchio, (pieces, 2)."""
    answer = np.zeros((pieces, 2))
    fine = motion.poses(np.linspace(0.0, 1.0, 4001))
    points = fine[:, :3, 3]
    for piece in range(pieces):
        span = path.breaks[piece] + path.lengths[piece] * np.linspace(0.0, 1.0, samples)
        for place in np.minimum(span, path.length):
            pose = ORACLE.pose(path.sample([place])[0])
            gaps = np.linalg.norm(points - pose[:3, 3], axis=1)
            nearest = int(np.argmin(gaps))
            off = pose[:3, 3] - points[nearest]
            low, high = max(nearest - 1, 0), min(nearest + 1, len(points) - 1)
            along = (points[high] - points[low]) / np.linalg.norm(points[high] - points[low])
            across = float(np.linalg.norm(off - (off @ along) * along))
            turn = Rotation.from_matrix(fine[nearest][:3, :3].T @ pose[:3, :3])
            left = float(turn.magnitude())
            answer[piece] = np.maximum(answer[piece], np.array([across, left]))
    return answer


@pytest.mark.parametrize(
    "motion",
    [LINE, TURNING, ARC, CORNER, BENT],
    ids=["line", "turning", "arc", "corner", "bent"],
)
def test_a_path_that_follows_is_proved_and_its_bounds_are_not_below_pinocchio(
    motion: ToolCurve,
) -> None:
    path = led(motion)
    bounds, fine, _ = piece_deviations(
        CHAIN, path.breaks, path.coefficients, motion, TOLERANCES.pair
    )
    assert bounds.shape == (len(path.lengths), 2)
    assert fine.all()
    assert (bounds <= TOLERANCES.pair).all()
    sampled = deviations(motion, path, min(len(path.lengths), 6))
    # The grid of the oracle's places leaves a millionth on an arc, and turns by a few of them.
    slack = [2e-6, 4e-4 * motion.angle + 1e-9]
    assert (sampled <= bounds[: len(sampled)] + slack).all()


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
    bounds, fine, where = piece_deviations(CHAIN, path.breaks, c, LINE, TOLERANCES.pair)
    bent = JointPath(c, path.lengths)
    off = deviations(LINE, bent, len(path.lengths), 9)[piece, 0] if aside > 5e-4 else 0.0
    others = np.delete(np.arange(len(path.lengths)), piece)
    assert fine[others].all()
    assert not fine[piece]
    assert path.breaks[piece] <= where[piece] <= path.breaks[piece + 1]
    assert bounds[piece, 0] > TOLERANCES.position
    if off:
        assert bounds[piece, 0] <= 1.3 * off


def test_bounds_are_sharp_where_they_matter() -> None:
    """A tool that stands 2 mm beside its line, 2.4 mm allowed: at most a quarter is added."""
    path = led(LINE)
    beside = line(shifted(0.0, 0.0, 0.002), shifted(0.05, 0.2, -0.098))
    off = np.array([0.05, 0.2, -0.1]) / np.linalg.norm([0.05, 0.2, -0.1])
    across = 0.002 * float(np.linalg.norm(np.array([0, 0, 1]) - off[2] * off))
    for allowed, verdict in ((1.2 * across, True), (0.95 * across, False)):
        bounds, fine, _ = piece_deviations(
            CHAIN, path.breaks, path.coefficients, beside, (allowed, np.inf)
        )
        # Ends of the motion count too: there the start is beside by all of it.
        inner = slice(2, -2)
        assert (fine[inner] == verdict).all()
        if verdict:
            assert (bounds[inner, 0] >= across - 2e-6).all()
            assert (bounds[inner, 0] <= allowed).all()


def test_a_deviation_that_grows_along_a_piece_is_bounded_at_its_far_end_and_not_by_much_more() -> (
    None
):
    """The line that is followed and the one it is held to part at an angle."""
    path, allowed = led(LINE), 0.05
    other = line(T, shifted(0.05, 0.2, -0.07))
    bounds, fine, _ = piece_deviations(
        CHAIN, path.breaks, path.coefficients, other, (allowed, np.inf)
    )
    sampled = deviations(other, path, len(path.lengths), 11)[:, 0]
    assert fine.all()
    assert sampled[-1] > 0.01
    assert (sampled <= bounds[:, 0] + 1e-6).all()
    assert (bounds[:, 0] <= np.maximum(1.25 * sampled + 1e-6, 0.1 * allowed)).all()


def test_the_parameter_may_be_time_or_any_other() -> None:
    path = led(ARC)
    scaled = path.coefficients / 3.0 ** np.arange(path.coefficients.shape[2])
    one = piece_deviations(CHAIN, path.breaks, path.coefficients, ARC, TOLERANCES.pair)
    three = piece_deviations(CHAIN, 3.0 * path.breaks, scaled, ARC, TOLERANCES.pair)
    np.testing.assert_array_equal(one[1], three[1])
    np.testing.assert_allclose(one[0], three[0], atol=1e-9)


NARROW = Tolerances(1e-5, 1e-4)


def test_every_place_of_the_path_is_within_the_tolerances() -> None:
    end = shifted(0.05, 0.3, -0.1)
    segment = follow(CHAIN, line(T, end), HOME, NARROW, Deadline.after(30.0))
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
    segment = follow(CHAIN, line(T, shifted(0.0, 0.3, 0.0)), HOME, NARROW, Deadline.after(30.0))
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
    segment = follow(CHAIN, motion, HOME, tolerances, Deadline.after(60.0))
    assert segment.stop is not None
    assert segment.stop.reason in reasons
    assert 0.0 < segment.reached < 1.0
    reached = forward(CHAIN, segment.end)[:3, 3]
    np.testing.assert_allclose(reached, motion.pose(segment.reached)[:3, 3], atol=1e-4)
    limits = CHAIN.limits
    assert ((segment.end >= limits.lower) & (segment.end <= limits.upper)).all()


def test_time_is_a_reason_too() -> None:
    segment = follow(CHAIN, line(T, shifted(1.5, 0.0, 0.0)), HOME, NARROW, Deadline.after(0.0))
    assert segment.stop is not None
    assert segment.stop.reason == "time"
