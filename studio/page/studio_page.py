"""The studio's page: drawings and panels of one workbench, served until interrupted."""

import time
from collections.abc import Callable
from http import HTTPStatus
from pathlib import Path
from threading import Lock
from typing import Any
from unittest.mock import patch

import numpy as np
import viser
import websockets.asyncio.server
from websockets.asyncio.server import ServerConnection
from websockets.datastructures import Headers
from websockets.http11 import Request, Response

from armwright_client import ApiError, ArmwrightError, Client
from studio.code import all_code
from studio.motion_frames import MotionFrames, motion_frames, task_frames, tour_frames
from studio.page.drawing import GhostDrawing, PairDrawing, RobotDrawing, surfaces
from studio.page.panel import CommandQueue, Text
from studio.page.play_panel import PlayPanel
from studio.page.robot_panel import (
    GoalPanel,
    RobotPanel,
    Sliders,
    Units,
    finger_sliders,
    joint_sliders,
)
from studio.page.scene_panel import ScenePanel
from studio.page.task_panels import PathsPanel, PlanPanel, TaskPanel
from studio.state import (
    Failure,
    Outcome,
    Planned,
    TaskPlanned,
    TourPlanned,
    form_hint,
    load_session,
    save_session,
    session_file,
)
from studio.workbench import Workbench, colliding_pairs

#: The robot of the first session.
FIRST_ROBOT = "panda"
#: The only address that the studio listens on.
HOST = "127.0.0.1"
#: Names by which a browser on this machine may call it.
_NAMES = (HOST, "localhost")
#: Ghosts of robots with finer visual meshes are drawn by their collision geometry.
_GHOST_TRIANGLES = 30_000
_REFUSED = "Armwright studio answers its own page on this machine only.\n"

_Handler = Callable[[ServerConnection, Request], Response | None]
#: One server is started at a time: while it starts, a function of websockets is replaced.
_starting = Lock()


def serve_page(port: int) -> viser.ViserServer:
    """Serve the studio's page on 127.0.0.1.

    viser has no setting for origins, and any web page may open a WebSocket to this machine. The
    handshake is therefore guarded: `Host` must name this machine, which also refuses names that a
    foreign domain resolves to 127.0.0.1, and `Origin`, which browsers always send with a
    WebSocket, must be the studio's own.

    Args:
        port: Port to listen on; the next free one if it is taken.
    """
    with _starting, patch.object(websockets.asyncio.server, "serve", _guarded_serve):
        return viser.ViserServer(host=HOST, port=port, label="Armwright studio", verbose=False)


def is_own(host: str | None, origins: list[str]) -> bool:
    """Whether a request comes from the studio's own page or from no page at all.

    Args:
        host: The header `Host`.
        origins: All headers `Origin`; programs that are no browsers send none.
    """
    if host is None or host.rpartition(":")[0] not in _NAMES:
        return False
    return all(origin == f"http://{host}" for origin in origins)


def _guarded_serve(*arguments: Any, **options: Any) -> Any:
    """`websockets.asyncio.server.serve` with the guard before its handler of requests."""
    options["process_request"] = _guard(options["process_request"])
    return _serve(*arguments, **options)


_serve = websockets.asyncio.server.serve


def _guard(handler: _Handler) -> _Handler:
    def guarded(connection: ServerConnection, request: Request) -> Response | None:
        hosts = request.headers.get_all("Host")
        host = hosts[0] if len(hosts) == 1 else None
        if not is_own(host, request.headers.get_all("Origin")):
            headers = Headers({"Content-Type": "text/plain"})
            status = HTTPStatus.FORBIDDEN
            return Response(status, status.phrase, headers, _REFUSED.encode())
        return handler(connection, request)

    return guarded


#: Robot at the start or in motion, and the pinned motion.
_ROBOT_COLOR = (90, 110, 140)
_PINNED_COLOR = (204, 121, 167)
#: Messages leave after this time [s].
_TOLD = 12.0
#: Where the camera begins [m].
CAMERA = (1.15, -1.25, 1.0)
#: Right of most arms, which the panel would cover else [m].
LOOK_AT = (0.45, 0.25, 0.4)


