"""Panel of the scene: obstacles are added, sized, carried, removed, imported and saved."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import viser

from armwright_client import FramedPose, Obstacle, Pose
from studio.page.drawing import MIN_SIZE, ObstacleDrawing
from studio.page.panel import Page, on_user_update, put_value
from studio.page.robot_panel import NumbersField, PoseFields
from studio.requests import dimensions, with_dimension

#: Carrier of what stands in the scene.
_NOTHING = "nothing"


class ScenePanel:
    """The list of obstacles and their drawings.

    Args:
        page: Page of the studio.
    """

    def __init__(self, page: Page) -> None:
        self._page = page
        self._drawings: dict[str, ObstacleDrawing] = {}
        self._entries: dict[str, _Entry] = {}
        gui = page.server.gui
        add = gui.add_button_group("Add", ["box", "sphere", "cylinder"])
        add.on_click(lambda event: self._add(event.target.value))
        upload = gui.add_upload_button(
            "Import a scene or mesh",
            hint="A scene in JSON or MoveIt's YAML replaces the obstacles; a mesh is added.",
        )

        @upload.on_upload
        def _(event: viser.GuiEvent[viser.GuiUploadButtonHandle]) -> None:
            file = event.target.value
            self.run(partial(page.workbench.import_file, file.name, file.content))

        self._sizing = gui.add_checkbox(
            "Size handles", False, hint="A second handle at each obstacle's corner scales it."
        )
        on_user_update(self._sizing, self._show_sizing)
        name = gui.add_text("Name", "studio")
        files = gui.add_button_group("Stored scene", ["save", "load"])

        @files.on_click
        def _(event: viser.GuiEvent[viser.GuiButtonGroupHandle]) -> None:
            save = event.target.value == "save"
            action = page.workbench.save_scene if save else page.workbench.load_scene
            self.run(partial(action, name.value))

        self._container = gui.add_folder("Obstacles")

    def refresh(self) -> None:
        """Draw and list the obstacles of the present state."""
        state = self._page.workbench.state
        present = {item.id: item for item in state.obstacles}
        for name, drawing in list(self._drawings.items()):
            held = name in state.attached
            shape = present[name].shape if name in present else None
            if shape != drawing.obstacle.shape or held != drawing.held:
                self._drawings.pop(name).remove()
        for name, obstacle in present.items():
            if name in self._drawings:
                self._drawings[name].obstacle = obstacle
                self._drawings[name].show_pose(obstacle.pose)
            else:
                self._drawings[name] = ObstacleDrawing(
                    self._page.server.scene,
                    obstacle,
                    name in state.attached,
                    self._move,
                    self._sizing.value,
                )
        self._list(state.obstacles)

    def carried(self) -> dict[str, ObstacleDrawing]:
        """Drawings of the obstacles, by id."""
        return self._drawings

    def _list(self, obstacles: tuple[Obstacle, ...]) -> None:
        """List the obstacles; entries that stay are not made anew, so that they stay open."""
        workbench = self._page.workbench
        present = {item.id: item for item in obstacles}
        for name, entry in list(self._entries.items()):
            if name not in present or not entry.is_of(present[name], workbench.model.links):
                self._entries.pop(name).remove()
        for name, obstacle in present.items():
            if name not in self._entries:
                with self._container:
                    self._entries[name] = _Entry(self, self._page, obstacle)
            self._entries[name].show(obstacle, workbench.state.attached.get(name, _NOTHING))

    def _show_sizing(self, sizing: bool) -> None:
        for drawing in self._drawings.values():
            drawing.show_sizing(sizing)

    def _add(self, kind: Any) -> None:
        self.run(partial(self._page.workbench.add_obstacle, kind))

    def change(self, name: str, key: str, change: Callable[[Obstacle], Obstacle]) -> None:
        """Change an obstacle.

        Args:
            name: Id of the obstacle.
            key: Subject of the change.
            change: Makes the changed obstacle.
        """

        def command() -> None:
            workbench = self._page.workbench
            obstacle = next(item for item in workbench.state.obstacles if item.id == name)
            workbench.change_obstacle(change(obstacle), f"{key} {name}")

        self.run(command)

    def _move(self, obstacle: Obstacle, ended: bool) -> None:
        page = self._page

        def command() -> None:
            page.workbench.change_obstacle(obstacle, f"move {obstacle.id}")
            if ended:
                page.workbench.end_drag()
                page.workbench.solve_goal()
                page.refresh()

        page.queue.put(f"move {obstacle.id}", command)

    def run(self, action: Any) -> None:
        """Carry out a command, then show the scene and the goal's branches in it."""

        def command() -> None:
            action()
            self._page.workbench.solve_goal()

        self._page.run(f"scene {id(action)}", command)


class _Entry:
    """Fields of an obstacle in the list.

    Args:
        panel: Panel of the scene.
        page: Page of the studio.
        obstacle: The obstacle.
    """

    def __init__(self, panel: ScenePanel, page: Page, obstacle: Obstacle) -> None:
        gui, workbench, name = page.server.gui, page.workbench, obstacle.id
        self._panel, self._name, self._kind = panel, name, type(obstacle.shape)
        self._links = [*workbench.model.links]
        self._folder = gui.add_folder(name, expand_by_default=False)
        with self._folder:
            self._pose = PoseFields(gui, page.units, obstacle.pose, self._move)
            self._sizes = {
                size: NumbersField(
                    gui, size, page.units, "length", [value], partial(self._resize, size), MIN_SIZE
                )
                for size, value in dimensions(obstacle.shape).items()
            }
            self._carrier = gui.add_dropdown(
                "Carried by",
                [_NOTHING, *self._links],
                hint="From the start on: the link closes on it where it stands.",
            )
            on_user_update(self._carrier, self._attach)
            remove = gui.add_button("Remove", color="red")
        self._attaching = partial(workbench.attach, name)
        remove.on_click(lambda _: panel.run(partial(workbench.remove_obstacle, name)))

    def is_of(self, obstacle: Obstacle, links: Sequence[str]) -> bool:
        """Whether the fields are those of an obstacle, beside a robot with these links."""
        return type(obstacle.shape) is self._kind and [*links] == self._links

    def show(self, obstacle: Obstacle, carrier: str) -> None:
        """Show pose, sizes and carrier.

        Args:
            obstacle: The obstacle.
            carrier: Link that carries it.
        """
        self._pose.show(obstacle.pose)
        for size, value in dimensions(obstacle.shape).items():
            self._sizes[size].show([value])
        put_value(self._carrier, carrier)

    def remove(self) -> None:
        """Take the fields from the page."""
        self._pose.remove()
        for field in self._sizes.values():
            field.remove()
        self._folder.remove()

    def _move(self, pose: Pose) -> None:
        framed = FramedPose(position=pose.position, rpy=pose.rpy)
        self._panel.change(
            self._name, "move", lambda item: item.model_copy(update={"pose": framed})
        )

    def _resize(self, size: str, values: list[float]) -> None:
        self._panel.change(
            self._name, f"size {size}", lambda item: with_dimension(item, size, values[0])
        )

    def _attach(self, link: str) -> None:
        self._panel.run(partial(self._attaching, None if link == _NOTHING else link))
