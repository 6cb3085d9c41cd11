"""Margins of links: a configuration is valid exactly where FCL measures the distances asked for."""

import numpy as np
import pytest

import armwright as aw
from kinematics.errors import InvalidLinkName, InvalidOption
from obstacles.collision.checker import Checker
from obstacles.collision.fcl_distance import FclWorld
from obstacles.robots.finger_geometry import with_fingers
from obstacles.robots.link_margins import with_margins
from planning.options import Options
from planning.pipeline.pipeline import plan
from planning.problem import JointGoal, Problem
from planning.result import Plan

UR = aw.load_robot("ur5e")
JAW = aw.mount(UR, aw.built_in_tool("parallel_jaw", "jaw"))


def far_enough(
    robot: aw.RobotGeometry, scene: aw.Scene, q: np.ndarray, kept: dict[str, float], own: float
) -> float:
    """How much the tightest pair has to spare, by FCL [m]."""
    world = FclWorld(robot, scene)
    world.set_configuration(q)
    least = np.inf
    for k, (i, j) in enumerate(world.pairs.tolist()):
        between = j < len(robot.pieces)
        asked = own if between else kept.get(robot.links[i], 0.0)
        least = min(least, world.distance(k) - asked)
    return least


@pytest.mark.parametrize("own", [0.0, 0.004])
def test_links_keep_what_is_asked_for_and_no_more(own: float) -> None:
    random = np.random.default_rng(38)
    kept = {"forearm_link": 0.1, "wrist_3_link": 0.03}
    arm = with_margins(UR, kept, own)
    lower, upper = UR.chain.sampling_bounds()
    agreed = {True: 0, False: 0}
    for _ in range(150):
        at = [*random.uniform(-0.6, 0.6, 2), random.uniform(0.1, 0.8)]
        scene = aw.Scene([aw.Obstacle("ball", aw.Sphere(0.08), aw.pose(at))])
        q = random.uniform(lower, upper)
        spare = far_enough(UR, scene, q, kept, own)
        if abs(spare) < 1e-6:
            continue
        valid = Checker.of(arm, scene).valid(q)
        # Shells are about the convex solids that cover a link: a little more than it.
        assert not valid if spare < 0.0 else valid or spare < 0.01, (spare, q)
        agreed[valid] += 1
    assert min(agreed.values()) > 20


def test_a_plan_is_proved_with_the_margin_of_a_link() -> None:
    scene = aw.Scene([aw.Obstacle("post", aw.Cylinder(0.05, 1.0), aw.pose([0.55, 0.0, 0.5]))])
    arm = with_margins(UR, {"wrist_3_link": 0.05})
    ends = np.array([[-0.9, -1.2, 1.4, -1.7, -1.57, 0.0], [0.9, -1.2, 1.4, -1.7, -1.57, 0.0]])
    found = plan(Problem(arm, scene, ends[0], (JointGoal(ends[1]),)), Options(timeout=20.0))
    assert isinstance(found, Plan), found
    assert found.certificate.verified
    states = found.trajectory.sample(np.linspace(0.0, found.trajectory.duration, 120))
    least = min(far_enough(UR, scene, q, {"wrist_3_link": 0.05}, 0.0) for q in states)
    assert least > 0.0


def test_a_tool_stands_for_its_parts_and_shells_may_touch_what_their_links_may() -> None:
    with pytest.raises(InvalidOption, match="a finger that moves"):
        with_margins(JAW, {"jaw": 0.02})
    torch = aw.mount(UR, aw.built_in_tool("torch", "torch"))
    arm = with_margins(torch, {"torch": 0.02}, 0.001)
    assert "torch/margin" in arm.names
    q = np.array([0.0, -1.4, 1.5, -1.67, -1.57, 0.0])
    tip = aw.fk(arm, q)[:3, 3]
    wall = aw.Scene([aw.Obstacle("wall", aw.Box((0.5, 0.5, 0.02)),
                                 aw.pose([tip[0], tip[1], tip[2] - 0.011]))])  # fmt: skip
    assert Checker.of(torch, wall).valid(q)
    assert not Checker.of(arm, wall).valid(q)
    touching = aw.hold(arm, wall, [], [("torch", "wall")])
    assert Checker.of(touching.robot, touching.scene).valid(q)


def test_own_margins_of_fingers_move_with_them() -> None:
    arm = with_margins(JAW, {}, 0.002)
    closed = with_fingers(arm, {"jaw/opening": 0.0})
    assert not any(name.startswith("jaw/left/") for name in arm.names)
    q = np.array([0.0, -1.4, 1.5, -1.67, -1.57, 0.0])
    assert Checker.of(closed, aw.Scene()).valid(q)


def test_unknown_links_are_refused() -> None:
    with pytest.raises(InvalidLinkName, match="'elbow' is no link with solids"):
        with_margins(UR, {"elbow": 0.1})
