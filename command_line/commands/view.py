"""The commands ``armwright view`` and ``replay`` of plans in files, or of those a service keeps."""

import json
import webbrowser
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

import armwright_client
from command_line import values
from command_line.backends.backend import at, here
from command_line.output import print_answer, print_line, save
from command_line.parameters import Connection, Mounted, RobotSource, Scene, command
from command_line.problems import CommandProblem, invalid_value, negative
from command_line.robot_files import STANDARD_INPUT, read_json

if TYPE_CHECKING:
    from command_line.backends.local import LocalBackend

#: Operation of a motion that is drawn with nothing but its certificate.
_VALIDATE = "POST /v1/validate"

#: The robot of a motion in a file.
RobotOfFile = Annotated[
    str | None, typer.Option(help="Robot of a file that does not hold it, as in `plan`.")
]


@command
def view(
    connection: Connection,
    mounted: Mounted,
    source: Annotated[
        str,
        typer.Argument(
            metavar="FILE|ID",
            help="Bundle or kept plan, answer of plan or validate, or the id of a plan that the "
            "service at --url keeps.",
        ),
    ],
    robot: RobotOfFile = None,
    scene: Scene = None,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="The page; beside the file if left out.")
    ] = None,
    tree: Annotated[
        bool,
        typer.Option("--tree", help="Plan once more, and draw the tree of the last planner."),
    ] = False,
    show: Annotated[bool, typer.Option("--open", help="Open the page in a browser.")] = False,
) -> None:
    """Write one HTML page that shows a plan and its proof, or why there is no motion."""
    file = Path(source)
    if _is_file(source):
        with closing(here()) as backend:
            name, plan, place = _read(backend, file, robot, scene)
            plan["request"] |= values.mounted(mounted)
            content = backend.page(name, plan, place, tree=tree)
    else:
        address = connection.url or armwright_client.DEFAULT_URL
        with closing(at(address, connection.token)) as service:
            content = service.of_plan("GET", source, f"view?tree={str(tree).lower()}")
    stem = "plan" if source == STANDARD_INPUT else source
    page = output or (file.with_suffix(".html") if file.is_file() else Path(f"{stem}.html"))
    save(page, content)
    if show:
        webbrowser.open(page.absolute().as_uri())
    else:
        print_line(str(page))


@command
def replay(
    connection: Connection,
    source: Annotated[
        str,
        typer.Argument(
            metavar="FILE|ID",
            help="Bundle, kept plan or file of --whole, or the id of a plan that the service at "
            "--url keeps.",
        ),
    ],
    robot: RobotOfFile = None,
    scene: Scene = None,
    changes: Annotated[
        str | None,
        typer.Option(help="Fields to change, JSON or its file, as a merge patch: null removes."),
    ] = None,
    keep: Annotated[
        bool, typer.Option("--keep", help="Keep the replay at the service of --url.")
    ] = False,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="Write the new answer to this file.")
    ] = None,
) -> None:
    """Answer a kept request once more, and compare; exit with 1 where the answer is another."""
    patch = None if changes is None else values.read_value("--changes", changes)
    if not isinstance(patch, dict | None):
        raise invalid_value("--changes", f"{changes!r} are no fields", 'As in {"seed": 3}.')
    if _is_file(source):
        if keep:
            raise invalid_value("--keep", "only a service keeps plans", "Give --url and an id.")
        with closing(here()) as backend:
            name, plan, place = _read(backend, Path(source), robot, scene)
            told = backend.replay(name, plan, place, patch or {})
    else:
        address = connection.url or armwright_client.DEFAULT_URL
        with closing(at(address, connection.token)) as service:
            asked = {"changes": patch, "keep_replay": keep or None}
            told = json.loads(service.of_plan("POST", source, "replay", asked))
    if output is not None and told.get("answer"):
        save(output, json.dumps(told["answer"]).encode())
    if told.get("problem") and not told["same"]:
        raise CommandProblem(told["problem"])
    print_answer(told, connection.as_json)
    print_line("the answer is the same" if told["same"] else "the answer is another, at:", "bold")
    for pointer in told["differences"]:
        print_line(pointer)
    if told.get("plan_id"):
        print_line(f"kept as {told['plan_id']}")
    if not told["same"] and patch is None:
        raise negative()


def _is_file(source: str) -> bool:
    """Whether an argument is a file, not the id of a plan."""
    file = Path(source)
    is_file = file.is_file() or source == STANDARD_INPUT
    if not is_file and file.suffix:
        raise invalid_value("FILE|ID", f"there is no file {source!r}")
    return is_file


def _read(
    backend: "LocalBackend", file: Path, robot: str | None, scene: str | None
) -> tuple[str, dict[str, Any], dict[str, Any] | None]:
    """The robot of a file, its plan, and the stored scene that its request names."""
    document = read_json(file)
    if "armwright_bundle" in document:
        return _of_bundle(document, backend)
    named = document.get("robot")
    source = robot or (named["name"] if isinstance(named, dict) else None)
    if source is None:
        raise invalid_value(str(file), "it does not say which robot it is of",
                            "Name the robot with --robot.")  # fmt: skip
    name = backend.robot_name(RobotSource(source))
    return name, *_plan(document, name, scene)


def _of_bundle(
    bundle: dict[str, Any], backend: "LocalBackend"
) -> tuple[str, dict[str, Any], dict[str, Any] | None]:
    """The robot of a bundle, its plan, and the stored scene that its request names."""
    from service.endpoints.plans.route import checked_bundle  # noqa: PLC0415
    from service.storage.robot_repository import is_built_in  # noqa: PLC0415

    checked = checked_bundle(bundle)
    name, document, stored = checked.robot, checked.robot_document, checked.scene_document
    if name is None:
        raise invalid_value("FILE|ID", "the bundle names no robot")
    # As in a service: nobody else's robot has the name of a built-in one.
    if document is not None and not is_built_in(name):
        backend.add_robot(name, document.encode())
    field = "answer" if checked.status == "succeeded" else "problem"
    fields = checked.model_dump(include={"operation", "version", "seed", "digest"})
    plan = fields | {"request": json.loads(checked.request), field: json.loads(checked.answer)}
    return name, plan, None if stored is None else json.loads(stored)


def _plan(
    document: dict[str, Any], robot: str, scene: str | None
) -> tuple[dict[str, Any], dict[str, Any] | None]:
    """The plan of a file, and the scene that its request names: a kept one, an answer or a motion.

    What an answer or a motion says of its proof is left out: it is proved anew.
    """
    surroundings = values.scene(scene)
    if "operation" in document:
        request = dict(document["request"])
        named = request.get("scene")
        if isinstance(named, str):
            if not isinstance(surroundings, dict):
                raise invalid_value("FILE|ID", f"its scene {named!r} is not in the file",
                                    "Give the scene with --scene, or take the bundle.")  # fmt: skip
            return document, {**surroundings, "name": named}
        if surroundings is not None:
            request["scene"] = surroundings
        return document | {"request": request}, None
    trajectory = document.get("trajectory", document)
    if "segments" not in trajectory:
        raise invalid_value("FILE|ID", "the file holds neither a plan nor a trajectory",
                            "Of a task or tour give the file that `--whole` wrote.")  # fmt: skip
    motion = {name: trajectory[name] for name in ("joint_names", "segments") if name in trajectory}
    request = {"robot": robot, "trajectory": motion}
    request |= {} if surroundings is None else {"scene": surroundings}
    return {"operation": _VALIDATE, "request": request}, None
