"""The studio as a program: a page of a service until it is interrupted."""

import time
from collections.abc import Callable

from armwright_client import Client
from studio.page.local_server import HOST, serve_page
from studio.page.studio_page import StudioPage
from studio.workbench import Workbench


def run(client: Client, url: str, robot: str, port: int, announce: Callable[[str], None]) -> None:
    """Serve the studio's page until the program is interrupted.

    Args:
        client: Connected to the service.
        url: Address of the service, for the code that is shown.
        robot: Name of the first robot.
        port: Port of the page; the next free one if it is taken.
        announce: Called with the page's address once it can be opened.
    """
    workbench = Workbench(client, url, robot)
    page = StudioPage(serve_page(port), workbench)
    try:
        announce(f"http://{HOST}:{page.server.get_port()}")
        while True:
            time.sleep(1.0)
    finally:
        page.close()
