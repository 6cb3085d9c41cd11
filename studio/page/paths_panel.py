"""Panel of tours and tool paths: goals and waypoints from the API's schema, planned and played."""

from collections.abc import Callable
from functools import partial

from studio.entries import Entries
from studio.page.entries_panel import EntriesPanel
from studio.page.fields_panel import FieldsPanel
from studio.page.markdown import Text
from studio.page.panel import Page
from studio.page.plan_panel import describe, page_link
from studio.result import Outcome, TourPlanned
from studio.stages import goal_entry, pose_entry


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
            self._path.on_click(lambda _: page.queue.put("plan", partial(self._plan, "path")))
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

    def _plan(self, which: str) -> None:
        workbench = self._page.workbench
        button = self._tour if which == "tour" else self._path
        self._text.show("Planning …")
        button.disabled = True
        try:
            ask = workbench.plan_tour if which == "tour" else workbench.plan_tool_path
            self._outcome = ask()
        finally:
            button.disabled = False
        self._page.refresh()
        self._page.show_outcome()
