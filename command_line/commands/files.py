"""The commands that write motions to files and project points onto obstacles."""

import json
from base64 import b64decode
from contextlib import closing
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import typer
from rich.console import Console
from rich.text import Text

from command_line import values
from command_line.backends.backend import at, here
from command_line.backends.endpoints import EXPORT
from command_line.commands.motions import Motion, ask
from command_line.output import print_answer, print_line, print_table, save
from command_line.parameters import (
    Connection,
    Margin,
    Mounted,
    Request,
    RobotSource,
    Scene,
    command,
)
from command_line.problems import invalid_value, negative
from service.viewer.words import against

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
    print_answer(answer, connection.as_json)
    rows = [
        (i, item["obstacle"], item["distance"], item["projection"])
        for i, row in enumerate(json.loads(answer)["projections"])
        for item in row
    ]
    print_table("Projections", ("point", "obstacle", "distance [m]", "nearest point [m]"), rows)


def _answer(connection: Connection, scene: dict[str, Any] | str, body: dict[str, Any]) -> bytes:
    if connection.url is not None:
        with closing(at(connection.url, connection.token)) as remote:
            return remote.projections(scene, body)
    if isinstance(scene, str):
        raise invalid_value(
            "SCENE", f"there is no scene file {scene!r}", "Names are those of a service (--url)."
        )
    with closing(here()) as backend:
        return backend.projections(scene, body)


#: Format of a file that is no text.
_RECORDING = "mcap"
#: Files of meshes that `sweep` writes, by their suffix.
_MESH_FILES = (".glb", ".stl")


class Surroundings(NamedTuple):
    """The scene that an export is proved in."""

    scene: Scene = None
    margin: Margin = 0.0
    different_scene: Annotated[
        bool,
        typer.Option(
            "--different-scene",
            help="Export for another robot, scene or load than the file's motion was proved for.",
        ),
    ] = False


class Points(NamedTuple):
    """Points of a file, in time."""

    sample_period: Annotated[
        float | None,
        typer.Option(help="Time between points [s]; 0.01, or the cycle of egm and rsi."),
    ] = None
    sample_count: Annotated[
        int | None, typer.Option(help="Number of points, in place of a period.")
    ] = None
    least_spacing: Annotated[float | None, typer.Option(help="Least time between points [s].")] = (
        None
    )


@command
def export(
    connection: Connection,
    robot: RobotSource,
    motion: Motion,
    form: Annotated[
        str,
        typer.Option(
            "--format",
            help="joint_trajectory_json, joint_trajectory_yaml, ros2_control, csv, "
            "urscript_servoj, urscript_movej, rapid, krl, egm, rsi or mcap, a recording for "
            "Foxglove.",
        ),
    ],
    request: Request,
    mounted: Mounted,
    around: Surroundings,
    points: Points,
) -> None:
    """Write a motion for a robot controller, with a proof; exit with 1 where it is not proved."""
    if form == _RECORDING and request.output is None and not connection.as_json:
        raise invalid_value("--output", "a recording is no text", "Name a file: -o motion.mcap.")
    kept = values.kept(motion)
    if kept is not None:
        _place(kept["request"], around)
    own = {"plan": kept} if kept is not None else values.mounted(mounted) | {
        "trajectory": values.motion(motion),
        "scene": values.scene(around.scene),
        "margin": around.margin,
        "premises": values.premises(motion),
    }  # fmt: skip
    body: dict[str, Any] = own | {
        "format": form,
        **points._asdict(),
        "different_scene": around.different_scene,
    }
    content = ask(connection, EXPORT, robot, request._replace(output=None), body)
    answer = json.loads(content)
    if request.output is None and form != _RECORDING:
        print_line(answer["content"].rstrip("\n"))
    if request.output is not None:
        text = answer["content"]
        save(request.output, b64decode(text) if form == _RECORDING else text.encode())
    errors = Console(stderr=True, highlight=False)
    errors.print(Text("proved" if answer["proved"] else "not proved", style="bold"))
    for proof in [answer["certificate"]] if kept is None else []:
        errors.print(Text(against(proof)), soft_wrap=True)
    for sentence in answer["unproved"]:
        errors.print(Text(f"not covered: {sentence}", style="yellow"), soft_wrap=True)
    if not answer["proved"]:
        raise negative()


def _place(request: dict[str, Any], around: Surroundings) -> None:
    """Put the scene of the options into the request of a task or tour."""
    if around.margin:
        raise invalid_value("--margin", "stages and legs have those that they were planned with",
                            "Leave it out.")  # fmt: skip
    scene = values.scene(around.scene)
    if scene is not None:
        request["scene"] = scene


@command
def sweep(
    connection: Connection,
    robot: RobotSource,
    motion: Motion,
    output: Annotated[Path, typer.Option("--output", "-o", help="The file, .glb or .stl.")],
    tolerance: Annotated[
        float, typer.Option(help="What the hulls may be grown by [m].", min=1e-4, max=1.0)
    ] = 0.005,
) -> None:
    """Write the space that an arm takes up during a motion, as a mesh that holds all of it."""
    from armwright_wire.motions.trajectory import TrajectoryBody  # noqa: PLC0415
    from obstacles.meshes.writer import glb, stl  # noqa: PLC0415
    from planning.exports.swept_volume import swept_volume  # noqa: PLC0415
    from service.translate.trajectories import trajectory  # noqa: PLC0415
    from service.validation import validate_as  # noqa: PLC0415

    if connection.url is not None:
        raise invalid_value("--url", "swept volumes are computed here", "Leave it out.")
    if output.suffix not in _MESH_FILES:
        raise invalid_value("--output", f"a file {' or '.join(_MESH_FILES)} is written")
    with closing(here()) as backend:
        geometry = backend.geometry(backend.robot_name(robot))
    given = values.motion(motion)
    fields = {name: given[name] for name in ("joint_names", "segments") if name in given}
    body = validate_as(TrajectoryBody, fields)
    swept = swept_volume(trajectory(body, geometry.chain)[0], geometry, tolerance=tolerance)
    surface = swept.surface()
    content = glb(surface, "swept volume") if output.suffix == ".glb" else stl(surface)
    save(output, content)
    figures = {"hulls": len(swept.hulls), "triangles": len(surface.faces), "bytes": len(content)}
    print_answer(figures, connection.as_json)
    print_line(", ".join(f"{count} {name}" for name, count in figures.items()))
