"""Panel of the motion: play, pause, a time slider, exports, and the code that does the same."""

import itertools
import math
import threading
import time
from collections.abc import Callable, Sequence
from typing import get_args

import numpy as np
import viser
from numpy.typing import NDArray
from viser import uplot

from armwright_wire.motions.export import Format as ExportFormat
from studio.motion_frames import MotionFrames
from studio.page.panel import Page, on_user_update, put_value

#: Frames shown each second while a motion plays.
_RATE = 30.0
#: Choices of curves: derivatives of the joints' positions, and the speed of the tool.
NO_CURVES = "none"
_TOOL_SPEED = "tool speed [m/s]"
CURVES = {
    NO_CURVES: None,
    "positions [rad or m]": 0,
    "velocities [1/s]": 1,
    "accelerations [1/s²]": 2,
    _TOOL_SPEED: None,
}
#: Shown first.
_FIRST = "positions [rad or m]"
#: Height of a plot [pixel]: play and curves are in sight together.
_PLOT_HEIGHT = 160
#: Colours that people with defects of colour vision tell apart (Okabe and Ito).
_COLORS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000")
_PATH_COLOR, _PATH_WIDTH = (0, 114, 178), 0.004


class PlayPanel:
    """The time slider and its clock.

    Args:
        page: Page of the studio.
        show: Draws a frame of the motion.
    """

    def __init__(self, page: Page, show: Callable[[MotionFrames, int], None]) -> None:
        self._page = page
        self._show = show
        self._frames: MotionFrames | None = None
        self._playing = threading.Event()
        self._closed = False
        gui = page.server.gui
        self._button = gui.add_button("Play", disabled=True, hint="What was planned last.")
        self._button.on_click(lambda _: self._toggle())
        self._slider = gui.add_slider("Time [s]", 0.0, 1.0, 0.001, 0.0, disabled=True)
        on_user_update(self._slider, self._seek)
        self._plot: viser.GuiUplotHandle | None = None
        self._path: viser.LineSegmentsHandle | None = None
        self._thread = threading.Thread(target=self._run, name="studio clock", daemon=True)
        self._thread.start()

    def add_curves(self) -> None:
        """Add curves, speed and export where the page is being filled."""
        gui = self._page.server.gui
        self._curve = gui.add_dropdown("Curves", [*CURVES], initial_value=_FIRST)
        on_user_update(self._curve, lambda _: self._show_curves())
        self._plotted = gui.add_folder(None, visible=False)
        with gui.add_folder("Speed and export", expand_by_default=False):
            self._speed = gui.add_slider("Speed", 0.1, 2.0, 0.1, 1.0)
            file_format = gui.add_dropdown("Format", list(get_args(ExportFormat)))
            export = gui.add_button("Export the motion")
            export.on_click(lambda event: self._export(event.client, file_format.value))

    def load(self, frames: MotionFrames | None) -> None:
        """Show a motion from its beginning, or none.

        Args:
            frames: Frames of the motion.
        """
        self._playing.clear()
        self._frames = frames
        self._button.label = "Play"
        self._button.disabled = self._slider.disabled = frames is None
        self._show_curves()
        self._draw_path()
        if frames is not None:
            self._slider.max = math.ceil(1e3 * float(frames.times[-1])) / 1e3
            put_value(self._slider, 0.0)
            self._draw(0.0)

    def _show_curves(self) -> None:
        """Draw the curves that are chosen, of all joints or of the tool."""
        if self._plot is not None:
            self._plot.remove()
            self._plot = None
        frames = self._frames
        self._plotted.visible = frames is not None and self._curve.value != NO_CURVES
        if frames is None or not self._plotted.visible:
            return
        model = self._page.workbench.model
        names, rows = curves(frames, self._curve.value, model.joint_names, model.tip_link)
        series = [uplot.Series(label="s")]
        for name, color in zip(names, itertools.cycle(_COLORS)):
            series.append(uplot.Series(label=name, stroke=color, width=1.5))
        with self._plotted:
            self._plot = self._page.server.gui.add_uplot(
                (frames.times, *rows),
                tuple(series),
                scales={"x": uplot.Scale(time=False)},  # else of 1970
                height=_PLOT_HEIGHT,
            )

    def _draw_path(self) -> None:
        """Draw the tool's path through the scene."""
        if self._path is not None:
            self._path.remove()
            self._path = None
        if self._frames is None:
            return
        points = self._frames.links[self._page.workbench.model.tip_link].positions
        pairs = np.stack([points[:-1], points[1:]], axis=1)
        self._path = self._page.server.scene.add_line_segments(
            "/tool_path", pairs, _PATH_COLOR, thickness=_PATH_WIDTH
        )

    def close(self) -> None:
        """End the clock."""
        self._closed = True
        self._playing.set()
        self._thread.join()

    def _toggle(self) -> None:
        if self._frames is None:
            return
        if self._playing.is_set():
            self._playing.clear()
            self._button.label = "Play"
            return
        if self._slider.value >= self._frames.times[-1]:
            put_value(self._slider, 0.0)
        self._button.label = "Pause"
        self._playing.set()

    def _seek(self, value: float) -> None:
        self._playing.clear()
        self._button.label = "Play"
        self._draw(float(value))

    def _draw(self, seconds: float) -> None:
        if self._frames is not None:
            self._show(self._frames, self._frames.at(seconds))

    def _run(self) -> None:
        before = time.monotonic()
        while not self._closed:
            self._playing.wait()
            now = time.monotonic()
            # After a pause the clock begins anew: no longer step than one late frame.
            elapsed = min(now - before, 0.1)
            before = now
            frames = self._frames
            if self._closed or frames is None:
                continue
            end = float(frames.times[-1])
            seconds = min(self._slider.value + elapsed * self._speed.value, end)
            put_value(self._slider, seconds)
            self._draw(seconds)
            if seconds >= end:
                self._playing.clear()
                self._button.label = "Play"
            time.sleep(1.0 / _RATE)

    def _export(self, client: viser.ClientHandle | None, file_format: ExportFormat) -> None:
        def command() -> None:
            export = self._page.workbench.export(file_format)
            if client is not None:
                client.send_file_download(export.name, export.content)

        self._page.queue.put("export", command)


def curves(
    frames: MotionFrames, which: str, joints: Sequence[str], tip: str
) -> tuple[list[str], list[NDArray[np.float64]]]:
    """Names and values of curves over the frames.

    Args:
        frames: Frames of the motion.
        which: One of `CURVES`.
        joints: Names of the joints.
        tip: Link of the tool.
    """
    order = CURVES[which]
    if order is None:
        steps = np.gradient(frames.links[tip].positions, frames.times, axis=0)
        return ["tool"], [np.linalg.norm(steps, axis=1)]
    rows = np.array(frames.joints)
    for _ in range(order):
        rows = np.gradient(rows, frames.times, axis=0)
    return [*joints], [*rows.T]
