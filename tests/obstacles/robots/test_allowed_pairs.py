"""Pairs that may touch: who allows them, what counts first, how deep they are."""

import numpy as np
import pytest

import armwright as aw
from armwright_wire.scenes import check
from obstacles.collision.fcl_distance import OverlapMeter
from obstacles.robots.allowed_pairs import TOUCH_DEPTH, allowed_pairs, deepest
from planning.configuration_check import configuration_checker
from tests.planning.scenes import HOME, builtin

PANDA = builtin("panda")
HAND = aw.fk(PANDA, HOME, "panda_hand")


def test_the_schemas_have_the_same_depth() -> None:
    assert check.TOUCH_DEPTH == TOUCH_DEPTH


def test_requests_count_before_touch_links_and_these_before_scenes() -> None:
    table = aw.Obstacle("table", aw.Box([0.2, 0.2, 0.2]), aw.pose([0.9, 0.0, 0.0]))
    part = aw.Obstacle("part", aw.Box([0.02, 0.02, 0.02]), aw.pose([0.0, 0.0, 0.3]))
    scene = aw.Scene([table], [("part", "table"), ("panda_link5", "table")])
    touching = aw.Attachment(part, "panda_hand", ("table",), 0.003)
    held = aw.hold(PANDA, scene, [touching])
    asked = aw.hold(
        PANDA, scene, [touching], {("part", "table"): aw.AllowedContact("request", 0.02)}
    )
    for holding, reason, depth in ((held, "touch_links", 0.003), (asked, "request", 0.02)):
        found = {item.pair: item for item in allowed_pairs(holding.robot, holding.scene)}
        assert found["part", "table"][1:] == (reason, depth, True)
        assert found["panda_link5", "table"][1:] == ("scene", np.inf, True)
        assert not found["panda_link3", "panda_link4"].measured
    # What is nowhere in the cell is not told: matrices name whatever their author had.
    more = aw.Scene([table], [("camera", "table"), ("panda_link5", "camera")])
    assert {item.pair for item in allowed_pairs(PANDA, more)} == set(PANDA.allowed)


def test_hashes_of_scenes_tell_depths_apart() -> None:
    made = [
        aw.Scene(),
        aw.Scene([], [("a", "b")]),
        *(aw.Scene(contacts={("b", "a"): aw.AllowedContact("scene", d)}) for d in (0.1, 0.2)),
    ]
    assert len({scene.content_hash for scene in made}) == 4
    assert {scene.obstacles_hash for scene in made} == {made[0].content_hash}
    assert made[2].allows("a", "b")
    assert made[2].hash_allowing([("a", "b")]) == made[1].content_hash


@pytest.mark.parametrize("seed", range(30))
def test_a_ball_in_a_box_is_as_deep_as_it_is(seed: int) -> None:
    random = np.random.default_rng(seed)
    ball = aw.Obstacle("ball", aw.Sphere(0.04), aw.pose([0.0, 0.0, 0.25]))
    center = (HAND @ ball.T_world_obstacle)[:3, 3]
    # A block that is large beside the ball, of which only the upper face is near.
    depth = random.uniform(-0.01, 0.04)
    top = center[2] - 0.04 + depth
    block = aw.Obstacle("block", aw.Box([0.4, 0.4, 0.2]), aw.pose([*center[:2], top - 0.1]))
    limit = random.uniform(0.0, 0.04)
    holding = aw.hold(
        PANDA, aw.Scene([block]), [aw.Attachment(ball, "panda_hand", ("block",), limit)]
    )
    meter = OverlapMeter(holding.robot, holding.scene)
    told = {item.pair: item.overlap for item in meter.report([HOME])}
    assert told["ball", "block"] == pytest.approx(max(depth, 0.0), abs=1e-6)
    assert told["panda_link3", "panda_link4"] is None
    report = configuration_checker(holding.robot, holding.scene).check(HOME)
    verdict = configuration_checker(holding.robot, holding.scene).verdict(HOME)
    assert report.valid == verdict.valid == (depth <= limit)
    if depth > limit:
        assert report.collisions[0].pair == verdict.collisions[0].pair == ("ball", "block")
        assert report.collisions[0].depth == pytest.approx(depth, abs=1e-6)
        plan = aw.plan(holding.robot, holding.scene, HOME, HOME + 0.1)
        assert isinstance(plan, aw.Failure)
        assert plan.code == "START_STATE_IN_COLLISION"
        assert "touch_depth" in plan.message
        assert plan.details["pair"] == ["ball", "block"]
        assert plan.details["touch_depth"] == limit


def test_of_several_motions_the_deepest_counts() -> None:
    one = aw.Scene([aw.Obstacle("a", aw.Sphere(0.1), HAND)], [("panda_hand", "a")])
    meter = OverlapMeter(PANDA, one)
    shallow, deep = meter.report([HOME + 0.1]), meter.report([HOME])
    depths = [{item.pair: item.overlap for item in told} for told in (shallow, deep)]
    merged = {item.pair: item.overlap for item in deepest(shallow, deep)}
    pair = ("a", "panda_hand")
    assert merged[pair] == max(depths[0][pair] or 0.0, depths[1][pair] or 0.0) > 0.0
    assert merged.keys() == depths[0].keys()
