"""Panel of the motion: play, pause, a time slider, exports, and the code that does the same."""

import threading
import time
from collections.abc import Callable
from typing import get_args

import viser

from armwright_wire.motions.export import Format as ExportFormat
from studio.motion_frames import MotionFrames
from studio.page.markdown import Text
from studio.page.panel import Page, on_user_update, put_value

#: Frames shown each second while a motion plays.
_RATE = 30.0


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
        self._button = gui.add_button("Play", disabled=True)
        self._button.on_click(lambda _: self._toggle())
        self._slider = gui.add_slider("Time [s]", 0.0, 1.0, 0.001, 0.0, disabled=True)
        self._speed = gui.add_slider("Speed", 0.1, 2.0, 0.1, 1.0)
        self._label = Text(gui, "No motion yet.")
        on_user_update(self._slider, self._seek)
        file_format = gui.add_dropdown("Format", list(get_args(ExportFormat)))
        export = gui.add_button("Export the motion")
        export.on_click(lambda event: self._export(event.client, file_format.value))
        self._thread = threading.Thread(target=self._run, name="studio clock", daemon=True)
        self._thread.start()

    def load(self, frames: MotionFrames | None) -> None:
        """Show a motion from its beginning, or none.

        Args:
            frames: Frames of the motion.
        """
        self._playing.clear()
        self._frames = frames
        self._button.label = "Play"
        self._button.disabled = self._slider.disabled = frames is None
        if frames is None:
            self._label.show("No motion.")
            return
        self._slider.max = float(frames.times[-1])
        put_value(self._slider, 0.0)
        self._draw(0.0)

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
        frames = self._frames
        if frames is None:
            return
        self._label.show(f"{seconds:.2f} of {frames.times[-1]:.2f} s")
        self._show(frames, frames.at(seconds))

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
