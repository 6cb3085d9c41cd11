"""A newcomer's first motion: from a clone with empty caches to a dragged goal that plans and plays.

    python -m benchmarks.first_motion [--source REPOSITORY]

It runs the two commands of a newcomer, `git clone` and `make studio`, opens the page in Chromium,
drags the Panda's goal by its arrow, plans and plays, and tells when each was done. All caches are
empty: packages are fetched, kernels are compiled. It needs the network and Chromium.
"""

import argparse
import os
import re
import signal
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from queue import Empty, Queue
from threading import Thread
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from playwright.sync_api import Page, expect
from scipy.spatial.transform import Rotation

from armwright.robot import load_robot
from kinematics.forward import forward
from studio.page.studio_page import CAMERA, LOOK_AT
from tests.service.viewer.browser import browsing
from tests.studio.page.mouse import drag, pixel

#: Longest wait for the page's address [s], and for one step in the page [ms].
_PATIENCE = 900.0
_STEP = 60_000
#: The drag takes the goal's arrow so far along its x, and moves it on by so much [m].
_HELD = 0.15
_WAY = 0.08
#: The vertical field of view of the page [rad].
_FIELD = np.radians(75.0)


class View(NamedTuple):
    """The camera with which the page begins: z looks at the scene, y points down.

    Attributes:
        position: In the root frame, shape (3,) [m].
        wxyz: Its orientation, a unit quaternion, shape (4,).
        fov: Vertical field of view [rad].
    """

    position: NDArray[np.float64]
    wxyz: NDArray[np.float64]
    fov: float


def first_view() -> View:
    """The view with which the studio begins."""
    forward = np.subtract(LOOK_AT, CAMERA)
    z = forward / np.linalg.norm(forward)
    x = np.cross(z, [0.0, 0.0, 1.0])
    x /= np.linalg.norm(x)
    orientation = Rotation.from_matrix(np.column_stack([x, np.cross(z, x), z]))
    return View(np.array(CAMERA), np.roll(orientation.as_quat(), 1), _FIELD)


@contextmanager
def studio(clone: Path, cache: Path) -> Iterator[str]:
    """`make studio` in a clone with a cache of its own; yields the page's address."""
    environment = os.environ | {"XDG_CACHE_HOME": str(cache), "BROWSER": "true"}
    with subprocess.Popen(
        ["make", "studio"],
        cwd=clone,
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
    ) as process:
        lines: Queue[str] = Queue()
        reader = Thread(target=_read, args=(process, lines.put))
        reader.start()
        try:
            yield _address(lines, time.monotonic() + _PATIENCE)
        finally:
            os.killpg(process.pid, signal.SIGTERM)
            process.wait()
            reader.join()


def _read(process: subprocess.Popen[str], put: Callable[[str], None]) -> None:
    for line in process.stdout or ():
        put(line)


def _address(lines: "Queue[str]", end: float) -> str:
    seen = []
    while time.monotonic() < end:
        try:
            seen.append(lines.get(timeout=1.0))
        except Empty:
            continue
        found = re.search(r"Armwright studio: (http://\S+)", seen[-1])
        if found:
            return found[1]
    raise TimeoutError("".join(seen))


def drag_goal(page: Page) -> None:
    """Drag the goal of the Panda at its home by the arrow along its x."""
    robot = load_robot("panda")
    home = next(iter(robot.states.values()))
    goal = forward(robot.chain, np.array(home))
    held, let_go = (goal[:3, 3] + along * goal[:3, 0] for along in (_HELD, _HELD + _WAY))
    page.get_by_role("tab", name="Goal").click()
    answered = page.get_by_text("configurations are valid")
    begin, end = (pixel(page, first_view(), point) for point in (held, let_go))
    if not drag(page, begin, end, answered.is_visible):
        raise RuntimeError("the goal did not follow the mouse")


def main() -> None:
    """Time it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--source", default=str(Path(__file__).parents[1]), help="what to clone")
    source = parser.parse_args().source
    with tempfile.TemporaryDirectory() as folder, browsing() as browser:
        clone, began = Path(folder, "armwright"), time.monotonic()

        def tell(what: str) -> None:
            print(f"{time.monotonic() - began:6.1f} s  {what}", flush=True)

        subprocess.run(["git", "clone", "-q", source, str(clone)], check=True)
        tell("cloned")
        with studio(clone, Path(folder, "cache")) as address:
            tell("the studio serves its page")
            page = browser.new_page(viewport={"width": 900, "height": 320})
            page.goto(address)
            button = page.get_by_role("button", name="Plan", exact=True)
            expect(button).to_be_visible(timeout=_STEP)
            tell("the page is drawn")
            drag_goal(page)
            tell("the goal is dragged, its branches are shown")
            page.get_by_role("tab", name="Plan").click()
            button.click()
            expect(page.get_by_text("Planned by")).to_be_visible(timeout=_STEP)
            tell("the motion is planned and certified")
            clock = page.get_by_text("0.00 of")
            expect(clock).to_be_visible()
            page.get_by_role("button", name="Play", exact=True).click()
            expect(clock).not_to_be_visible()
            tell("it plays")


if __name__ == "__main__":
    main()
