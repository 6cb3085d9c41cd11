"""Base of the page's panels: texts, and widgets whose changes become commands of one thread."""

import re
import threading
from collections.abc import Callable
from typing import Any, Protocol
from urllib.parse import quote

import viser

from studio.workbench import Workbench

#: A block of code as `studio.code` writes it; nothing in it is read.
_CODE = re.compile(r"^```(?:python|sh)\n.*?^```$", re.MULTILINE | re.DOTALL)
_READ = re.compile(r"[&<>\[\]!`\\~]")


def escaped(text: str) -> str:
    """Text with emphasis, lists, tables and blocks of code, but nothing that runs or loads.

    Args:
        text: Text with names and texts from anywhere.
    """
    parts, end = [], 0
    for block in _CODE.finditer(text):
        parts += [_escaped(text[end : block.start()]), block[0]]
        end = block.end()
    return "".join([*parts, _escaped(text[end:])])


def _escaped(text: str) -> str:
    return _READ.sub(lambda found: f"&#{ord(found[0])};", text)


class Text:
    """A text of the page.

    Args:
        gui: Interface of viser.
        text: Text that is shown first.
    """

    def __init__(self, gui: viser.GuiApi, text: str = "") -> None:
        self._widget = gui.add_markdown(escaped(text))

    def show(self, text: str, link: tuple[str, str] | None = None) -> None:
        """Show a text.

        Args:
            text: Text with names and texts from anywhere.
            link: Words of ours and the address of a page, shown below it.
        """
        below = "" if link is None else f"\n\n[{link[0]}]({quote(link[1], safe=':/?=&%')})"
        self._widget.content = escaped(text) + below


class CommandQueue:
    """Commands in their order; of commands about the same only the latest waits.

    A drag sends more poses than inverse kinematics answers: those in between are passed over.

    Args:
        on_error: Called with the error of a command that raises one.
    """

    def __init__(self, on_error: Callable[[Exception], None]) -> None:
        self._on_error = on_error
        self._waiting: dict[str, Callable[[], None]] = {}
        self._changed = threading.Condition()
        self._closed = False
        self._busy = False
        self._thread = threading.Thread(target=self._run, name="studio commands", daemon=True)
        self._thread.start()

    def put(self, key: str, command: Callable[[], None]) -> None:
        """Carry out a command after those that wait, in place of one about the same.

        Args:
            key: Subject of the command.
            command: Function to be called.
        """
        with self._changed:
            self._waiting.pop(key, None)
            self._waiting[key] = command
            self._changed.notify_all()

    def join(self, timeout: float) -> bool:
        """Wait until nothing waits or runs; whether that came in time [s]."""
        with self._changed:
            return self._changed.wait_for(lambda: not self._waiting and not self._busy, timeout)

    def close(self) -> None:
        """End the thread after the command that runs."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()
        self._thread.join()

    def _run(self) -> None:
        while True:
            with self._changed:
                self._busy = False
                self._changed.notify_all()
                self._changed.wait_for(lambda: self._waiting or self._closed)
                if self._closed:
                    return
                command = self._waiting.pop(next(iter(self._waiting)))
                self._busy = True
            try:
                command()
            except Exception as error:  # noqa: BLE001 - shown on the page; the thread goes on
                self._on_error(error)


class Page(Protocol):
    """The parts of the page that panels use."""

    server: viser.ViserServer
    workbench: Workbench
    queue: CommandQueue
    units: Any

    def refresh(self) -> None:
        """Show the present state everywhere."""

    def run(self, key: str, action: Callable[[], None]) -> None:
        """Run an action behind those that wait, and show what came of it.

        Args:
            key: Name of the action; one of the same name that still waits is dropped.
            action: Command to the workbench.
        """

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
