"""Panel of planning: settings from the API's schema, the plan, its certificate, or the failure."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any

from studio.motion_frames import MotionFrames
from studio.page.entries_panel import EntriesPanel, FieldsPanel
from studio.page.panel import Page, Text
from studio.page.play_panel import PlayPanel
from studio.result import Failure, Outcome, Planned, compare


class PlanPanel:
    """Settings, the button that plans, and the result in words.

    Args:
        page: Page of the studio.
        show: Draws a frame of the motion.
    """

    def __init__(self, page: Page, show: Callable[[MotionFrames, int], None]) -> None:
        self._page = page
        gui = page.server.gui
        self.button = gui.add_button("Plan", color="blue")
        self.button.on_click(lambda _: page.queue.put("plan", self._plan))
        history = gui.add_button_group("Changes", ["undo", "redo"])
        history.on_click(lambda event: page.run("history", partial(self._step, event.target.value)))
        self.play = PlayPanel(page, show)
        self._text = Text(gui)
        workbench = page.workbench
        with gui.add_folder("Settings", expand_by_default=False):
            self._settings = FieldsPanel(
                page,
                "setting",
                workbench.fields,
                lambda: workbench.state.settings,
                workbench.set_setting,
            )
        with gui.add_folder("Constraints", expand_by_default=False):
            self._constraints = EntriesPanel(
                page,
                "constraint",
                workbench.constraint_forms,
                lambda: workbench.state.constraints,
                partial(workbench.set_entries, "constraints"),
                lambda kind: {workbench.constraint_forms.tag: kind},
            )
        pin = gui.add_button("Pin to compare", hint="The next plan is drawn and listed beside it.")
        pin.on_click(lambda _: page.run("pin", page.workbench.pin))
        self._comparison = Text(gui)

    def refresh(self) -> None:
        """Show settings and result."""
        workbench = self._page.workbench
        self._settings.refresh()
        self._constraints.refresh()
        self._text.show(describe(workbench.outcome), page_link(workbench.view_url()))
        pinned, outcome = workbench.pinned, workbench.outcome
        both = pinned is not None and isinstance(outcome, Planned) and outcome is not pinned
        self._comparison.show(compare(pinned, outcome) if both else "")  # type: ignore[arg-type]

    def _plan(self) -> None:
        with planning(self._page, self._text, self.button):
            self._page.workbench.plan()

    def _step(self, word: str) -> None:
        workbench = self._page.workbench
        if word == "undo":
            workbench.undo()
        else:
            workbench.redo()
        workbench.solve_goal()
        self._page.show_start()


@contextmanager
def planning(page: Page, text: Text, button: Any) -> Iterator[None]:
    """Context of a plan: its button waits, and its outcome is shown on the page.

    Args:
        page: Page of the studio.
        text: Place that says that it is planned.
        button: Button that was pressed.
    """
    text.show("Planning …")
    button.disabled = True
    try:
        yield
    finally:
        button.disabled = False
    page.refresh()
    page.show_outcome()


def page_link(view: str | None) -> tuple[str, str] | None:
    """The link to the page of a plan, where it has one."""
    return None if view is None else ("Page of this plan", view)


def describe(outcome: Outcome | None) -> str:
    """A result in Markdown.

    Args:
        outcome: A motion, a failure, or nothing yet.
    """
    if outcome is None:
        return "Set start and goal, then plan."
    if isinstance(outcome, Failure):
        lines = [f"**✗ {outcome.title}**", "", outcome.detail]
        if outcome.hint:
            lines += ["", f"*{outcome.hint}*"]
        if outcome.pair is not None:
            lines += ["", f"In collision: **{outcome.pair[0]}** and **{outcome.pair[1]}**"]
        lines += ["", *(f"- {branch.label}: {branch.reason}" for branch in outcome.candidates)]
        return "\n".join(lines)
    lines = [f"**✓ {outcome.title}**", "", *(f"- {text}" for text in outcome.sentences)]
    return "\n".join(lines)
