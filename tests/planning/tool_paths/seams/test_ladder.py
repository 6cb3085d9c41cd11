"""Seams of real work that a ladder of twelve spins follows, and one that bends sharply."""

import numpy as np
import pytest

from benchmarks.planning.seams import judge, load
from obstacles.collision.checker import Checker
from planning.options import CartesianOptions, Options
from planning.pipeline.pipeline import plan
from planning.result import Plan
from tests.planning.tool_paths.seams.ladder import ALL_STARTS, around, ask, ladder, work


@pytest.mark.parametrize(
    ("arm", "kind", "number", "posts"),
    [
        ("ur5e", "spiral", 1, False),
        ("ur5e", "sphere", 0, False),
        ("ur5e", "sphere", 2, False),
        ("ur5e", "raster", 3, True),
        ("kr6_sixx", "spiral", 0, True),
        ("panda", "spiral", 2, False),
        ("panda", "program", 1, False),
        ("panda", "sphere", 37, False),
    ],
)
def test_a_seam_that_a_ladder_follows_is_followed(
    arm: str, kind: str, number: int, posts: bool
) -> None:
    one, loaded, start = work(arm, kind, number), load(arm), np.array(ALL_STARTS[arm])
    scene = around(one.seam, posts=posts)
    how = Options(planner="cartesian", cartesian=CartesianOptions(seam=one.seam), timeout=60.0)
    answer = plan(ask(loaded.robot, one.seam, start, scene), how)
    assert ladder(Checker.of(loaded.robot, scene), one.seam, start, spins=one.spins)
    assert isinstance(answer, Plan), answer
    verdict = judge(loaded, scene, one.seam.waypoints, answer)
    assert verdict.away <= 1.2e-4
    assert not verdict.collides


@pytest.mark.parametrize(("arm", "number"), [("panda", 0), ("kr6_sixx", 0), ("ur5e", 2)])
def test_sharp_turns_of_the_tool_on_short_ways_are_followed(arm: str, number: int) -> None:
    """Between two edges of a box the tool turns by a right angle on some millimetres."""
    one, loaded = work(arm, "edge", number), load(arm)
    how = Options(planner="cartesian", cartesian=CartesianOptions(seam=one.seam), timeout=60.0)
    answer = plan(ask(loaded.robot, one.seam, np.array(ALL_STARTS[arm])), how)
    assert isinstance(answer, Plan), answer
    assert answer.certificate.verified
    assert answer.certificate.tool_box is not None
    assert answer.certificate.tool_box.share <= 1.0
