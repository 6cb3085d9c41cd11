"""Calmer ways along seams: shorter for the joints, within the tolerances, away from limits."""

import numpy as np
import pytest

from kinematics.pose import transform
from obstacles.collision.checker import Checker
from obstacles.scenes.scene import Scene
from planning.tool_motions.tool_tolerance import SeamOptions, SeamWaypoint, ToolTolerance
from planning.tool_paths.seams.following import refine
from planning.tool_paths.seams.path import seam_places, seam_runs
from planning.tool_paths.seams.search import SeamSearch
from planning.values.deadline import Deadline
from tests.planning.pinocchio_panda import PinocchioPanda
from tests.planning.scenes import HOME, builtin

TILT = 0.2
DOWN = np.diag([1.0, -1.0, -1.0])


def line_search(reach: float) -> SeamSearch:
    """The search along a line in front of a Panda."""
    ends = np.linspace(-reach, reach, 80)
    points = tuple(SeamWaypoint(transform(DOWN, [0.5, y, 0.35])) for y in ends)
    tolerance = ToolTolerance.of({}, ("rz",), tilt=TILT)
    places = seam_places(seam_runs(SeamOptions(points, tolerance), 0.0))
    checker = Checker.of(builtin("panda"), Scene())
    return SeamSearch(checker, places, np.array(HOME), (), Deadline.after(60.0))


@pytest.mark.parametrize("reach", [0.15, 0.3, 0.4])
def test_a_calmer_way_is_short_and_keeps_to_the_tolerance(reach: float) -> None:
    search = line_search(reach)
    joints = search.run().joints
    assert joints is not None
    calm = refine(search, joints)
    rates, calm_rates = (float((np.diff(q, axis=0) ** 2).sum()) for q in (joints, calm))
    assert calm_rates < 0.35 * rates
    oracle = PinocchioPanda()
    for q, nominal in zip(calm, search.places.nominal, strict=True):
        T = oracle.pose(q)
        np.testing.assert_allclose(T[:3, 3], nominal[:3, 3], atol=2e-6)
        assert T[:3, 2] @ nominal[:3, 2] >= np.cos(TILT + 2e-6)


def test_a_calmer_way_comes_no_nearer_to_limits_than_the_way_at_hand() -> None:
    search = line_search(0.3)
    limits = search.chain.limits
    joints = search.run().joints
    assert joints is not None
    calm = refine(search, joints)
    half = 0.5 * (limits.upper - limits.lower)
    left, calm_left = (
        np.minimum(q - limits.lower, limits.upper - q).min(axis=0) / half for q in (joints, calm)
    )
    assert (calm_left >= np.minimum(left, 0.02) - 1e-9).all()


def test_a_way_near_a_limit_may_stay_as_near_to_it() -> None:
    search = line_search(0.15)
    joints = np.tile(np.array(HOME), (len(search.places.s), 1))
    joints[:, 6] = search.chain.limits.upper[6] - 0.01
    errors = search.project(joints, 0.1)
    assert errors.max() < 1e-6
    assert joints[:, 6].max() <= search.chain.limits.upper[6] - 0.01 + 1e-9
