"""Base of the page's panels: widgets whose changes by people become commands."""

from collections.abc import Callable
from typing import Any, Protocol

import viser

from studio.page.command_queue import CommandQueue
from studio.workbench import Workbench


class Page(Protocol):
    """The parts of the page that panels use."""

    server: viser.ViserServer
    workbench: Workbench
    queue: CommandQueue

    def refresh(self) -> None:
        """Show the present state everywhere."""

    def rebuild(self) -> None:
        """Make robot, sliders and scene anew for another robot."""

    def show_looks(self, looks: bool) -> None:
        """Draw the robot by what it looks like, or by its collision geometry."""

    def show_start(self) -> None:
        """Draw the robot at the start."""

    def show_goal(self) -> None:
        """Draw the ghosts that reach the goal."""

    def show_outcome(self) -> None:
        """Show the motion that was planned, or why there is none."""


def put_value(widget: Any, value: Any) -> None:
    """Show a value in a widget; mypy takes viser's property for one that can only be read.

    Args:
        widget: Widget of viser.
        value: New value.
    """
    widget.value = value


def on_user_update(widget: Any, action: Callable[[Any], None]) -> None:
    """Call an action with the value of a widget when a person changes it.

    Args:
        widget: Widget with `on_update`.
        action: Called with its value; not called for changes that the program makes.
    """

    @widget.on_update  # type: ignore[untyped-decorator]
    def _(event: viser.GuiEvent[Any]) -> None:
        if event.client is not None:
            action(event.target.value)
