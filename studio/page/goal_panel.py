"""Panel of the goal: a frame to be dragged, and the configurations that reach it."""

import numpy as np
import viser

from armwright_client import Pose
from studio.page.numbers import PoseFields
from studio.page.panel import Page, Text, on_user_update, put_value
from studio.pose import pose_of, wxyz
from studio.result import Branch

#: Length of the handles of the goal's frame [m].
_HANDLE = 0.25


class GoalPanel:
    """The goal's frame in the scene and the list of branches beside it.

    Args:
        page: Page of the studio.
    """

    def __init__(self, page: Page) -> None:
        self._page = page
        gui = page.server.gui
        with gui.add_folder("Goal pose"):
            self._pose = PoseFields(gui, page.units, Pose.at(0.0, 0.0, 0.0), self._take_typed)
            self._text = Text(gui, "Drag the frame at the tip, or type a pose.")
            self._choice = gui.add_dropdown("Take branch", ["–"])
        on_user_update(self._choice, self._take_branch)
        self._handle = page.server.scene.add_transform_controls(
            "/goal", scale=_HANDLE, depth_test=False
        )

        @self._handle.on_update
        def _(event: viser.TransformControlsEvent) -> None:
            position = np.asarray(event.target.position, dtype=float)
            pose = pose_of(position, np.asarray(event.target.wxyz, dtype=float))
            self._move(pose, ended=event.phase == "end")

    def refresh(self, tip: Pose, branches: tuple[Branch, ...]) -> None:
        """Show the goal's pose and the branches.

        Args:
            tip: Pose of the tip at the goal.
            branches: Configurations that reach it.
        """
        self._handle.position = np.array(tip.position)
        self._handle.wxyz = wxyz(tip)
        self._pose.show(tip)
        self._text.show(describe(branches))
        labels = ["–", *(branch.label for branch in branches)]
        if tuple(labels) != tuple(self._choice.options):
            self._choice.options = labels
        put_value(self._choice, "–")

    def refresh_branches(self, tip: Pose, branches: tuple[Branch, ...]) -> None:
        """Show the branches, and leave the frame where it is being dragged."""
        self._pose.show(tip)
        self._text.show(describe(branches))
        self._choice.options = ["–", *(branch.label for branch in branches)]

    def _take_typed(self, pose: Pose) -> None:
        self._move(pose, ended=True)

    def _take_branch(self, label: str) -> None:
        number = label.partition(" ")[0]
        if not number.isdigit():
            return

        self._page.run("branch", lambda: self._page.workbench.choose_branch(int(number)))

    def _move(self, pose: Pose, *, ended: bool) -> None:
        page = self._page

        def command() -> None:
            branches = page.workbench.move_goal(pose, "goal pose")
            page.show_goal()
            if ended:
                page.workbench.end_drag()
                page.refresh()
            else:
                self.refresh_branches(pose, branches)

        page.queue.put("goal pose", command)


def describe(branches: tuple[Branch, ...]) -> str:
    """The branches as a list in Markdown.

    Args:
        branches: Configurations that reach the goal.
    """
    if not branches:
        return "**No configuration reaches this pose.**"
    valid = sum(not branch.reason for branch in branches)
    lines = [f"**{valid} of {len(branches)} configurations are valid.**", ""]
    for branch in branches:
        detail = f": {branch.reason}" if branch.reason else ""
        name = f" ({branch.name})" if branch.name else ""
        lines.append(f"- {branch.label}{name}{detail}")
    return "\n".join(lines)
