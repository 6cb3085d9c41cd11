"""Values of the studio: states and their history, entries and their texts, shapes and handles."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from armwright_client import Box, Cylinder, Halfspace, Obstacle, Pose, Sphere
from armwright_wire.scenes.scene import Capsule, Cone, Shape
from studio.page.drawing import LINE, WIDE, label_places
from studio.page.entries_panel import describe, labels_of, number_in, text_of, value_of
from studio.requests import corner, dimensions, with_corner
from studio.settings_form import EntryForms, FormField
from studio.stages import pick_stages
from studio.state import (
    Branch,
    History,
    StudioState,
    Verdict,
    labels,
    moved,
    with_field,
    without,
)

EMPTY = StudioState("arm", (0.0, 0.0), (1.0, 1.0))


def box(name: str, x: float = 0.0) -> Obstacle:
    return Obstacle(id=name, shape=Box(size=[0.1, 0.1, 0.1]), pose=Pose.at(x, 0.0, 0.0))


def begun(x: float) -> StudioState:
    return replace(EMPTY, start=(x, 0.0))


@given(st.lists(st.integers(0, 50), max_size=20), st.integers(0, 20))
def test_undo_and_redo_walk_through_the_same_states(values: list[int], steps: int) -> None:
    history, states = History(EMPTY), [EMPTY]
    for value in values:
        history = history.change(begun(float(value)))
        if history.present != states[-1]:
            states.append(history.present)
    for k in range(steps):
        history = history.undo()
        assert history.present == states[max(len(states) - 2 - k, 0)]
    for _ in range(steps):
        history = history.redo()
    assert history.present == states[-1]


def test_a_drag_is_one_change() -> None:
    history = History(EMPTY)
    for x in (0.1, 0.2, 0.3):
        history = history.change(begun(x), "start 0")
    assert history.undo().present == EMPTY
    history = history.close_change().change(begun(0.4), "start 0")
    assert history.undo().present == begun(0.3)


def test_a_change_after_undo_ends_what_could_come_again() -> None:
    history = History(EMPTY).change(begun(1.0)).undo().change(begun(2.0))
    assert history.redo().present == begun(2.0)


def test_obstacles_are_added_replaced_and_removed() -> None:
    state = EMPTY.with_obstacle(box("a")).with_obstacle(box("b")).with_obstacle(box("a", 0.5))
    assert [item.id for item in state.obstacles] == ["a", "b"]
    assert list(state.obstacles[0].pose.position) == [0.5, 0.0, 0.0]
    held = state.with_attached("a", "hand")
    assert dict(held.attached) == {"a": "hand"}
    assert not held.without_obstacle("a").attached
    assert held.without_obstacle("a").obstacles == (box("b"),)
    assert not held.with_attached("a", None).attached


def test_free_ids_are_not_taken() -> None:
    state = EMPTY.with_obstacle(box("box_1")).with_obstacle(box("box_3"))
    assert state.free_id("box") == "box_2"


def test_a_setting_without_a_value_is_left_to_the_service() -> None:
    state = EMPTY.with_setting("timing.method", "spline").with_setting("seed", 3)
    assert dict(state.settings) == {"timing.method": "spline", "seed": 3}
    assert dict(state.with_setting("seed", None).settings) == {"timing.method": "spline"}


FORMS = EntryForms("kind", {"a": (), "b": (), "c": ()})
ENTRIES = ({"kind": "a"}, {"kind": "b"}, {"kind": "c", "x": [1.0, 2.0]})


def kinds(entries: tuple[object, ...]) -> str:
    return "".join(item["kind"] for item in entries)  # type: ignore[index]


def test_entries_are_moved_as_far_as_there_is_room() -> None:
    assert kinds(moved(ENTRIES, 0, 1)) == "bac"
    assert kinds(moved(ENTRIES, 2, -1)) == "acb"
    assert kinds(moved(ENTRIES, 2, 1)) == "abc"
    assert kinds(moved(ENTRIES, 0, -1)) == "abc"
    assert kinds(without(ENTRIES, 1)) == "ac"


def test_fields_are_set_and_left_out() -> None:
    changed = with_field(ENTRIES, 0, "x", 3)
    assert changed[0] == {"kind": "a", "x": 3}
    assert with_field(changed, 0, "x", None) == ENTRIES


def test_a_choice_names_its_entry() -> None:
    labels = labels_of(ENTRIES, FORMS)
    assert [number_in(label) for label in labels] == [None, 0, 1, 2]
    assert labels[1:] == ["0 a", "1 b", "2 c"]


def test_entries_are_described() -> None:
    assert describe(ENTRIES, FORMS).splitlines()[2] == "2. **c** x=[1.0, 2.0]"


@pytest.mark.parametrize(
    ("kind", "text", "value"),
    [
        ("json", "[1.0, 2.0]", [1.0, 2.0]),
        ("number", "0.5", 0.5),
        ("integer", "3", 3),
        ("flag", "yes", True),
        ("choice", "tool", "tool"),
        ("text", "first", "first"),
    ],
)
def test_texts_and_values_are_the_same(kind: str, text: str, value: object) -> None:
    field = FormField("x", kind, "", None, ("tool", "root") if kind == "choice" else ())
    assert value_of(field, text) == value
    assert text_of(field, {"x": value}) == text
    assert value_of(field, text_of(field, {})) is None


def test_a_text_that_is_no_value_says_what_is() -> None:
    with pytest.raises(ValueError, match="x: 'one' is not a number"):
        value_of(FormField("x", "number", "", None), "one")
    with pytest.raises(ValueError, match="is not JSON"):
        value_of(FormField("x", "json", "", None), "[1")


SHAPES: list[Shape] = [
    Box(size=[0.1, 0.2, 0.3]),
    Sphere(radius=0.2),
    Cylinder(radius=0.1, height=0.5),
    Capsule(radius=0.1, height=0.5),
    Cone(radius=0.1, height=0.5),
]
LEAST = 0.005
LENGTHS = st.floats(0.01, 3.0)


def obstacle(shape: Shape) -> Obstacle:
    return Obstacle(id="it", shape=shape, pose=Pose.at(1.0, 2.0, 3.0))


@pytest.mark.parametrize("shape", SHAPES)
@given(x=LENGTHS, y=LENGTHS, z=LENGTHS)
def test_the_handle_stays_where_it_is_dragged(shape: Shape, x: float, y: float, z: float) -> None:
    begin = corner(shape)
    assert begin is not None
    wanted = np.where(np.array(begin) > 0.0, [x, y, z], 0.0)
    scaled = with_corner(obstacle(shape), wanted.tolist(), LEAST)
    np.testing.assert_allclose(corner(scaled.shape) or (), wanted)
    assert scaled.pose == obstacle(shape).pose


@pytest.mark.parametrize("shape", SHAPES)
def test_nothing_is_scaled_to_nothing(shape: Shape) -> None:
    scaled = with_corner(obstacle(shape), [0.0, 0.0, 0.0], LEAST)
    assert min(dimensions(scaled.shape).values()) >= 0.5 * LEAST


def test_half_spaces_have_no_handle() -> None:
    assert corner(Halfspace(normal=[0.0, 0.0, 1.0], offset=0.0)) is None


def test_a_pick_with_a_tool_takes_grasps_from_the_shape() -> None:
    crate = Obstacle(id="crate", shape=Box(size=[0.05, 0.05, 0.05]), pose=Pose.at(0.4, 0.0, 0.1))
    for grasps, closes in (("top", {"until": "contact"}), ("suction", {})):
        stages = pick_stages(crate, ["jaw"], grasps)
        grasp, close = (next(s for s in stages if s["kind"] == kind) for kind in ("grasp", "close"))
        assert grasp["grasps"] == {grasps: {}}
        assert grasp["touch_links"] == ["jaw"]
        assert close == {"kind": "close", **closes}
    assert "region" in next(s for s in pick_stages(crate, ["hand"]) if s["kind"] == "grasp")


def test_labels_of_ghosts_stand_for_all_and_cover_none() -> None:
    verdicts = (Verdict.VALID, Verdict.COLLISION, Verdict.VALID)
    group = [Branch(i, (), verdict) for i, verdict in enumerate(verdicts)]
    assert labels(group) == "0, 2 ✓; 1 ✗ collides"
    rng = np.random.default_rng(0)
    for _ in range(50):
        places = rng.uniform(-0.3, 0.3, (8, 3))
        found = label_places(places)
        assert sorted(i for members, _ in found for i in members) == [*range(8)]
        for k, (_, a) in enumerate(found):
            for _, b in found[:k]:
                beside = np.linalg.norm(a[:2] - b[:2]) >= WIDE
                assert beside or abs(a[2] - b[2]) >= LINE - 1e-9
