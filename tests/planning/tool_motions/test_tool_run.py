"""Runs of tool motions: places, poses and parts against scipy's rotations and plain sums."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

from kinematics.pose import transform
from planning.tool_motions.tool_motion import arc_via, line
from planning.tool_motions.tool_path import ToolRun, run_of
from planning.tool_motions.tool_tolerance import ToolTolerance

TURN = Rotation.from_rotvec([0.0, 0.3, 0.4]).as_matrix()
A = transform(None, [0.0, 0.0, 0.0])
B = transform(TURN, [0.3, 0.0, 0.0])
C = transform(TURN, [0.3, 0.2, 0.0])
#: A line of 0.3 m, then half a circle of radius 0.1 m.
RUN = ToolRun((line(A, B), arc_via(B, C, [0.4, 0.1, 0.0])), (3, 4), (False, True))
HALF = 0.1 * np.pi
BREAK = 0.3 / (0.3 + HALF)


def test_places_are_proportional_to_the_length_of_the_whole() -> None:
    assert RUN.length == pytest.approx(0.3 + HALF)
    assert RUN.angle == pytest.approx(0.5)
    np.testing.assert_allclose(RUN.breaks, [0.0, BREAK, 1.0])
    assert RUN.kind == "lin"
    single = run_of(RUN.motions[1], 7)
    np.testing.assert_array_equal(single.breaks, [0.0, 1.0])
    assert (single.asked, single.kind) == ((7,), "circ")
    assert run_of(RUN) is RUN


def test_poses_are_those_of_the_motion_at_the_place() -> None:
    slerp = Slerp([0.0, BREAK], Rotation.from_matrix(np.stack([A[:3, :3], B[:3, :3]])))
    places = np.linspace(0.0, 1.0, 41)
    poses = RUN.poses(places)
    for s, T in zip(places, poses, strict=True):
        if s <= BREAK:
            point, R = [0.3 * s / BREAK, 0.0, 0.0], slerp(s).as_matrix()
        else:
            angle = np.pi * (s - BREAK) / (1.0 - BREAK) - 0.5 * np.pi
            point, R = [0.3 + 0.1 * np.cos(angle), 0.1 + 0.1 * np.sin(angle), 0.0], TURN
        np.testing.assert_allclose(T[:3, 3], point, atol=1e-12)
        np.testing.assert_allclose(T[:3, :3], R, atol=1e-12)
        np.testing.assert_allclose(RUN.pose(float(s)), T, atol=1e-14)
    motion, at = RUN.locate(BREAK + 0.25 * (1.0 - BREAK))
    assert motion is RUN.motions[1]
    assert at == pytest.approx(0.25)


def test_parts_tell_what_was_asked_and_the_box() -> None:
    box = ToolTolerance.of({"x": (-0.1, 0.1)})
    run = ToolRun(RUN.motions, RUN.asked, RUN.blends, (box, ToolTolerance.of({})))
    first, last = run.parts
    assert (first.begin, first.end, first.asked, first.blends) == (0.0, first.end, 3, False)
    assert (last.begin, last.end, last.asked, last.blends) == (first.end, 1.0, 4, True)
    assert first.end == pytest.approx(BREAK)
    assert first.tolerance is box
    assert [part.tolerance for part in RUN.parts] == [None, None]


@pytest.mark.parametrize(
    ("reached", "count"), [(0.0, 1), (0.5 * BREAK, 1), (BREAK, 1), (BREAK + 1e-6, 2), (1.0, 2)]
)
def test_parts_that_were_begun_are_those_before_the_place(reached: float, count: int) -> None:
    assert len(RUN.parts_until(reached)) == count
