"""Cores of obstacles that planners keep out of: whoever touches no deeper than allowed is clear."""

import numpy as np
import pytest

import armwright as aw
from obstacles.collision.fcl_distance import FclWorld
from planning.contact_cores import with_cores
from planning.problem import Problem
from tests.obstacles.solids import random_transform
from tests.planning.scenes import HOME, builtin

PANDA = builtin("panda")
HELD = aw.pose([0.0, 0.0, 0.15])
GOAL = (aw.JointGoal(HOME + 0.1),)


def _wedge() -> aw.Convex:
    corners = [[x, y, z] for x in (0, 0.4) for y in (0, 0.4) for z in (0, 0.4) if x + y + z < 1]
    return aw.Convex(np.array(corners))


SHAPES = {
    "box": aw.Box([0.3, 0.4, 0.2]),
    "ball": aw.Sphere(0.2),
    "cylinder": aw.Cylinder(0.2, 0.3),
    "capsule": aw.Capsule(0.2, 0.3),
    "floor": aw.HalfSpace([0, 0, 1], 0.0),
    "wedge": _wedge(),
}


@pytest.mark.parametrize("name", SHAPES)
@pytest.mark.parametrize("seed", range(2))
def test_what_is_no_deeper_than_allowed_is_clear_of_the_core(name: str, seed: int) -> None:
    random = np.random.default_rng(seed)
    hand = aw.fk(PANDA, HOME, "panda_hand")[:3, 3]
    for _ in range(12):
        T = random_transform(random)
        T[:3, 3] = hand + random.uniform(-0.25, 0.25, 3)
        thing = aw.Obstacle("thing", SHAPES[name], T)
        depth, margin = random.uniform(0.001, 0.05), random.uniform(0.0, 0.02)
        pair, scene = ("panda_hand", "thing"), aw.Scene([thing])
        found = {item.pair: item.depth for item in FclWorld(PANDA, scene).collisions(HOME)}
        overlap = found.get(pair, 0.0)
        limited = aw.Scene([thing], contacts={pair: aw.AllowedContact("request", depth)})
        around = with_cores(Problem(PANDA, limited, HOME, GOAL, margin=margin))
        assert around is not None
        core = around.scene.obstacles[1]
        world = FclWorld(PANDA, around.scene)
        clear = world.distance_between(HOME, ("panda_hand", core.id))
        if overlap <= depth:
            assert clear > margin
        # No other link is kept out of it.
        assert world.distance_between(HOME, ("panda_link7", core.id)) == np.inf


def test_pairs_of_any_depth_and_thin_things_have_no_core() -> None:
    for depth, size in ((np.inf, 0.2), (0.02, 0.03)):
        thing = aw.Obstacle("thing", aw.Box([size, 0.2, 0.2]), aw.pose([0.5, 0.0, 0.3]))
        contacts = {("panda_hand", "thing"): aw.AllowedContact("request", depth)}
        problem = Problem(PANDA, aw.Scene([thing], contacts=contacts), HOME, GOAL)
        assert with_cores(problem) is None


#: Configurations in which the held box stands upright on a table, and how high that is [m].
STANDING = [
    (0.2214, [-0.5925, -1.5694, 1.0872, -2.3203, 1.2261, 1.2245, 0.0616],
     [-1.074, 1.3809, 2.0086, -2.3277, -1.1268, 1.3969, -1.1712]),
    (0.1821, [2.0213, 0.2667, -0.9468, -1.9866, 0.2551, 2.13, 0.0],
     [0.3418, 1.6388, -1.9698, -2.2988, 1.3492, 1.2297, 1.2945]),
]  # fmt: skip


@pytest.mark.parametrize(("height", "start", "goal"), STANDING)
def test_a_box_is_moved_from_one_place_on_a_table_to_another_not_through_it(
    height: float, start: list[float], goal: list[float]
) -> None:
    table = aw.Obstacle("table", aw.Box([2.0, 2.0, 0.04]), aw.pose([0.0, 0.0, height - 0.02]))
    part = aw.Obstacle("part", aw.Box([0.05, 0.05, 0.1]), HELD)
    base = {(f"panda_link{k}", "table"): aw.AllowedContact("request") for k in (0, 1)}
    plans, options = [], aw.Options(timeout=30.0)
    for depth in (np.inf, 0.001):
        held = aw.Attachment(part, "panda_hand", ("table", "panda_hand"), depth)
        holding = aw.hold(PANDA, aw.Scene([table]), [held], base)
        plan = aw.plan(holding.robot, holding.scene, start, goal, options=options)
        assert isinstance(plan, aw.Plan)
        found = plan.certificate.allowed_collisions
        plans.append({item.pair: item.overlap or 0.0 for item in found}["part", "table"])
    # Where any depth is allowed, the straight motion goes through the table, and it is told.
    assert plans[0] > 0.002
    assert plans[1] <= 0.001 + 1e-6
