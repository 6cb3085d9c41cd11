"""The command ``armwright project``."""

import json
from typing import Annotated, Any

import typer

from command_line import values
from command_line.local import LocalBackend
from command_line.output import print_json, print_table
from command_line.parameters import Connection, command
from command_line.problems import invalid_value
from command_line.remote import remote_backend

#: Coordinates of a point.
_DIMENSIONS = 3


@command
def project(
    connection: Connection,
    scene: Annotated[
        str, typer.Argument(help="JSON or MoveIt YAML file; with --url also a stored scene.")
    ],
    points: Annotated[
        str, typer.Option(help="x,y,z of one point, or a JSON list of points, or its file [m].")
    ],
    engine: Annotated[str, typer.Option(help="exact or fcl.")] = "exact",
) -> None:
    """Project points onto the obstacles of a scene, with their distances, negative inside."""
    surroundings, given = values.scene(scene), values.read_value("--points", points)
    if not isinstance(given, list) or not given:
        raise invalid_value("--points", f"{points!r} are no points")
    if not isinstance(given[0], list):
        if len(given) != _DIMENSIONS:
            raise invalid_value("--points", f"a point has {_DIMENSIONS} coordinates")
        given = [given]
    body: dict[str, Any] = {"points": given, "engine": engine}
    answer = _answer(connection, surroundings or "", body)
    if connection.as_json:
        print_json(answer)
        return
    rows = [
        (i, item["obstacle"], item["distance"], item["projection"])
        for i, row in enumerate(json.loads(answer)["projections"])
        for item in row
    ]
    print_table("Projections", ("point", "obstacle", "distance [m]", "nearest point [m]"), rows)


def _answer(connection: Connection, scene: dict[str, Any] | str, body: dict[str, Any]) -> bytes:
    if connection.url is not None:
        remote = remote_backend(connection.url, connection.token)
        try:
            return remote.projections(scene, body)
        finally:
            remote.close()
    if isinstance(scene, str):
        raise invalid_value(
            "SCENE", f"there is no scene file {scene!r}", "Names are those of a service (--url)."
        )
    backend = LocalBackend()
    try:
        return backend.projections(scene, body)
    finally:
        backend.close()
