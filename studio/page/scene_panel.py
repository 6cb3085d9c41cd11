"""Panel of the scene: obstacles are added, sized, carried, removed, imported and saved."""

from functools import partial
from typing import Any

import viser

from armwright_client import Obstacle
from studio.obstacles import dimensions, with_dimension
from studio.page.drawing import MIN_SIZE, ObstacleDrawing
from studio.page.panel import Page, on_user_update

#: Largest size in the editor [m].
_MAX_SIZE = 5.0


class ScenePanel:
    """The list of obstacles and their drawings.

    Args:
        page: Page of the studio.
    """

    def __init__(self, page: Page) -> None:
        self._page = page
        self._drawings: dict[str, ObstacleDrawing] = {}
        self._folders: list[viser.GuiFolderHandle] = []
        self._listed: Any = None
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
            self._run(partial(page.workbench.import_file, file.name, file.content))

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
            self._run(partial(action, name.value))

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
        """Make the list anew where ids, sizes or carriers changed."""
        attached = self._page.workbench.state.attached
        listed = [(item.id, item.shape, attached.get(item.id)) for item in obstacles]
        if listed == self._listed:
            return
        self._listed = listed
        for folder in self._folders:
            folder.remove()
        self._folders = []
        with self._container:
            for obstacle in obstacles:
                self._folders.append(self._entry(obstacle))

    def _entry(self, obstacle: Obstacle) -> viser.GuiFolderHandle:
        gui, workbench = self._page.server.gui, self._page.workbench
        folder = gui.add_folder(obstacle.id, expand_by_default=False)
        with folder:
            for name, value in dimensions(obstacle.shape).items():
                number = gui.add_number(
                    f"{name} [m]", float(value), min=MIN_SIZE, max=_MAX_SIZE, step=0.005
                )
                on_user_update(number, partial(self._resize, obstacle.id, name))
            carrier = gui.add_dropdown(
                "Carried by",
                ["nothing", *workbench.model.links],
                initial_value=workbench.state.attached.get(obstacle.id, "nothing"),
                hint="From the start on: the link closes on it where it stands.",
            )
            on_user_update(carrier, partial(self._attach, obstacle.id))
            remove = gui.add_button("Remove", color="red")
            remove.on_click(lambda _: self._run(partial(workbench.remove_obstacle, obstacle.id)))
        return folder

    def _show_sizing(self, sizing: bool) -> None:
        for drawing in self._drawings.values():
            drawing.show_sizing(sizing)

    def _add(self, kind: Any) -> None:
        self._run(partial(self._page.workbench.add_obstacle, kind))

    def _attach(self, name: str, link: str) -> None:
        carrier = None if link == "nothing" else link
        self._run(partial(self._page.workbench.attach, name, carrier))

    def _resize(self, name: str, dimension: str, value: float) -> None:
        def command() -> None:
            workbench = self._page.workbench
            obstacle = next(item for item in workbench.state.obstacles if item.id == name)
            changed = with_dimension(obstacle, dimension, float(value))
            workbench.change_obstacle(changed, f"size {name} {dimension}")

        self._run(command)

    def _move(self, obstacle: Obstacle, ended: bool) -> None:
        page = self._page

        def command() -> None:
            page.workbench.change_obstacle(obstacle, f"move {obstacle.id}")
            if ended:
                page.workbench.end_drag()
                page.workbench.solve_goal()
                page.refresh()

        page.queue.put(f"move {obstacle.id}", command)

    def _run(self, action: Any) -> None:
        """Carry out a command, then show the scene and the goal's branches in it."""

        def command() -> None:
            action()
            self._page.workbench.solve_goal()

        self._page.run(f"scene {id(action)}", command)
