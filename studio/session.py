"""Session of the studio, kept over restarts: the present state in one file."""

import json
from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from types import MappingProxyType
from typing import Any

from platformdirs import user_data_path
from pydantic import BaseModel, ValidationError

from armwright_client import FramedPose, Obstacle
from studio.state import StudioState


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
