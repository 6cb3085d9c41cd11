"""The world between stages: what is held, where objects stand, what may touch and until when."""

import numpy as np

import armwright as aw
from kinematics.forward import forward
from planning.sequence.world import Cells, Contact, World
from tests.planning.sequence import crate

_Q = np.array([-0.4, 0.2, 0.1, -2.1, 0.1, 2.3, 0.5])
_GRIP = crate.grasps(4)[1]
TOUCHING = {("crate", "panda_hand"): aw.AllowedContact("touch_links", 0.001)}


def _grasped() -> World:
    return crate.world().after_grasp(Contact("crate", _GRIP, ("table",)), TOUCHING)


def _held() -> World:
    return _grasped().after_attach("crate", None, (("wall",), 0.002), None, _Q)


def test_a_grasp_lets_its_links_touch_until_a_free_motion() -> None:
    world = _grasped()
    assert world.touching == TOUCHING
    assert world.after_motion(free=False).touching == world.touching
    left = world.after_motion(free=True)
    assert (left.touching, left.grasped) == ({}, None)
    assert world.key != crate.world().key


def test_an_attached_object_leaves_the_scene_and_takes_its_contacts_along() -> None:
    world = _held()
    assert "crate" not in world.scene.ids
    item = world.holds("crate")
    assert item.attachment.link == "panda_hand_tcp"
    assert set(item.attachment.touches) == {"panda_hand", "wall"}
    # Of the grasp's depth and its own the larger one holds.
    assert item.attachment.touch_depth == 0.002
    assert world.supported == {("crate", "table"): aw.AllowedContact("support", 0.001)}
    assert (world.touching, world.grasped) == ({}, None)
    # At the grasp it is held as that says, exactly, not as the configuration rounds it.
    np.testing.assert_allclose(world.T_tool_object("crate") @ _GRIP, np.eye(4), atol=1e-15)
    moved = world.after_motion(free=False)
    assert moved.supported == {}
    assert moved.holds("crate") is item


def test_without_a_grasp_an_object_is_held_where_it_stands() -> None:
    world = crate.world().after_attach("crate", "panda_link7", ((), 0.001), None, _Q)
    held = world.holds("crate").attachment.held.T_world_obstacle
    stands = forward(crate.panda().chain, _Q, "panda_link7") @ held
    expected = crate.scene().obstacle("crate").T_world_obstacle
    np.testing.assert_allclose(stands, expected, atol=1e-12)
    assert world.supported == {}


def test_a_detached_object_stands_at_its_place_or_where_the_tool_is() -> None:
    carried = _held().after_motion(free=True)
    placed = carried.after_place(Contact("crate", crate.places()[3], ("table",), 0.004))
    assert placed.supported == {("crate", "table"): aw.AllowedContact("support", 0.004)}
    down = placed.after_detach("crate", (("panda_link7",), 0.003), _Q)
    stands = down.scene.obstacle("crate").T_world_obstacle
    np.testing.assert_allclose(stands, crate.places()[3], atol=1e-15)
    assert down.touching == {
        ("crate", "panda_hand"): aw.AllowedContact("touch_links", 0.002),
        ("crate", "panda_link7"): aw.AllowedContact("touch_links", 0.003),
    }
    assert (down.held, down.supported, down.placed) == ((), {}, None)
    dropped = (
        carried.after_detach("crate", ((), 0.001), _Q).scene.obstacle("crate").T_world_obstacle
    )
    tool = forward(crate.panda().chain, _Q)
    np.testing.assert_allclose(dropped, tool @ np.linalg.inv(_GRIP), atol=1e-12)


def test_cells_are_put_together_once_for_what_may_touch_and_the_margin() -> None:
    cells, world = Cells(), _held()
    one = cells.cell(world, [("wall", "panda_hand")], 0.01)
    assert cells.cell(world, [("panda_hand", "wall")], 0.01) is one
    assert cells.cell(world, [], 0.01) is not one
    assert cells.cell(world, [("wall", "panda_hand")], 0.02) is not one
    assert {("crate", "table"), ("panda_hand", "wall"), ("crate", "wall")} <= set(
        one.scene.allowed_collisions
    )
    assert "crate" in one.robot.names
    assert "crate" not in one.scene.ids


def test_a_load_is_carried_by_the_robot_of_the_cell() -> None:
    load = aw.Load(0.5, (0.0, 0.0, 0.02))
    world = _grasped().after_attach("crate", None, ((), 0.001), load, _Q)
    masses = [
        sum(link.inertia.mass for link in cell.robot.chain.links if link.inertia is not None)
        for cell in (Cells().cell(world), Cells().cell(_held()))
    ]
    np.testing.assert_allclose(masses[0] - masses[1], 0.5, atol=1e-12)
