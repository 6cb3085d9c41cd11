"""Panel of planning: settings from the API's schema, the plan, its certificate, or the failure."""

from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any

from studio.page.entries_panel import EntriesPanel
from studio.page.markdown import Text
from studio.page.panel import Page, on_user_update
from studio.result import Failure, Outcome, Planned, compare
from studio.settings_form import FormField

#: In dropdowns: the service decides.
_DEFAULT = "default"


class PlanPanel:
    """Settings, the button that plans, and the result in words.

    Args:
        page: Page of the studio.
    """

    def __init__(self, page: Page) -> None:
        self._page = page
        gui = page.server.gui
        self._widgets: dict[str, Any] = {}
        self.button = gui.add_button("Plan", color="blue")
        self.button.on_click(lambda _: page.queue.put("plan", self._plan))
        history = gui.add_button_group("Changes", ["undo", "redo"])
        history.on_click(lambda event: page.run("history", partial(self._step, event.target.value)))
        self._text = Text(gui)
        with gui.add_folder("Settings", expand_by_default=False):
            for field in page.workbench.fields:
                self._widgets[field.path] = self._widget(field)
        workbench = page.workbench
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
        settings = self._page.workbench.state.settings
        for field in self._page.workbench.fields:
            value = settings.get(field.path, field.default)
            widget = self._widgets[field.path]
            if field.kind in ("choice", "flag"):
                widget.value = _DEFAULT if field.path not in settings else _word(value)
            elif value is not None:
                widget.value = value
        workbench = self._page.workbench
        self._constraints.refresh()
        self._text.show(describe(workbench.outcome), page_link(workbench.view_url()))
        pinned, outcome = workbench.pinned, workbench.outcome
        both = pinned is not None and isinstance(outcome, Planned) and outcome is not pinned
        self._comparison.show(compare(pinned, outcome) if both else "")  # type: ignore[arg-type]

    def _widget(self, field: FormField) -> Any:
        gui = self._page.server.gui
        widget: Any
        if field.kind in ("choice", "flag"):
            choices = field.choices or ("yes", "no")
            widget = gui.add_dropdown(
                field.path, [_DEFAULT, *choices], hint=field.description or None
            )
        else:
            integer = field.kind == "integer"
            start = field.default if field.default is not None else 0.0
            widget = gui.add_number(
                field.path,
                int(start) if integer else float(start),
                min=field.minimum,
                max=field.maximum,
                step=1 if integer else 0.01,
                hint=field.description or None,
            )
        on_user_update(widget, partial(self._set, field))
        return widget

    def _set(self, field: FormField, value: Any) -> None:
        self._page.run(
            f"setting {field.path}",
            lambda: self._page.workbench.set_setting(field.path, setting(field, value)),
        )

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


def setting(field: FormField, value: Any) -> Any:
    """The value of a setting for a widget's value; None where the service decides.

    Args:
        field: Field of the form.
        value: Value of the widget.
    """
    if field.kind == "flag":
        return {"yes": True, "no": False}.get(value)
    if field.kind == "choice":
        return None if value == _DEFAULT else value
    if value == field.default or (field.above_minimum and value <= (field.minimum or 0.0)):
        return None
    return int(value) if field.kind == "integer" else float(value)


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


def _word(value: Any) -> str:
    return ("yes" if value else "no") if isinstance(value, bool) else str(value)
