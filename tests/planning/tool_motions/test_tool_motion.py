"""Lines and arcs of the tool against scipy's rotations, and what is no circle."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

from kinematics.errors import InvalidGoal
from kinematics.pose import transform
from planning.tool_motions.timed_tool_motions import TimedToolMotions, joined_spans
from planning.tool_motions.tool_motion import (
    ToolMotion,
    arc_about,
    arc_via,
    line,
)

RANDOM = np.random.default_rng(11)


def random_pose() -> np.ndarray:
    return transform(Rotation.random(random_state=RANDOM).as_matrix(), RANDOM.uniform(-1, 1, 3))


def check_orientation(motion: ToolMotion) -> None:
    """Slerp: at a constant rate about one axis, the shorter way."""
    ends = np.stack([motion.T_start[:3, :3], motion.T_end[:3, :3]])
    slerp = Slerp([0.0, 1.0], Rotation.from_matrix(ends))
    for s in np.linspace(0.0, 1.0, 9):
        error = slerp(s).inv() * Rotation.from_matrix(motion.pose(float(s))[:3, :3])
        assert error.magnitude() < 1e-9


@pytest.mark.parametrize("case", range(20))
def test_a_line_is_straight(case: int) -> None:
    start, end = random_pose(), random_pose()
    motion = line(start, end)
    for s in np.linspace(0.0, 1.0, 9):
        expected = (1.0 - s) * start[:3, 3] + s * end[:3, 3]
        np.testing.assert_allclose(motion.pose(float(s))[:3, 3], expected, atol=1e-12)
    assert motion.length == pytest.approx(np.linalg.norm(end[:3, 3] - start[:3, 3]))
    check_orientation(motion)


@pytest.mark.parametrize("case", range(30))
def test_an_arc_lies_on_its_circle(case: int) -> None:
    """Points of a known circle are put in: the arc goes through them in their order."""
    frame = Rotation.random(random_state=RANDOM).as_matrix()
    center, radius = RANDOM.uniform(-1, 1, 3), float(RANDOM.uniform(0.05, 2.0))

    def at(angle: float) -> np.ndarray:
        return np.asarray(
            center + radius * (np.cos(angle) * frame[:, 0] + np.sin(angle) * frame[:, 1])
        )

    sweep = float(RANDOM.uniform(0.2, 2.0 * np.pi - 0.2))
    middle = float(RANDOM.uniform(0.2, 0.8)) * sweep
    start = transform(Rotation.random(random_state=RANDOM).as_matrix(), at(0.0))
    end = transform(Rotation.random(random_state=RANDOM).as_matrix(), at(sweep))
    motions = [arc_via(start, end, at(middle)), arc_about(start, end, center, 3.0 * frame[:, 2])]
    if sweep < np.pi:
        motions.append(arc_about(start, end, center))
    for motion in motions:
        assert motion.sweep == pytest.approx(sweep, abs=1e-6)
        assert motion.length == pytest.approx(radius * sweep, rel=1e-6)
        for s in np.linspace(0.0, 1.0, 9):
            found = motion.pose(float(s))[:3, 3]
            np.testing.assert_allclose(found, at(float(s) * sweep), atol=1e-6)
        check_orientation(motion)


def test_half_and_whole_circles_need_a_normal() -> None:
    start = transform(None, [1.0, 0.0, 0.0])
    half = arc_about(start, transform(None, [-1.0, 0.0, 0.0]), np.zeros(3), [0, 0, 1])
    np.testing.assert_allclose(half.pose(0.5)[:3, 3], [0.0, 1.0, 0.0], atol=1e-12)
    other = arc_about(start, transform(None, [-1.0, 0.0, 0.0]), np.zeros(3), [0, 0, -1])
    np.testing.assert_allclose(other.pose(0.5)[:3, 3], [0.0, -1.0, 0.0], atol=1e-12)
    whole = arc_about(start, start, np.zeros(3), [0, 0, 1])
    assert whole.sweep == pytest.approx(2.0 * np.pi)
    np.testing.assert_allclose(whole.pose(0.25)[:3, 3], [0.0, 1.0, 0.0], atol=1e-12)
    through = arc_via(start, transform(None, [-1.0, 0.0, 0.0]), [0.0, 0.0, 1.0])
    assert through.sweep == pytest.approx(np.pi)
    np.testing.assert_allclose(through.pose(0.5)[:3, 3], [0.0, 0.0, 1.0], atol=1e-12)


@pytest.mark.parametrize(
    ("end", "more", "words"),
    [
        ([-1.0, 0.0, 0.0], {"via": [0.2, 0.0, 0.0]}, "lie on one line"),
        ([-1.0, 0.0, 0.0], {"via": [1.0, 0.0, 0.0]}, "lie on one line"),
        ([-1.0, 0.0, 0.0], {"via": [-1.0, 0.0, 0.0]}, "lie on one line"),
        ([-1.0, 0.0, 0.0], {"via": [5.0, 0.0, 1e-9]}, "lie on one line"),
        ([1.0, 0.0, 0.0], {"via": [0.0, 1.0, 0.0]}, "start and end are the same"),
        ([-1.0, 0.0, 0.0], {"center": [0.0, 0.0, 0.0]}, "half a circle"),
        ([1.0, 0.0, 0.0], {"center": [0.0, 0.0, 0.0]}, "a full circle"),
        ([0.0, 2.0, 0.0], {"center": [0.0, 0.0, 0.0]}, "1 m from its center and ends 2 m"),
        ([0.0, 1.0, 0.0], {"center": [1.0, 0.0, 0.0]}, "0 m from its center"),
        ([0.0, 1.0, 0.0], {"center": [0.0, 0.0, 0.0], "normal": [0, 1, 1]}, "off the plane"),
        ([0.0, 1.0, 0.0], {"center": [0.0, 0.0, 0.0], "normal": [0, 0, 0]}, "no direction"),
    ],
)
def test_what_is_no_circle_is_refused_by_name(
    end: list[float], more: dict[str, list[float]], words: str
) -> None:
    start, last = transform(None, [1.0, 0.0, 0.0]), transform(None, end)
    with pytest.raises(InvalidGoal, match=words):
        arc_via(start, last, more["via"]) if "via" in more else arc_about(start, last, **more)


def test_motions_in_time_follow_at_once_or_later() -> None:
    pair = (line(random_pose(), random_pose()), line(random_pose(), random_pose()))
    times = np.array([1.0, 2.0, 4.0])
    at_once = TimedToolMotions(pair, times, 1e-4)
    later = TimedToolMotions(pair, times, 1e-4, begins=np.array([1.0, 2.5]))
    assert [row[1:] for row in at_once.exact] == [(1.0, 2.0), (2.0, 4.0)]
    assert [row[1:] for row in later.exact] == [(1.0, 2.0), (2.5, 4.0)]
    for begins in ([1.0, 1.9], [1.0, 4.1], [0.9, 2.0], [1.0]):
        with pytest.raises(InvalidGoal, match="begins before the one before ends"):
            TimedToolMotions(pair, times, 1e-4, begins=np.array(begins))


def test_spans_that_follow_at_once_are_joined() -> None:
    assert joined_spans([(0.0, 1.0), (1.0, 2.0), (2.5, 3.0)]) == ((0.0, 2.0), (2.5, 3.0))
    assert joined_spans([]) == ()
