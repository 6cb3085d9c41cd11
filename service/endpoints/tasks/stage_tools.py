"""Tools of the stages of a task: the robot with the tool and the tip that each stage has."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

from armwright_wire.plans.stages import SingleStage
from kinematics.errors import InvalidOption
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.robots.tool import PART
from service.storage.caches import worker_cache
from service.storage.caches.cache_key import Mount, Reference


def stage_robots(robot: Reference, stages: Sequence[SingleStage]) -> Iterator[RobotGeometry]:
    """The robot with the tool that it has in each stage, which holds for those after it.

    Args:
        robot: The robot as the task begins.
        stages: Stages in order.

    Raises:
        ArmwrightError: A tool can't be mounted; or a tip is named, and there is no tool.
    """
    others = () if robot.mount is None else robot.mount.others
    documents, current = dict(others), robot
    for k, stage in enumerate(stages):
        mount = current.mount or Mount(None)
        if stage.tool is not None:
            name = stage.tool if isinstance(stage.tool, str) else stage.tool.name
            mount = Mount(documents[name], stage.tcp, others=others)
        elif stage.tcp is not None:
            if mount.tool is None:
                raise InvalidOption(
                    f"stages[{k}] ({stage.kind}): tcp {stage.tcp!r} is the tip of a tool, and the "
                    "robot has none by then",
                    hint="Give tool in the request or in this stage.",
                )
            mount = replace(mount, tcp=stage.tcp, held=None)
        if mount != current.mount and (stage.tool, stage.tcp) != (None, None):
            current = replace(current, mount=mount)
        yield worker_cache.robot(current).geometry


def robot_with_tip(robot: Reference, tip: str | None) -> RobotGeometry:
    """The robot of a task with the tool of one of its stages.

    Args:
        robot: The robot as the task begins.
        tip: Tip that a stage's answer tells; None for that of the beginning.
    """
    own = worker_cache.robot(robot).geometry
    if tip is None or tip == own.chain.tip_link or robot.mount is None:
        return own
    name, _, tcp = tip.partition(PART)
    documents = dict(robot.mount.others)
    if name not in documents and robot.mount.tool is not None:
        documents[name] = robot.mount.tool
    if name not in documents:
        return own
    mount = Mount(documents[name], tcp, others=robot.mount.others)
    return worker_cache.robot(replace(robot, mount=mount)).geometry
