"""A browser for tests of pages: the system's Chromium with WebGL in software."""

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager

from playwright.sync_api import Browser, sync_playwright

from tests.programs import missing

_NAMES = ("chromium", "chromium-browser", "google-chrome")
_ARGUMENTS = ["--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--no-sandbox"]


def program() -> str:
    """Path of the browser: that of ARMWRIGHT_CHROMIUM, or the one of the system."""
    names = filter(None, (os.environ.get("ARMWRIGHT_CHROMIUM"), *_NAMES))
    path = next(filter(None, map(shutil.which, names)), None)
    if path is None:
        missing("Chromium", "apt-get install chromium, or name a program in ARMWRIGHT_CHROMIUM")
    return path


@contextmanager
def browsing() -> Iterator[Browser]:
    """A browser, closed behind the tests."""
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=program(), args=_ARGUMENTS)
        try:
            yield browser
        finally:
            browser.close()
