"""Lines, arcs, runs and tolerances of the tool beside scipy's rotations."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

from kinematics.errors import InvalidGoal, InvalidOption
from kinematics.pose import transform
from planning.tool_motions.timed_tool_motions import TimedToolMotions, joined_spans
from planning.tool_motions.tool_motion import (
    ToolMotion,
    arc_about,
    arc_via,
    line,
)
from planning.tool_motions.tool_path import ToolRun
from planning.tool_motions.tool_tolerance import ToolTolerance, rotations
from tests.planning.tool_boxes import deviations

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
    single = ToolRun.of(RUN.motions[1], 7)
    np.testing.assert_array_equal(single.breaks, [0.0, 1.0])
    assert (single.asked, single.kind) == ((7,), "circ")


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


DRAWS = np.random.default_rng(4)


def poses(count: int) -> np.ndarray:
    turns = Rotation.random(count, DRAWS).as_matrix()
    places = DRAWS.normal(size=(count, 3))
    return np.array([transform(R, p) for R, p in zip(turns, places, strict=True)])


@pytest.mark.parametrize("fixed", [False, True])
def test_deviations_are_those_that_poses_were_made_with(fixed: bool) -> None:
    axes = Rotation.random(random_state=1).as_matrix() if fixed else None
    box = ToolTolerance(
        np.array([-0.5] * 3 + [-1.3] * 3), np.array([0.5] * 3 + [1.3] * 3), axes=axes
    )
    nominal, d = poses(40), DRAWS.uniform(box.lower, box.upper, (40, 6))
    T = box.poses(nominal, d)
    np.testing.assert_allclose(deviations(box, nominal, T), d, atol=1e-9)
    D = Rotation.from_euler("XYZ", d[:, 3:]).as_matrix()
    np.testing.assert_allclose(rotations(d[:, 3:]), D, atol=1e-12)
    for k in range(40):
        N = nominal[k]
        A = N[:3, :3] if axes is None else axes
        np.testing.assert_allclose(T[k, :3, 3], N[:3, 3] + A @ d[k, :3], atol=1e-12)
        np.testing.assert_allclose(T[k, :3, :3], A @ D[k] @ A.T @ N[:3, :3], atol=1e-12)


def test_tolerances_that_make_no_sense_are_refused() -> None:
    for ranges, free, tilt, words in (
        ({"x": (0.1, -0.1)}, (), None, "above"),
        ({"x": (-2.0, 2.0)}, (), None, "at most 1 m"),
        ({}, ("x",), None, "can't be free"),
        ({}, (), -0.1, "above|positive"),
        ({"ry": (-1.5, 1.5)}, (), None, "not defined"),
        ({}, ("ry",), None, "free all"),
    ):
        with pytest.raises(InvalidOption) as caught:
            ToolTolerance.of(ranges, free, tilt)  # type: ignore[arg-type]
        text = f"{caught.value.message} {caught.value.hint}"
        assert any(word in text for word in words.split("|")), text
    assert ToolTolerance.of({}, ("rx", "ry", "rz")).lower[4] == -np.inf
