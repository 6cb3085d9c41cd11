"""Values of options: configurations, poses, goals, scenes and motions."""

import json
from collections.abc import Mapping
from math import inf
from pathlib import Path
from tempfile import NamedTemporaryFile
from typing import Any

from armwright_client.recordings.recording import Recording, read_recording
from armwright_client.robots.sources import is_mjcf
from command_line.parameters import Cell, Mounted, Recorded
from command_line.problems import invalid_value
from command_line.robot_files import (
    STANDARD_INPUT,
    described,
    read_any,
    read_json,
    standard_input,
)

#: Rows of a Jacobian: velocities along these axes, and about them.
AXES = ("x", "y", "z", "rx", "ry", "rz")
#: Fields of a goal; an object without any of them is a pose.
_GOAL_FIELDS = {"joints", "state", "pose", "any_of"}
_POSE_HINT = (
    'Give JSON {"position": [x, y, z], "quaternion_xyzw": [x, y, z, w]}, a file with it, or the '
    "numbers x,y,z,roll,pitch,yaw or x,y,z,qx,qy,qz,qw."
)
_MOVEIT_FILES = (".yaml", ".yml", ".scene")


def read_value(name: str, text: str) -> Any:
    """The value of an option: JSON, numbers between commas, a JSON file, or a word; - is stdin.

    Args:
        name: The option.
        text: Text of the option.

    Raises:
        ProblemError: It looks like JSON, and is not.
    """
    if text.lstrip().startswith(("{", "[")):
        try:
            return json.loads(text)
        except ValueError as error:
            raise invalid_value(name, f"it is not JSON: {error}") from None
    if text == STANDARD_INPUT:
        return read_any(Path(text))
    numbers = _numbers(text)
    if numbers is not None:
        return numbers
    if Path(text).suffix == ".json":
        return read_json(Path(text))
    return text


def configuration(name: str, text: str, states: Mapping[str, list[float]]) -> list[float]:
    """The joint positions of an option [rad or m].

    Args:
        name: The option.
        text: Numbers, or the name of a state.
        states: Named states of the robot.

    Raises:
        ProblemError: It is neither.
    """
    value = read_value(name, text)
    if isinstance(value, list):
        return value
    if isinstance(value, str) and value in states:
        return states[value]
    names = f"one of the states {', '.join(states)}" if states else "the robot has no named states"
    raise invalid_value(
        name, f"{text!r} is no configuration", f"Give numbers between commas; {names}."
    )


def pose(name: str, text: str) -> dict[str, Any]:
    """The pose of an option.

    Raises:
        ProblemError: It is none.
    """
    value = read_value(name, text)
    if isinstance(value, dict):
        return dict(value.get("pose", value))
    if isinstance(value, list) and len(value) in (3, 6, 7):
        rest = {6: "rpy", 7: "quaternion_xyzw"}.get(len(value))
        return {"position": value[:3]} | ({} if rest is None else {rest: value[3:]})
    raise invalid_value(name, f"{text!r} is no pose", _POSE_HINT)


def goal(name: str, text: str) -> dict[str, Any]:
    """The start or goal of an option: joints, a pose, a named state, or the API's own JSON.

    Raises:
        ProblemError: It looks like JSON, and is not.
    """
    value = read_value(name, text)
    if isinstance(value, list):
        return {"joints": value}
    if isinstance(value, str):
        return {"state": value}
    return value if _GOAL_FIELDS & set(value) else {"pose": value}


def scene(text: str | None) -> dict[str, Any] | str | None:
    """The scene of an option: that of a file, or the name of a stored one.

    Args:
        text: A JSON file, a MoveIt planning scene (YAML or .scene), a model of MuJoCo, JSON, or a
            name; None for none.

    Raises:
        ProblemError: The file is not there or is not JSON.
    """
    if text is None:
        return None
    path = Path(text)
    if path.suffix in _MOVEIT_FILES:
        return {"moveit": path.read_text("utf-8")}
    if path.is_file() and is_mjcf(path):
        from armwright_client.robots.mjcf_scene import scene_from_mjcf  # noqa: PLC0415

        return described(scene_from_mjcf, path).model_dump(mode="json", exclude_none=True)
    value = read_value("--scene", text)
    if isinstance(value, list):
        raise invalid_value("--scene", "a JSON object is needed")
    return value if isinstance(value, str) else dict(value)


def mounted(given: Mounted | Cell) -> dict[str, Any]:
    """The fields of a request that mount a tool.

    Args:
        given: Options of the command.

    Raises:
        ProblemError: A file is not there or is not JSON.
    """
    fields: dict[str, Any] = {}
    if given.tool is not None:
        tool = read_value("--tool", given.tool)
        if isinstance(tool, dict) and given.tool.endswith(".json"):
            tool = {"name": Path(given.tool).stem} | tool
        fields["tool"] = tool
    if given.tcp is not None:
        fields["tcp"] = read_value("--tcp", given.tcp)
    return fields


