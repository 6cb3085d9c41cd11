"""Joint paths along one motion of the tool, judged by pinocchio, and why they stop."""

import numpy as np
import pinocchio as pin
import pytest

from kinematics.forward import forward
from kinematics.pose import transform
from kinematics.robots import builtin_chain, builtin_urdf
from planning.tool_motions.tool_motion import line
from planning.tool_motions.tool_path import Stop, Tolerances
from planning.tool_paths.tool_following import follow
from planning.values.deadline import Deadline
from tests.planning.scenes import HOME

PANDA = builtin_chain("panda")
T = forward(PANDA, HOME)
TIGHT = Tolerances(1e-5, 1e-4)


def shifted(*shift: float) -> np.ndarray:
    return transform(T[:3, :3], T[:3, 3] + shift)


def test_every_place_of_the_path_is_within_the_tolerances() -> None:
    end = shifted(0.05, 0.3, -0.1)
    segment = follow(PANDA, line(T, end), HOME, TIGHT, Deadline.after(30.0))
    path = segment.path
    assert path is not None
    assert (segment.stop, segment.reached) == (None, 1.0)
    np.testing.assert_array_equal(segment.start, HOME)
    model = pin.buildModelFromXML(builtin_urdf("panda"))
    data, frame = model.createData(), model.getFrameId(PANDA.tip_link)
    way = end[:3, 3] - T[:3, 3]
    for s in np.linspace(0.0, path.length, 300):
        q = path.sample([s])[0]
        pin.framesForwardKinematics(model, data, np.concatenate([q, np.zeros(model.nq - 7)]))
        M = data.oMf[frame]
        off = M.translation - T[:3, 3]
        off = off - way * (off @ way) / (way @ way)
        assert np.linalg.norm(off) <= 1e-5
        assert np.linalg.norm(pin.log3(T[:3, :3].T @ M.rotation)) <= 1e-4


def test_the_joints_never_jump_and_the_path_is_smooth() -> None:
    segment = follow(PANDA, line(T, shifted(0.0, 0.3, 0.0)), HOME, TIGHT, Deadline.after(30.0))
    path = segment.path
    assert path is not None
    places = path.breaks[1:-1]
    for order in (0, 1, 2):
        before, after = path.sample(places - 1e-9, order), path.sample(places + 1e-9, order)
        np.testing.assert_allclose(before, after, atol=1e-4)
    steps = np.diff(path.sample(np.linspace(0.0, path.length, 200)), axis=0)
    assert np.abs(steps).max() < 0.05


def test_a_motion_on_the_spot_moves_no_joint() -> None:
    segment = follow(PANDA, line(T, T), HOME, TIGHT, Deadline.after(30.0))
    assert segment.path is None
    assert (segment.reached, segment.stop) == (1.0, None)
    np.testing.assert_array_equal(segment.end, HOME)


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
    segment = follow(PANDA, motion, HOME, tolerances, Deadline.after(60.0))
    assert segment.stop is not None
    assert segment.stop.reason in reasons
    assert 0.0 < segment.reached < 1.0
    reached = forward(PANDA, segment.end)[:3, 3]
    np.testing.assert_allclose(reached, motion.pose(segment.reached)[:3, 3], atol=1e-4)
    limits = PANDA.limits
    assert ((segment.end >= limits.lower) & (segment.end <= limits.upper)).all()


def test_time_is_a_reason_too() -> None:
    segment = follow(PANDA, line(T, shifted(1.5, 0.0, 0.0)), HOME, TIGHT, Deadline.after(0.0))
    assert segment.stop is not None
    assert segment.stop.reason == "time"


@pytest.mark.parametrize("at", [0.0, 0.1, 0.5, 0.77])
def test_a_part_of_a_path_is_its_beginning(at: float) -> None:
    segment = follow(PANDA, line(T, shifted(0.0, 0.3, 0.0)), HOME, TIGHT, Deadline.after(30.0))
    assert segment.path is not None
    stop = Stop(at, "collision", "for the test", {})
    part = segment.cut(at, stop)
    assert part.stop is stop
    if at == 0.0:
        assert part.path is None
        np.testing.assert_array_equal(part.end, HOME)
        return
    assert part.path is not None
    assert part.path.length == pytest.approx(at, abs=1e-12)
    places = np.linspace(0.0, at, 50)
    np.testing.assert_allclose(part.path.sample(places), segment.path.sample(places), atol=1e-12)
    np.testing.assert_allclose(part.end, segment.path.sample([at])[0], atol=1e-12)
    assert segment.cut(1.0, stop).path is segment.path
