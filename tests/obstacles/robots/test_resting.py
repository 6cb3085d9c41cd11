"""Places where objects rest, against what stands by its centre of mass (trimesh)."""

from typing import Any

import numpy as np
import pytest
import trimesh
from scipy.spatial import ConvexHull

import armwright as aw
from kinematics.errors import InvalidOption
from kinematics.pose import rotation_z, transform
from obstacles.robots.resting import resting_places

TURNED = transform(rotation_z(0.4), [0.5, 0.1, 0.11])


def stands(points: np.ndarray) -> float:
    """How far the centre of mass is inside of the foot, as a tangent of the tilt."""
    body = trimesh.convex.convex_hull(points)
    foot = points[points[:, 2] < points[:, 2].min() + 1e-6, :2]
    edges = ConvexHull(foot).equations
    inside = -float((edges[:, :2] @ body.center_mass[:2] + edges[:, 2]).max())
    return inside / float(body.center_mass[2] - points[:, 2].min())


def test_what_is_put_down_stands_within_the_top_and_does_not_tip() -> None:
    random, count = np.random.default_rng(5), 0
    table = aw.Obstacle("table", aw.Box((0.5, 0.4, 0.02)), TURNED)
    for _ in range(30):
        corners = random.uniform(-0.05, 0.05, (int(random.integers(4, 12)), 3))
        corners += np.array([0.3, 0.0, 0.0])
        places = resting_places(aw.Convex(corners), [table], (2, 3), 3)
        for T in places[:: max(len(places) // 6, 1)]:
            points = corners @ T[:3, :3].T + T[:3, 3]
            foot = points[points[:, 2] < points[:, 2].min() + 1e-6]
            assert len(foot) >= 3
            # Points within a micrometre of a plane are of one face.
            assert foot[:, 2] == pytest.approx(0.12, abs=1e-6)
            local = (foot - TURNED[:3, 3]) @ TURNED[:3, :3]
            assert (np.abs(local[:, :2]) <= [0.25 + 1e-6, 0.2 + 1e-6]).all()
            assert stands(points) > 0.1
            count += 1
    assert count > 60


def test_a_box_rests_on_each_face_and_a_cylinder_on_its_ends() -> None:
    table = aw.Obstacle("table", aw.Box((0.5, 0.4, 0.02)), TURNED)
    heights = {round(float(T[2, 3]), 4) for T in resting_places(aw.Box((0.04, 0.06, 0.1)), [table])}
    assert heights == {0.14, 0.15, 0.17}
    ends = resting_places(aw.Cylinder(0.02, 0.1), [table])
    assert {round(float(T[2, 3]), 4) for T in ends} == {0.17}
    # A top that is too small carries nothing; two carry twice as much.
    small = aw.Obstacle("small", aw.Box((0.02, 0.02, 0.1)), aw.pose([0.0, 0.5, 0.1]))
    assert len(resting_places(aw.Box((0.04, 0.06, 0.1)), [small])) == 0
    other = aw.Obstacle("other", table.shape, transform(None, [0.0, 0.9, 0.0]) @ TURNED)
    assert len(resting_places(aw.Cylinder(0.02, 0.1), [table, other])) == 2 * len(ends)


@pytest.mark.parametrize(
    ("shape", "support", "told"),
    [
        (aw.Sphere(0.05), aw.Box((1.0, 1.0, 0.1)), "no face"),
        (aw.Box((0.1, 0.1, 0.1)), aw.Sphere(0.5), "no flat top"),
        (aw.Box((0.1, 0.1, 0.1)), aw.HalfSpace((0.0, 0.0, 1.0), 0.0), "no flat top"),
    ],
)
def test_what_rolls_and_what_has_no_top_is_refused(shape: Any, support: Any, told: str) -> None:
    with pytest.raises(InvalidOption, match=told):
        resting_places(shape, [aw.Obstacle("s", support, np.eye(4))])
