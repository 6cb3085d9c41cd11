"""Panels that plan motions, tasks, tours and tool paths, by settings of the schema of the API."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any, Literal

from armwright_client import Obstacle
from studio.motion_frames import MotionFrames
from studio.page.entries_panel import EntriesPanel, FieldsPanel
from studio.page.panel import Page, Text, put_value
from studio.page.play_panel import PlayPanel
from studio.stages import aimed, goal_entry, new_stage, pick_stages, place_stages, pose_entry
from studio.state import Entries, Failure, Outcome, Planned, TaskPlanned, TourPlanned, compare


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


#: In the dropdown of objects: there is none.
_NONE = "–"


class TaskPanel:
    """The editor of stages, and the button that plans them.

    Args:
        page: Page of the studio.
    """

    def __init__(self, page: Page) -> None:
        self._page = page
        self._outcome: Outcome | None = None
        gui, workbench = page.server.gui, page.workbench
        self.button = gui.add_button("Plan the task", color="blue")
        self.button.on_click(lambda _: page.queue.put("plan", self._plan))
        self._text = Text(gui)
        with gui.add_folder("Pick and place"):
            self._object = gui.add_dropdown("Object", [_NONE])
            ready = gui.add_button_group("Add stages", ["pick", "place at goal", "both"])
            ready.on_click(lambda event: self._run(partial(self._add_ready, event.target.value)))
        with gui.add_folder("Stages"):
            self._stages = EntriesPanel(
                page,
                "stage",
                workbench.stage_forms,
                lambda: workbench.state.stages,
                partial(workbench.set_entries, "stages"),
                lambda kind: new_stage(kind, workbench.state),
            )
            aim = gui.add_button(
                "Take the goal's frame",
                hint="As the goal of a move, one more grasp, or one more place of the object.",
            )
            aim.on_click(lambda _: self._run(self._aim))

    def refresh(self) -> None:
        """Show stages and result."""
        workbench = self._page.workbench
        names = [item.id for item in workbench.state.obstacles] or [_NONE]
        if names != [*self._object.options]:
            self._object.options = names
            put_value(self._object, names[-1])
        self._stages.refresh()
        outcome = workbench.outcome
        ours = isinstance(outcome, TaskPlanned) or (outcome and outcome is self._outcome)
        if ours:
            self._text.show(describe(outcome), page_link(workbench.view_url()))
        else:
            self._text.show("Add stages, then plan them.")

    def _plan(self) -> None:
        with planning(self._page, self._text, self.button):
            self._outcome = self._page.workbench.plan("task")

    def _add_ready(self, word: str) -> None:
        workbench = self._page.workbench
        obstacle = self._chosen_object()
        stages = workbench.state.stages
        if word != "place at goal":
            links, grasps = workbench.gripper_links(), workbench.tool_grasps()
            stages = (*stages, *pick_stages(obstacle, links, grasps))
        if word != "pick":
            stages = (*stages, *place_stages(obstacle, workbench.goal_tip()))
        workbench.set_entries("stages", stages)

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


class PathsPanel:
    """The editors of goals and waypoints, and the buttons that plan them.

    Args:
        page: Page of the studio.
    """

    def __init__(self, page: Page) -> None:
        self._page = page
        self._outcome: Outcome | None = None
        gui, workbench = page.server.gui, page.workbench
        self._text = Text(gui)
        with gui.add_folder("Tour"):
            self._tour = gui.add_button("Plan the tour", color="blue")
            self._tour.on_click(lambda _: page.queue.put("plan", partial(self._plan, "tour")))
            self._goals = EntriesPanel(
                page,
                "goal",
                workbench.goal_forms,
                lambda: workbench.state.goals,
                self._writer("goals"),
                lambda _: goal_entry(workbench.state, workbench.goal_tip()),
            )
            with gui.add_folder("Options of the tour", expand_by_default=False):
                self._tour_options = FieldsPanel(
                    page,
                    "tour",
                    workbench.tour_fields,
                    lambda: workbench.state.tour_options,
                    partial(workbench.set_option, "tour"),
                )
        with gui.add_folder("Tool path"):
            self._path = gui.add_button("Plan the tool path", color="blue")
            self._path.on_click(lambda _: page.queue.put("plan", partial(self._plan, "tool path")))
            self._waypoints = EntriesPanel(
                page,
                "waypoint",
                workbench.waypoint_forms,
                lambda: workbench.state.waypoints,
                self._writer("waypoints"),
                lambda _: pose_entry(workbench.goal_tip()),
            )
            with gui.add_folder("Options of the tool path", expand_by_default=False):
                self._path_options = FieldsPanel(
                    page,
                    "tool path",
                    workbench.path_fields,
                    lambda: workbench.state.path_options,
                    partial(workbench.set_option, "path"),
                )

    def refresh(self) -> None:
        """Show goals, waypoints, options and the result."""
        for panel in (self._goals, self._tour_options, self._waypoints, self._path_options):
            panel.refresh()
        workbench = self._page.workbench
        outcome = workbench.outcome
        ours = isinstance(outcome, TourPlanned) or (outcome and outcome is self._outcome)
        if ours:
            self._text.show(describe(outcome), page_link(workbench.view_url()))
        else:
            self._text.show("Move the goal's frame, add it as a goal or a waypoint, and again.")

    def _writer(self, name: str) -> Callable[[Entries, str | None], None]:
        return partial(self._page.workbench.set_entries, name)

    def _plan(self, which: Literal["tour", "tool path"]) -> None:
        button = self._tour if which == "tour" else self._path
        with planning(self._page, self._text, button):
            self._outcome = self._page.workbench.plan(which)
