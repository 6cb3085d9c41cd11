"""Points that a path needs, against distances computed from their definition."""

from itertools import pairwise

import numpy as np
import pytest

from planning.timing.path.simplification import kept_waypoints


@pytest.mark.parametrize("tolerance", [1e-3, 1e-2, 0.1])
def test_every_point_left_out_is_near_its_leg(tolerance: float) -> None:
    t = np.linspace(0.0, 6.0, 400)
    points = np.stack([np.cos(t), np.sin(2.0 * t), 0.3 * t], axis=1)
    chosen = kept_waypoints(points, tolerance)
    assert chosen[0] == 0
    assert chosen[-1] == 399
    assert (np.diff(chosen) > 0).all()
    assert len(chosen) < 200
    shares = np.linspace(0.0, 1.0, 2001)[:, None]
    for first, last in pairwise(chosen.tolist()):
        leg = points[first] + shares * (points[last] - points[first])
        for q in points[first : last + 1]:
            assert np.linalg.norm(leg - q, axis=1).min() <= tolerance + 1e-3


def test_a_way_back_on_the_same_line_keeps_its_turn() -> None:
    line = np.array([[0.0], [0.4], [1.0], [0.5], [0.0]])
    assert kept_waypoints(line, 1e-6).tolist() == [0, 2, 4]


def test_a_robot_that_rests_has_its_two_ends() -> None:
    assert kept_waypoints(np.zeros((9, 3)), 1e-6).tolist() == [0, 8]
