"""State of the studio: the parts of a request, the changes that undo takes back, the session."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any, TypeAlias

from platformdirs import user_data_path
from pydantic import BaseModel, ValidationError

from armwright_client import FramedPose, Obstacle, Pose

#: Entries in order; each has a field that names its kind.
Entries: TypeAlias = tuple[Mapping[str, Any], ...]
#: Changes that can be taken back.
_MAX_CHANGES = 200


def moved(entries: Entries, number: int, steps: int) -> Entries:
    """The entries with one of them moved, as far as there is room.

    Args:
        entries: Entries in order.
        number: Number of the entry, from 0.
        steps: Towards the end, negative towards the beginning.
    """
    rest = [*entries[:number], *entries[number + 1 :]]
    place = min(max(number + steps, 0), len(rest))
    return (*rest[:place], entries[number], *rest[place:])


def without(entries: Entries, number: int) -> Entries:
    """The entries without one of them.

    Args:
        entries: Entries in order.
        number: Number of the entry, from 0.
    """
    return (*entries[:number], *entries[number + 1 :])


def with_field(entries: Entries, number: int, name: str, value: Any) -> Entries:
    """The entries with a field of one of them changed.

    Args:
        entries: Entries in order.
        number: Number of the entry, from 0.
        name: Name of the field.
        value: New value; None leaves the field to the service.
    """
    entry = {key: item for key, item in entries[number].items() if key != name}
    if value is not None:
        entry[name] = value
    return (*entries[:number], entry, *entries[number + 1 :])


@dataclass(frozen=True, slots=True)
class StudioState:
    """Robot, start, goal, scene and settings.

    Args:
        robot: Name of the robot.
        start: Start configuration [rad or m].
        goal_joints: Goal configuration; drawn also while the goal is a pose [rad or m].
        goal_pose: Pose of the tip as the goal, in the root frame; None where `goal_joints` is the
            goal.
        obstacles: Obstacles of the scene.
        attached: Link that carries an obstacle, by the obstacle's id.
        tool: Name of the stored tool that is mounted; None for the robot's own tip.
        fingers: Positions of the gripper's joints at the start, and during a plan [rad or m].
        settings: Values of further fields of a plan request, by their path: "timing.method".
        constraints: Constraints of a plan, each by its fields as the API has them.
        stages: Stages of a task, each by its fields as the API has them.
        goals: Goals of a tour, likewise.
        waypoints: Waypoints of a tool path, likewise.
        tour_options: Options of the tour, by name.
        path_options: Options of the tool path, by name.
    """

    robot: str
    start: tuple[float, ...]
    goal_joints: tuple[float, ...]
    goal_pose: Pose | None = None
    obstacles: tuple[Obstacle, ...] = ()
    attached: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))
    tool: str | None = None
    fingers: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))
    settings: Mapping[str, Any] = field(default_factory=lambda: MappingProxyType({}))
    constraints: Entries = ()
    stages: Entries = ()
    goals: Entries = ()
    waypoints: Entries = ()
    tour_options: Mapping[str, Any] = field(default_factory=lambda: MappingProxyType({}))
    path_options: Mapping[str, Any] = field(default_factory=lambda: MappingProxyType({}))

    def with_setting(self, path: str, value: Any) -> "StudioState":
        """The state with a setting changed; None leaves the field to the service."""
        settings = {name: item for name, item in self.settings.items() if name != path}
        if value is not None:
            settings[path] = value
        return replace(self, settings=MappingProxyType(settings))

    def with_finger(self, joint: str, position: float) -> "StudioState":
        """The state with a joint of the gripper elsewhere [rad or m]."""
        return replace(self, fingers=MappingProxyType({**self.fingers, joint: position}))

    def with_obstacle(self, obstacle: Obstacle) -> "StudioState":
        """The state with an obstacle added, or put in place of the one of its id."""
        ids = [item.id for item in self.obstacles]
        if obstacle.id not in ids:
            return replace(self, obstacles=(*self.obstacles, obstacle))
        changed = tuple(obstacle if item.id == obstacle.id else item for item in self.obstacles)
        return replace(self, obstacles=changed)

    def without_obstacle(self, obstacle_id: str) -> "StudioState":
        """The state without an obstacle, which nothing carries any more."""
        rest = tuple(item for item in self.obstacles if item.id != obstacle_id)
        return replace(self, obstacles=rest).with_attached(obstacle_id, None)

    def with_attached(self, obstacle_id: str, link: str | None) -> "StudioState":
        """The state with an obstacle carried by a link, or by nothing."""
        attached = {name: item for name, item in self.attached.items() if name != obstacle_id}
        if link is not None:
            attached[obstacle_id] = link
        return replace(self, attached=MappingProxyType(attached))

    def free_id(self, kind: str) -> str:
        """An id that no obstacle has: "box_1"."""
        ids = {item.id for item in self.obstacles}
        number = 1
        while f"{kind}_{number}" in ids:
            number += 1
        return f"{kind}_{number}"


def with_option(options: Mapping[str, Any], name: str, value: Any) -> Mapping[str, Any]:
    """Options with one of them changed.

    Args:
        options: Options by name.
        name: Name of the option.
        value: New value; None leaves the option to the service.
    """
    rest = {key: item for key, item in options.items() if key != name}
    return MappingProxyType(rest if value is None else rest | {name: value})


@dataclass(frozen=True, slots=True)
class History:
    """The present state, those before it and those that undo took back.

    Args:
        present: The state shown.
        past: Earlier states, the latest last.
        future: States taken back, the next one to come again last.
        last_key: Subject of the latest change; a change of the same subject replaces it, so that
            one drag is one change.
    """

    present: StudioState
    past: tuple[StudioState, ...] = ()
    future: tuple[StudioState, ...] = ()
    last_key: str | None = None

    def change(self, state: StudioState, key: str | None = None) -> "History":
        """The history with a new present state.

        Args:
            state: The new state.
            key: Subject of the change, None for a change that stands alone.
        """
        if state == self.present:
            return self
        if key is not None and key == self.last_key:
            return replace(self, present=state, future=())
        past = (*self.past, self.present)[-_MAX_CHANGES:]
        return History(state, past, (), key)

    def close_change(self) -> "History":
        """The history whose next change stands alone, whatever it is about."""
        return replace(self, last_key=None)

    def undo(self) -> "History":
        """The history one change back; itself where there is none."""
        if not self.past:
            return self
        return History(self.past[-1], self.past[:-1], (*self.future, self.present))

    def redo(self) -> "History":
        """The history with the change that was taken back last; itself where there is none."""
        if not self.future:
            return self
        return History(self.future[-1], (*self.past, self.present), self.future[:-1])


def session_file() -> Path:
    """The file of the session."""
    return user_data_path("armwright", appauthor=False) / "studio.json"


def save_session(file: Path, state: StudioState) -> None:
    """Write a state; another process sees all of the file or nothing.

    Args:
        file: File of the session.
        state: State of the studio.

    Raises:
        OSError: The file can't be written.
    """
    file.parent.mkdir(parents=True, exist_ok=True)
    new = file.with_suffix(".new")
    new.write_text(
        json.dumps({item.name: _plain(getattr(state, item.name)) for item in fields(state)})
    )
    new.replace(file)


def load_session(file: Path) -> StudioState | None:
    """The state that was saved last; None where there is none that can be read.

    Args:
        file: File of the session.
    """
    try:
        kept = json.loads(file.read_text())
        kept["obstacles"] = tuple(Obstacle.model_validate(item) for item in kept["obstacles"])
        if kept["goal_pose"] is not None:
            kept["goal_pose"] = FramedPose.model_validate(kept["goal_pose"])
        values = {name: _frozen(value) for name, value in kept.items()}
        return StudioState(**values)
    except (OSError, ValueError, KeyError, TypeError, ValidationError):
        return None


def _plain(value: Any) -> Any:
    if isinstance(value, BaseModel):
        return value.model_dump(mode="json", exclude_none=True)
    if isinstance(value, Mapping):
        return {name: _plain(item) for name, item in value.items()}
    return [_plain(item) for item in value] if isinstance(value, tuple) else value


def _frozen(value: Any) -> Any:
    if isinstance(value, dict):
        return MappingProxyType(value)
    return tuple(value) if isinstance(value, list) else value
