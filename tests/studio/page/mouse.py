"""The mouse on the studio's canvas, places of the scene on the screen, and fields of its forms."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray
from playwright.sync_api import Browser, Locator, Page
from scipy.spatial.transform import Rotation

#: Moves of the mouse that make up one drag.
_STEPS = 3
#: Software WebGL draws a few frames each second; a handle is hovered only once one is drawn [ms].
_FRAME = 200
#: Time in which a handle that was just added is drawn and hovered [ms].
_HOVER = 2000
#: Frames that a drag may take to arrive.
_FRAMES = 50


#: WebGL that draws nothing: in software, every picture takes a second of the processor.
UNDRAWN = """
for (const name of ["drawArrays", "drawElements", "drawElementsInstanced"]) {
  WebGL2RenderingContext.prototype[name] = () => {};
}
"""


@contextmanager
def blank(browser: Browser) -> Iterator[Page]:
    """A page whose canvas stays empty, for tests of what is about it; closed behind them.

    Args:
        browser: The browser.
    """
    page = browser.new_page(viewport={"width": 1000, "height": 600})
    page.add_init_script(UNDRAWN)
    try:
        yield page
    finally:
        page.close()


class Camera(Protocol):
    """Where a camera is and how it looks: its z at the scene, its y down."""

    @property
    def position(self) -> NDArray[np.float64]:
        """In the root frame, shape (3,) [m]."""

    @property
    def wxyz(self) -> NDArray[np.float64]:
        """Orientation, a unit quaternion, shape (4,)."""

    @property
    def fov(self) -> float:
        """Vertical field of view [rad]."""


class Pixel(NamedTuple):
    """A place on the screen, in pixels from the window's upper left corner."""

    x: float
    y: float


def pixel(page: Page, camera: Camera, point: ArrayLike) -> Pixel:
    """Where a point of the scene is on the screen: a pinhole camera that looks along its z.

    Args:
        page: Of the studio.
        camera: Of the browser, as the server knows it.
        point: In the root frame, shape (3,) [m].
    """
    box = page.locator("canvas").first.bounding_box()
    assert box is not None
    looking = Rotation.from_quat(np.roll(camera.wxyz, -1))
    x, y, z = looking.inv().apply(np.asarray(point, dtype=float) - camera.position)
    focal = 0.5 * box["height"] / np.tan(0.5 * camera.fov)
    return Pixel(
        box["x"] + 0.5 * box["width"] + focal * x / z,
        box["y"] + 0.5 * box["height"] + focal * y / z,
    )


def drag(page: Page, begin: Pixel, end: Pixel, arrived: Callable[[], bool]) -> bool:
    """Press the mouse at one place, move it to another, and let it go; whether the drag arrived.

    Args:
        page: Of the studio.
        begin: Where a handle is.
        end: Where it is let go.
        arrived: Whether the program has heard of it; until then the button stays pressed.
    """
    page.mouse.move(*begin)
    page.wait_for_timeout(_HOVER)
    page.mouse.down()
    for part in np.linspace(0.0, 1.0, _STEPS + 1)[1:]:
        page.mouse.move(*(a + part * (b - a) for a, b in zip(begin, end, strict=True)))
        page.wait_for_timeout(_FRAME)
    for _ in range(_FRAMES):
        if arrived():
            break
        page.wait_for_timeout(_FRAME)
        page.mouse.move(*end)
    page.mouse.up()
    return arrived()


def field(page: Page, label: str) -> Locator:
    """The input beside a label."""
    labels = page.get_by_text(label, exact=True).filter(visible=True)
    return labels.last.locator("xpath=following::input[1]")


def typed(page: Page, label: str, text: str) -> None:
    """Select all of a field, and type a text key by key."""
    field(page, label).click()
    page.keyboard.press("Control+A")
    page.keyboard.type(text, delay=30)