def cell(given: Cell) -> dict[str, Any]:
    """The fields of a request that mount a tool and place obstacles.

    Args:
        given: Options of the command.

    Raises:
        ProblemError: A file is not there or is not JSON.
    """
    return mounted(given) | {"scene": scene(given.scene), "margin": given.margin}


def recording(
    path: Path, robot: Mapping[str, Any], which: Recorded, tip: str | None = None
) -> Recording:
    """The recorded motion of a file.

    Args:
        path: CSV, JSON, YAML, MCAP file or rosbag; ``-`` for CSV or JSON from standard input.
        robot: The robot, as the API answers it.
        which: Motion of several that is meant.
        tip: Topic of measurements of the tip.

    Raises:
        ProblemError: It holds none, or several, or an option is malformed.
    """
    span = None
    if which.span is not None:
        ends = _numbers(which.span) or []
        if len(ends) != 2:
            raise invalid_value("--span", f"{which.span!r} are no two numbers", "Give 2.5,18.")
        span = (ends[0], ends[1])
    lower, upper = (
        [sign * inf if limit is None else limit for limit in robot["limits"][side]]
        for side, sign in (("lower", -1.0), ("upper", 1.0))
    )
    among = {"topic": which.topic, "prefix": which.prefix, "tip": tip}
    given: dict[str, Any] = {**among, "span": span, "limits": (lower, upper)}
    if str(path) != STANDARD_INPUT:
        return described(read_recording, path, robot["joint_names"], **given)
    text = standard_input()
    kind = ".json" if text.lstrip()[:1] in ("{", "[") else ".csv"
    with NamedTemporaryFile("w", suffix=kind) as file:
        file.write(text)
        file.flush()
        return described(read_recording, Path(file.name), robot["joint_names"], **given)


def motion(path: Path) -> dict[str, Any]:
    """The trajectory of a file: one, or the answer or kept plan that holds it.

    Raises:
        ProblemError: The file is not JSON, or holds no trajectory.
    """
    document = answer_of(read_json(path))
    found = document.get("trajectory", document)
    if not isinstance(found, dict) or not {"segments", "samples"} & set(found):
        refuse_parts(path, document)
        raise invalid_value(
            str(path),
            "it holds no trajectory",
            "Give a trajectory, or the answer that `armwright plan -o FILE` wrote.",
        )
    return dict(found)


def refuse_parts(path: Path, answer: Mapping[str, Any]) -> None:
    """Refuse the answer of a task or tour where one motion is needed.

    Args:
        path: The file.
        answer: Its content.

    Raises:
        ProblemError: It has stages or legs.
    """
    parts = answer.get("stages") or answer.get("legs")
    if isinstance(parts, list) and "trajectory" not in answer:
        raise invalid_value(
            str(path),
            f"it holds the {len(parts)} motions of a task or tour, not one",
            "Each stage or leg has a trajectory with a proof of its own: give a file with one of "
            "them. `view` and `export` take what `--whole` wrote.",
        )


def kept(path: Path) -> dict[str, Any] | None:
    """The task or tour of a file with its request and answer; None where the file holds none."""
    document = read_json(path)
    if document.get("operation") not in ("POST /v1/tasks", "POST /v1/tours"):
        return None
    parts = {name: document.get(name) for name in ("request", "answer")}
    told: dict[str, Any] = {n: json.loads(x) if isinstance(x, str) else x for n, x in parts.items()}
    if document.get("scene_document"):
        scene = json.loads(document["scene_document"])
        told["request"] = told["request"] | {"scene": {n: scene[n] for n in scene if n != "name"}}
    return {"operation": document["operation"], **told}


def premises(path: Path) -> dict[str, Any] | None:
    """The premises that the motion of a file was proved for; None where the file does not tell."""
    certificate = answer_of(read_json(path)).get("certificate")
    return certificate.get("premises") if isinstance(certificate, dict) else None


def answer_of(document: dict[str, Any]) -> dict[str, Any]:
    """The answer of a kept plan or bundle; any other document itself.

    Args:
        document: Content of a file.
    """
    if "operation" not in document or not document.get("answer"):
        return document
    answer = document["answer"]
    return dict(json.loads(answer) if isinstance(answer, str) else answer)


def words(text: str | None) -> list[str] | None:
    """The words between commas of an option; None for none."""
    return None if text is None else [word.strip() for word in text.split(",")]


def _numbers(text: str) -> list[float] | None:
    try:
        return [float(word) for word in text.split(",")]
    except ValueError:
        return None
