"""Ranges of position along seams that bend: which are kept, and places that the tool is at."""

import math

import numpy as np
import pytest

from kinematics.pose import transform
from planning.tool_motions.tool_tolerance import Axis, SeamOptions, SeamWaypoint, ToolTolerance
from planning.tool_paths.seams.following import is_within_at_own_places, with_fewer_ranges
from planning.tool_paths.seams.path import SeamPlaces, seam_places, seam_runs

DOWN = np.diag([1.0, -1.0, -1.0])
HAIR = 1e-4


def ranged(*axes: Axis) -> ToolTolerance:
    return ToolTolerance.of(dict.fromkeys(axes, (-0.001, 0.001)))


def along(tolerance: ToolTolerance, bends: bool) -> SeamPlaces:
    """Places on a line along y, or on a half circle."""
    if bends:
        points = [[0.4, 0.1, 0.3], [0.4, -0.1, 0.3]]
        via: list[np.ndarray | None] = [None, np.array([0.5, 0.0, 0.3])]
    else:
        points, via = [[0.4, -0.1, 0.3], [0.4, 0.1, 0.3]], [None, None]
    waypoints = tuple(
        SeamWaypoint(transform(DOWN, p), via=v) for p, v in zip(points, via, strict=True)
    )
    return seam_places(seam_runs(SeamOptions(waypoints, tolerance), 0.0))


@pytest.mark.parametrize(
    ("axes", "bends", "kept"),
    [
        ((), True, [((), False)]),
        (("x", "z"), False, [(("x", "z"), False)]),
        (("x", "y"), False, [(("x", "y"), True), (("x",), False), ((), False)]),
        (("z",), True, [(("z",), False)]),
        (("x",), True, [(("x",), True), ((), False)]),
        (("x", "z"), True, [(("x", "z"), True), (("z",), False), ((), False)]),
    ],
)
def test_ranges_across_the_path_are_kept_longest(
    axes: tuple[Axis, ...], bends: bool, kept: list[tuple[tuple[Axis, ...], bool]]
) -> None:
    tried = list(with_fewer_ranges(along(ranged(*axes), bends), HAIR))
    assert [looks for _, looks in tried] == [looks for _, looks in kept]
    for (places, _), (names, _) in zip(tried, kept, strict=True):
        want = ranged(*names)
        for tolerance in (*places.tolerances, *places.runs[0].tolerances):
            np.testing.assert_array_equal(tolerance.lower, want.lower)
            np.testing.assert_array_equal(tolerance.upper, want.upper)
        np.testing.assert_array_equal(
            places.boxes[:, :3], np.tile(want.lower[:3], (len(places.s), 1))
        )


def test_a_deviation_is_seen_from_the_place_that_the_tool_is_at() -> None:
    run = along(ranged("x"), True).runs[0]
    poses = run.poses(np.linspace(0.0, 1.0, 50))
    allowed = np.array([HAIR, 1e-3])
    assert is_within_at_own_places(run, poses, allowed)
    oblique = poses.copy()
    # Along x by as much as is allowed: from the nearest place on the circle it is partly along y.
    oblique[:, 0, 3] += 1e-3
    radius = np.linalg.norm(oblique[:, :2, 3] - [0.4, 0.0], axis=1)
    angle = np.arctan2(oblique[:, 1, 3], oblique[:, 0, 3] - 0.4)
    off = np.abs((radius - 0.1) * np.sin(angle)).max()
    assert math.isclose(off, 5e-4, rel_tol=0.02)
    assert not is_within_at_own_places(run, oblique, np.array([0.9 * off, 0.1]))
    assert is_within_at_own_places(run, oblique, np.array([1.1 * off, 0.1]))


def test_a_point_outside_a_corner_belongs_to_the_motion_on_its_side() -> None:
    corner = [[0.4, -0.1, 0.3], [0.4, 0.0, 0.3], [0.42, 0.1, 0.3]]
    waypoints = tuple(SeamWaypoint(transform(DOWN, p)) for p in corner)
    run = seam_runs(SeamOptions(waypoints, ranged("x")), 0.0)[0]
    poses = run.poses(np.linspace(0.0, 1.0, 41))
    poses[:, 0, 3] -= 1e-3
    # The second line is oblique to x: along y it sees 1 mm sin cos of the angle.
    angle = math.atan(0.2)
    off = 1e-3 * math.sin(angle) * math.cos(angle)
    assert not is_within_at_own_places(run, poses, np.array([0.9 * off, 0.1]))
    assert is_within_at_own_places(run, poses, np.array([1.1 * off, 0.1]))