class StudioPage:
    """The page of one workbench; all browsers that open it show the same.

    Args:
        server: Server that serves it.
        workbench: State and commands.
        session: File that keeps the state; None keeps none.
    """

    def __init__(
        self, server: viser.ViserServer, workbench: Workbench, session: Path | None = None
    ) -> None:
        self._session = session
        self.server = server
        self.workbench = workbench
        self.queue = CommandQueue(self._report)
        self._robot: RobotDrawing
        self._pinned_robot: RobotDrawing
        self._pinned_frames: MotionFrames | None = None
        self._ghosts: GhostDrawing
        self._sliders: list[Sliders] = []
        self._drawn: tuple[str, str | None]
        self._is_marked = False
        self._pair = PairDrawing(server.scene)
        self._set_up_scene()
        gui = server.gui
        self.units = Units(gui)
        self._play = PlayPanel(self, self._show_frame)
        tabs = gui.add_tab_group()
        with tabs.add_tab("Plan"):
            self._plan = PlanPanel(self, self._play)
        with tabs.add_tab("Goal"):
            self._goal = GoalPanel(self)
            self._goal_sliders = gui.add_folder(None)
        with tabs.add_tab("Robot"):
            self._robot_panel = RobotPanel(self)
            self._start_sliders = gui.add_folder(None)
            self._finger_sliders = gui.add_folder(None)
        with tabs.add_tab("Scene"):
            self._scene = ScenePanel(self)
        with tabs.add_tab("Task"):
            self._task = TaskPanel(self)
        with tabs.add_tab("Paths"):
            self._paths = PathsPanel(self)
        with tabs.add_tab("Code"):
            self._code = Text(gui)
        self.rebuild()

    def close(self) -> None:
        """End the threads and the server."""
        self._play.close()
        self.queue.close()
        self.server.stop()

    def rebuild(self) -> None:
        """Make robot, sliders and ghosts anew for the present robot and tool."""
        if self._sliders:  # else it is the first robot
            self._robot.remove()
            self._pinned_robot.remove()
            self._ghosts.clear()
        self._drawn = self.workbench.state.robot, self.workbench.state.tool
        bodies = surfaces(self.workbench.geometry())
        looks = surfaces(self.workbench.geometry("visual"))
        scene = self.server.scene
        self._robot = RobotDrawing(scene, "/robot", bodies, _ROBOT_COLOR, looks=looks)
        self._robot.show_looks(self._robot_panel.offer_looks(bool(looks)))
        self._pinned_robot = RobotDrawing(scene, "/pinned", bodies, _PINNED_COLOR, 0.5)
        self._pinned_robot.set_visible(False)
        drawn, still = looks or bodies, self.workbench.still_links()
        if sum(len(body.faces) for body in drawn) > _GHOST_TRIANGLES:
            drawn = bodies
        moving = [body for body in drawn if body.frame not in still]
        self._ghosts = GhostDrawing(scene, moving, self.workbench.model.tip_link)
        for sliders in self._sliders:
            sliders.remove()
        with self._start_sliders:
            start = joint_sliders(self, "start")
        with self._goal_sliders:
            goal = joint_sliders(self, "goal")
        with self._finger_sliders:
            self._sliders = [start, goal, finger_sliders(self)]
        self.workbench.solve_goal()
        self._play.load(None)
        self.show_start()
        self.refresh()

    def refresh(self) -> None:
        """Show the present state everywhere; a robot or tool that was changed is made anew."""
        state = self.workbench.state
        if self._drawn != (state.robot, state.tool):
            self.rebuild()
            return
        if self._is_marked and self.workbench.is_outdated:
            self._mark(None)
            self.show_start()
        with self.server.atomic():
            for sliders in self._sliders:
                sliders.refresh()
            self._robot_panel.refresh()
            self._scene.refresh()
            self._plan.refresh()
            self._task.refresh()
            self._paths.refresh()
            tip = self.workbench.goal_tip()
            self._goal.refresh(tip, self.workbench.branches)
            self.show_goal()
            self._code.show(all_code(self.workbench.url, state, tip))
        if self._session is not None:
            save_session(self._session, state)

    def run(self, key: str, action: Callable[[], None]) -> None:
        """Run an action behind those that wait, and show what came of it.

        Args:
            key: Name of the action; one of the same name that still waits is dropped.
            action: Command to the workbench.
        """

        def command() -> None:
            action()
            self.refresh()

        self.queue.put(key, command)

    def show_looks(self, looks: bool) -> None:
        """Draw the robot by what it looks like, or by its collision geometry.

        Args:
            looks: False for the collision geometry.
        """
        self._robot.show_looks(looks)

    def show_start(self) -> None:
        """Draw the robot at the start."""
        self._robot.show(self.workbench.link_poses(self.workbench.state.start))

    def show_goal(self) -> None:
        """Draw the ghosts that reach the goal."""
        branches = self.workbench.branches
        rows = [branch.joints for branch in branches]
        self._ghosts.show(branches, self.workbench.link_poses_of(rows) if rows else {})

    def show_outcome(self) -> None:
        """Load the motion that was planned, or show the pair of a failure."""
        outcome, pinned = self.workbench.outcome, self.workbench.pinned
        self._mark(outcome)
        if isinstance(outcome, Failure):
            self._play.load(None)
            if outcome.shown is not None:
                self._robot.show(self.workbench.link_poses(outcome.shown))
            return
        beside = pinned if isinstance(outcome, Planned) else None
        self._pinned_frames = None if beside is None else motion_frames(self.workbench, beside)
        self._pinned_robot.set_visible(self._pinned_frames is not None)
        self._ghosts.clear()
        match outcome:
            case Planned():
                self._play.load(motion_frames(self.workbench, outcome))
            case TaskPlanned():
                self._play.load(task_frames(self.workbench, outcome))
            case TourPlanned():
                self._play.load(tour_frames(self.workbench, outcome))

    def _mark(self, outcome: Outcome | None) -> None:
        """Mark what collides where a plan failed; nothing where it did not."""
        failed = outcome if isinstance(outcome, Failure) else None
        self._is_marked = failed is not None
        pairs = [] if failed is None else colliding_pairs(self.workbench, failed)
        shown = None if failed is None else failed.shown
        links = self.workbench.link_poses(shown or self.workbench.state.start)
        self._pair.show(pairs, self._robot, links, self._scene.carried())

    def _show_frame(self, frames: MotionFrames, number: int) -> None:
        with self.server.atomic():
            self._robot.show_frame(frames.links, number)
            pinned = self._pinned_frames
            if pinned is not None:
                self._pinned_robot.show_frame(pinned.links, pinned.at(frames.times[number]))
            drawings = self._scene.carried()
            for name, poses in frames.carried.items():
                if name in drawings:
                    drawings[name].show_frame(poses, number)

    def _set_up_scene(self) -> None:
        gui, scene = self.server.gui, self.server.scene
        # The share button would open a tunnel to a host outside of this machine.
        gui.configure_theme(show_logo=False, show_share_button=False, control_width="large")
        scene.set_up_direction("+z")
        scene.add_grid("/grid", width=4.0, height=4.0, cell_size=0.1, section_size=1.0)
        scene.add_frame("/root", axes_length=0.15, axes_radius=0.004)
        self.server.initial_camera.position = np.array(CAMERA)
        self.server.initial_camera.look_at = np.array(LOOK_AT)

    def _report(self, error: Exception) -> None:
        """Show the error of a command on the page."""
        if isinstance(error, ApiError):
            title, text = error.problem.title, f"{error.problem.detail} {form_hint(error.problem)}"
        elif isinstance(error, ArmwrightError | ValueError):
            title, text = "This did not work", str(error)
        else:
            title, text = type(error).__name__, str(error)
        for client in self.server.get_clients().values():
            client.add_notification(title, text, auto_close_seconds=_TOLD, color="red")


def run(
    client: Client, url: str, robot: str | None, port: int, announce: Callable[[str], None]
) -> None:
    """Serve the studio's page until the program is interrupted.

    Args:
        client: Connected to the service.
        url: Address of the service, for the code that is shown.
        robot: Name of the first robot; None goes on with the session of before, if there is one.
        port: Port of the page; the next free one if it is taken.
        announce: Called with the page's address once it can be opened.
    """
    workbench = Workbench(client, url, robot or FIRST_ROBOT)
    session = session_file()
    before = load_session(session) if robot is None else None
    if before is not None:
        workbench.restore(before)
    page = StudioPage(serve_page(port), workbench, session)
    try:
        announce(f"http://{HOST}:{page.server.get_port()}")
        while True:
            time.sleep(1.0)
    finally:
        page.close()
