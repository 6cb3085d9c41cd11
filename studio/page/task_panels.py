"""Panels that plan motions, tasks, tours and tool paths, by settings of the schema of the API."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

from armwright_client import Obstacle
from studio.page.entries_panel import EntriesPanel, FieldsPanel
from studio.page.panel import Page, Text, put_value
from studio.page.play_panel import PlayPanel
from studio.settings_form import FormField
from studio.stages import aimed, goal_entry, new_stage, pose_entry
from studio.state import Failure, Outcome, Planned, TaskPlanned, TourPlanned, compare
from studio.workbench import Kind

#: Before a motion of a state that was changed since.
_OLD = "*Planned before the last change: plan again.*\n\n"


class _Panel:
    """Buttons that plan, and what came of the last of them in words.

    Args:
        page: Page of the studio.
    """

    #: Outcomes that are shown whichever panel asked for them, and the text where there is none.
    _shows: type = object
    _idle = ""

    def __init__(self, page: Page) -> None:
        self._page = page
        self._outcome: Outcome | None = None
        self._text: Text

    def _add_button(self, label: str, kind: Kind) -> None:
        button = self._page.server.gui.add_button(label, color="blue")
        button.on_click(lambda _: self._page.queue.put("plan", partial(self._plan, kind, button)))

    def _plan(self, kind: Kind, button: Any) -> None:
        """Plan while the button waits, and show the outcome on the page."""
        self._text.show("Planning …")
        button.disabled = True
        try:
            self._outcome = self._page.workbench.plan(kind)
        finally:
            button.disabled = False
        self._page.refresh()
        self._page.show_outcome()

    def _show_outcome(self) -> None:
        workbench = self._page.workbench
        outcome, view, old = workbench.outcome, workbench.view_url(), workbench.is_outdated
        ours = isinstance(outcome, self._shows) or outcome is self._outcome
        if outcome is None or not ours or (old and isinstance(outcome, Failure)):
            self._text.show(self._idle)
            return
        link = None if view is None else ("Page of this plan", view)
        self._text.show((_OLD if old else "") + describe(outcome), link)


class PlanPanel(_Panel):
    """Settings, the button that plans, and the result in words.

    Args:
        page: Page of the studio.
        play: Panel of the motion, whose curves are shown here.
    """

    _idle = "Set start and goal, then plan."

    def __init__(self, page: Page, play: PlayPanel) -> None:
        super().__init__(page)
        gui, workbench = page.server.gui, page.workbench
        self._add_button("Plan", "motion")
        history = gui.add_button_group("Changes", ["undo", "redo"])
        history.on_click(lambda event: page.run("history", partial(self._step, event.target.value)))
        play.add_curves()
        self._text = Text(gui)
        with gui.add_folder("Settings", expand_by_default=False):
            self._settings = FieldsPanel(
                page,
                "setting",
                workbench.fields,
                lambda: workbench.state.settings,
                workbench.set_setting,
            )
        with gui.add_folder("Constraints", expand_by_default=False):
            forms = workbench.constraint_forms
            self._constraints = EntriesPanel(page, "constraint", forms, lambda k: {forms.tag: k})
        pin = gui.add_button("Pin to compare", hint="The next plan is drawn and listed beside it.")
        pin.on_click(lambda _: page.run("pin", page.workbench.pin))
        self._comparison = Text(gui)

    def refresh(self) -> None:
        """Show settings and result."""
        workbench = self._page.workbench
        self._settings.refresh()
        self._constraints.refresh()
        self._show_outcome()
        pinned, outcome = workbench.pinned, workbench.outcome
        both = pinned is not None and isinstance(outcome, Planned) and outcome is not pinned
        self._comparison.show(compare(pinned, outcome) if both else "")  # type: ignore[arg-type]

    def _step(self, word: str) -> None:
        workbench = self._page.workbench
        if word == "undo":
            workbench.undo()
        else:
            workbench.redo()
        workbench.solve_goal()
        self._page.show_start()


def describe(outcome: Outcome) -> str:
    """A result in Markdown.

    Args:
        outcome: A motion or a failure.
    """
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


#: In the dropdown of objects: there is none.
_NONE = "–"


class TaskPanel(_Panel):
    """The editor of stages, and the button that plans them.

    Args:
        page: Page of the studio.
    """

    _shows = TaskPlanned
    _idle = "Add stages, then plan them."

    def __init__(self, page: Page) -> None:
        super().__init__(page)
        gui, workbench = page.server.gui, page.workbench
        self._add_button("Plan the task", "task")
        self._text = Text(gui)
        with gui.add_folder("Pick and place"):
            self._object = gui.add_dropdown("Object", [_NONE])
            ready = gui.add_button_group("Add stages", ["pick", "place at goal", "both"])
            ready.on_click(lambda event: self._run(partial(self._add_ready, event.target.value)))
        with gui.add_folder("Stages"):
            forms = workbench.stage_forms
            self._stages = EntriesPanel(
                page, "stage", forms, lambda k: new_stage(k, workbench.state)
            )
            aim = gui.add_button(
                "Take the goal's frame",
                hint="As the goal of a move, one more grasp, or one more place of the object.",
            )
            aim.on_click(lambda _: self._run(self._aim))

    def refresh(self) -> None:
        """Show stages and result."""
        obstacles = self._page.workbench.state.obstacles
        names = [item.id for item in obstacles] or [_NONE]
        if names != [*self._object.options]:
            self._object.options = names
            put_value(self._object, names[-1])
        self._stages.refresh()
        self._show_outcome()

    def _add_ready(self, word: str) -> None:
        workbench = self._page.workbench
        workbench.add_pick_and_place(
            self._chosen_object(), pick=word != "place at goal", place=word != "pick"
        )

    def _aim(self) -> None:
        workbench, number = self._page.workbench, self._stages.chosen
        if number is None:
            raise ValueError("choose a stage first")
        stages = workbench.state.stages
        stage = aimed(dict(stages[number]), workbench.state, workbench.goal_tip())
        workbench.set_entries("stages", (*stages[:number], stage, *stages[number + 1 :]))

    def _chosen_object(self) -> Obstacle:
        for item in self._page.workbench.state.obstacles:
            if item.id == self._object.value:
                return item
        raise ValueError("add an obstacle first: the object to be carried")

    def _run(self, action: Callable[[], None]) -> None:
        self._page.run(f"task {id(action)}", action)


class PathsPanel(_Panel):
    """The editors of goals and waypoints, and the buttons that plan them.

    Args:
        page: Page of the studio.
    """

    _shows = TourPlanned
    _idle = "Move the goal's frame, add it as a goal or a waypoint, and again."

    def __init__(self, page: Page) -> None:
        super().__init__(page)
        gui, workbench = page.server.gui, page.workbench
        self._text = Text(gui)
        with gui.add_folder("Tour"):
            self._add_button("Plan the tour", "tour")
            self._goals = EntriesPanel(
                page,
                "goal",
                workbench.goal_forms,
                lambda _: goal_entry(workbench.state, workbench.goal_tip()),
            )
            self._tour_options = self._options("tour", "tour", workbench.tour_fields)
        with gui.add_folder("Tool path"):
            self._add_button("Plan the tool path", "tool path")
            forms = workbench.waypoint_forms
            self._waypoints = EntriesPanel(
                page, "waypoint", forms, lambda _: pose_entry(workbench.goal_tip())
            )
            self._path_options = self._options("tool path", "path", workbench.path_fields)

    def refresh(self) -> None:
        """Show goals, waypoints, options and the result."""
        for panel in (self._goals, self._tour_options, self._waypoints, self._path_options):
            panel.refresh()
        self._show_outcome()

    def _options(self, word: str, which: str, fields: Sequence[FormField]) -> FieldsPanel:
        """Options of a plan in a folder of their own."""
        page, workbench = self._page, self._page.workbench
        read = lambda: getattr(workbench.state, f"{which}_options")  # noqa: E731
        with page.server.gui.add_folder(f"Options of the {word}", expand_by_default=False):
            return FieldsPanel(page, word, fields, read, partial(workbench.set_option, which))
