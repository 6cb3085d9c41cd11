"""The command ``armwright mcp``: tools for language models, over standard input and output."""

from importlib.util import find_spec
from typing import Annotated

import typer

from command_line.parameters import command
from command_line.problems import invalid_value

#: Packages of the extra `mcp`, and the client, by the names that they are imported by.
_NEEDED = ("armwright_client", "httpx", "mcp")
_INSTALL = 'pip install -e ".[mcp]" ./client'


@command
def mcp(
    url: Annotated[
        str, typer.Option(envvar="ARMWRIGHT_URL", help="Address of the service.")
    ] = "http://127.0.0.1:8000",
    token: Annotated[
        str | None, typer.Option(envvar="ARMWRIGHT_TOKEN", help="API key of that service.")
    ] = None,
) -> None:
    """Serve tools to a language model over standard input and output (MCP)."""
    missing = [name for name in _NEEDED if find_spec(name) is None]
    if missing:
        raise invalid_value("mcp", f"{', '.join(missing)} can't be imported", _INSTALL)
    from armwright_client import AsyncClient, ClientOptions  # noqa: PLC0415
    from armwright_wire.errors import InvalidArgument  # noqa: PLC0415
    from command_line.mcp_server import mcp_server  # noqa: PLC0415

    options: ClientOptions = {} if token is None else {"token": token}
    try:
        client = AsyncClient(url, **options)
    except InvalidArgument as error:
        raise invalid_value("--url or --token", str(error)) from None
    mcp_server(client, url).run()
