"""Tools as requests store them, checked in workers."""

from armwright_wire.scenes.tool import NamedTool, Tool
from service.translate.robots.tools import tool
from service.workers.task import task


@task
def make_tool(content: bytes, name: str) -> bytes:
    """Check a tool that is to be stored.

    Args:
        content: The request.
        name: Name of the tool.

    Returns:
        The JSON document to be stored.

    Raises:
        ArmwrightError: The tool can't be made; the message says why.
    """
    body = NamedTool.model_validate(Tool.model_validate_json(content).__dict__ | {"name": name})
    made = tool(body)
    for solid in (*made.solids, *(item for jaw in made.jaws.values() for item in jaw.solids)):
        solid.pieces(name)
    return body.model_dump_json(exclude_none=True).encode()
