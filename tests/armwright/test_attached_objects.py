"""Attached objects in process: from an obstacle to the hand and back."""

import numpy as np

import armwright as aw

START = np.array([0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785])


def test_an_object_is_planned_with_where_the_hand_takes_it() -> None:
    robot = aw.load_robot("panda")
    T_base_hand = aw.fk(robot, START, "panda_hand")
    T_base_box = T_base_hand @ aw.pose([0.0, 0.0, 0.081])
    scene = aw.Scene([aw.Obstacle("box", aw.Box([0.03, 0.03, 0.03]), T_base_box)])
    assert not aw.check(robot, scene, START).valid

    box, _ = aw.grasp(robot, scene, "box", "panda_hand", START)
    attachment = aw.Attachment(box, "panda_hand", ("panda_hand",))
    held = aw.hold(robot, scene, [attachment])
    assert not held.scene.obstacles
    goal = START + np.array([0.5, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    result = aw.plan(held.robot, held.scene, START, goal)
    assert isinstance(result, aw.Plan)
    assert result.certificate.verified

    after, placed = aw.release(robot, held.scene, attachment, goal)
    turn = aw.fk(robot, goal, "panda_hand") @ np.linalg.inv(T_base_hand)
    np.testing.assert_allclose(placed.T_world_obstacle, turn @ T_base_box, atol=1e-12)
    assert [obstacle.id for obstacle in after.obstacles] == ["box"]
