"""Tools from wire to domain, and onto robots."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from pydantic_core import from_json

from armwright_wire.pose import Pose
from armwright_wire.scenes import tool as schema
from dynamics.model.payload import inertia
from kinematics.arrays import Array
from kinematics.errors import InvalidOption, located
from kinematics.model.chain import Inertia
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.robots.tool import PART, Jaw, Solid, Tool, built_in_tool, mount, with_tip
from service.translate import poses


def mounted(
    robot: RobotGeometry, document: bytes | None, tcp: str | None, held: bytes | None
) -> RobotGeometry:
    """The robot with the tool and the tip of a request.

    Args:
        robot: The robot alone.
        document: The tool, JSON; None for none.
        tcp: Name of its tip; None where it has one, or the tip is another.
        held: An attached object with the pose of the tip on it, JSON; None for no object's tip.

    Raises:
        ArmwrightError: The tool is malformed, or can't be mounted on the robot.
    """
    if document is not None:
        made = tool(schema.NamedTool.model_validate_json(document))
        # The tip of an object takes the place of the tool's.
        robot = mount(robot, made, next(iter(made.tcp)) if held is not None else tcp)
    if held is None:
        return robot
    told: dict[str, Any] = from_json(held)
    item = told["attached"]
    tip = schema.HeldTip(object=item["id"], pose=told["pose"])
    return with_object_tip(robot, tip, item["link"], item["pose"])


def check_tools(robot: RobotGeometry, bodies: Sequence[schema.NamedTool]) -> None:
    """Refuse tools of a robot that can't be mounted on it, or whose names are taken.

    Raises:
        ArmwrightError: There is such a tool; the message says which, and why.
    """
    names = [body.name for body in bodies]
    for body in bodies:
        if body.name in schema.BUILTIN_TOOLS or names.count(body.name) > 1:
            other = "a built-in" if body.name in schema.BUILTIN_TOOLS else "another"
            raise InvalidOption(
                f"tools: {body.name!r} is the name of {other} tool",
                hint="Give each tool a name of its own.",
            )
        made = tool(body)
        mount(robot, made, next(iter(made.tcp)))


def with_object_tip(
    robot: RobotGeometry, tip: schema.HeldTip, link: str, pose: Mapping[str, Any]
) -> RobotGeometry:
    """The robot with a point of an object that a link holds at a pose as its tip."""
    T = poses.transform(Pose.model_validate(pose))
    return with_tip(robot, f"{tip.object}{PART}tip", link, T @ tip_in_object(tip))


def tip_in_object(tip: schema.HeldTip) -> Array:
    """Frame of the tip in the object's, shape (4, 4)."""
    return np.eye(4) if tip.pose is None else poses.transform(tip.pose)


def tool(body: schema.NamedTool) -> Tool:
    """The tool of a request or document.

    Raises:
        ArmwrightError: A pose, a solid, the mass or a number is malformed; the message says which.
    """
    with located(f"tool {body.name!r}", unless=repr(body.name)):
        return _tool(body)


def _tool(body: schema.NamedTool) -> Tool:
    if body.form is not None:
        sizes = {name: float(x) for name, x in vars(body.form).items() if name != "type"}
        return built_in_tool(body.form.type, body.name, body.link, **sizes)
    fingers = body.fingers or {}
    opening = None
    if body.opening is not None:
        opening = (float(body.opening[0]), float(body.opening[1]))
    return Tool(
        body.name,
        {name: poses.transform(pose) for name, pose in (body.tcp or {}).items()},
        tuple(_solid(item) for item in body.solids or ()),
        body.link,
        _inertia(body),
        {name: _jaw(name, item) for name, item in fingers.items()},
        body.grip or ("jaws" if fingers else "none"),
        opening,
        np.nan if body.speed is None else body.speed,
    )


def _solid(body: schema.Solid) -> Solid:
    return Solid(poses.shape(body.shape), poses.transform(body.pose))


def _jaw(name: str, body: schema.ToolFinger) -> Jaw:
    axis = np.array(body.axis, dtype=np.float64)
    if body.travel == 0.0:
        raise InvalidOption(f"finger {name!r} has the travel 0: it does not move with the opening")
    solids = tuple(_solid(item) for item in body.solids)
    return Jaw(poses.transform(body.pose), axis, solids, body.travel, body.type == "revolute")


def _inertia(body: schema.Tool) -> Inertia | None:
    if body.mass is None:
        return None
    tensor = np.zeros((3, 3)) if body.inertia is None else np.array(body.inertia)
    return inertia(body.mass, body.center_of_mass or (0.0, 0.0, 0.0), tensor)
