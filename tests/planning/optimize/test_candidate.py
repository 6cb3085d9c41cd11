"""Splines on a table: where they are blocked, by closed form."""

import numpy as np
import pytest

from kinematics.arrays import Array
from obstacles.collision.checker import Checker
from obstacles.scenes.scene import Scene
from planning.optimize.candidate import blocked_places
from planning.optimize.iterate import Iterate
from planning.optimize.spline import SplineSpace
from tests.planning.scenes import box
from tests.planning.slider import slider

POSTS = Scene(
    (
        box("west", (0.1, 0.1, 0.3), (-0.4, 0.0, 0.0)),
        box("east", (0.1, 0.1, 0.3), (0.4, 0.0, 0.0)),
    )
)
CHECKER = Checker.of(slider(), POSTS)


def distance(q: Array) -> Array:
    """From the ball to the nearer post, shape (k,)."""
    gaps = []
    for x in (-0.4, 0.4):
        outside = np.maximum(np.abs(q - [x, 0.0]) - 0.05, 0.0)
        gaps.append(np.linalg.norm(outside, axis=1) - 0.05)
    return np.asarray(np.minimum(gaps[0], gaps[1]))


def across(height: float, degree: int, count: int = 14) -> Iterate:
    """A line at a height above both posts."""
    x = np.linspace(-0.9, 0.9, count)
    return Iterate(SplineSpace.uniform(degree, count), np.column_stack([x, 0.0 * x + height]), 2.0)


@pytest.mark.parametrize("degree", [3, 4, 5])
def test_a_line_beside_the_posts_is_free_and_one_through_them_names_both(degree: int) -> None:
    assert blocked_places(CHECKER, across(0.11, degree)) == []
    at = across(0.02, degree)
    places = blocked_places(CHECKER, at)
    assert places
    assert places == sorted(places)
    met = at.sample(np.array(places))
    assert distance(met).max() < 0.02
    assert {x > 0.0 for x in met[:, 0]} == {True, False}


def test_there_is_one_place_at_most_in_each_stretch() -> None:
    at = across(0.0, 3, 8)
    places = np.array(blocked_places(CHECKER, at))
    stretches = np.searchsorted(at.space.breaks, places, side="right")
    assert len(set(stretches.tolist())) == len(places)


def test_slack_is_kept_too() -> None:
    near = across(0.115, 3)
    assert blocked_places(CHECKER, near) == []
    assert blocked_places(Checker(CHECKER.model, 0.02), near) != []


def test_random_cubics_are_blocked_exactly_where_dense_samples_are() -> None:
    rng, counts = np.random.default_rng(0), [0, 0]
    for _ in range(60):
        points = rng.uniform(-0.6, 0.6, (8, 2))
        at = Iterate(SplineSpace.uniform(3, 8), points, 1.0)
        least = float(distance(at.sample(np.linspace(0.0, 1.0, 4001))).min())
        if abs(least) < 1e-3:
            continue
        places = blocked_places(CHECKER, at)
        assert bool(places) == (least < 0.0)
        counts[bool(places)] += 1
    assert min(counts) > 5


def test_two_cubics_a_piece_follow_a_quintic() -> None:
    """A quintic that rises over a post and back: the cubics see it where it is."""
    space = SplineSpace.uniform(5, 16)
    x = np.linspace(-0.9, 0.1, 16)
    for height, free in ((0.16, True), (0.04, False)):
        bump = height * np.exp(-(((x + 0.4) / 0.25) ** 2))
        at = Iterate(space, np.column_stack([x, bump]), 1.0)
        least = float(distance(at.sample(np.linspace(0.0, 1.0, 4001))).min())
        assert (least > 0.0) is free
        assert (blocked_places(CHECKER, at) == []) is free
