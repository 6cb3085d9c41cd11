"""States and their history: every change can be taken back, a drag is one change."""

from dataclasses import replace

from hypothesis import given
from hypothesis import strategies as st

from armwright_client import Box, Obstacle, Pose
from studio.state import History, StudioState

EMPTY = StudioState("arm", (0.0, 0.0), (1.0, 1.0))


def box(name: str, x: float = 0.0) -> Obstacle:
    return Obstacle(id=name, shape=Box(size=[0.1, 0.1, 0.1]), pose=Pose.at(x, 0.0, 0.0))


def moved(x: float) -> StudioState:
    return replace(EMPTY, start=(x, 0.0))


@given(st.lists(st.integers(0, 50), max_size=20), st.integers(0, 20))
def test_undo_and_redo_walk_through_the_same_states(values: list[int], steps: int) -> None:
    history, states = History(EMPTY), [EMPTY]
    for value in values:
        history = history.change(moved(float(value)))
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
        history = history.change(moved(x), "start 0")
    assert history.undo().present == EMPTY
    history = history.close_change().change(moved(0.4), "start 0")
    assert history.undo().present == moved(0.3)


def test_a_change_after_undo_ends_what_could_come_again() -> None:
    history = History(EMPTY).change(moved(1.0)).undo().change(moved(2.0))
    assert history.redo().present == moved(2.0)


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
