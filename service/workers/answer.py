"""Tasks that are functions of a chain alone, and the frame that answers are in."""

from collections.abc import Callable
from typing import TypeVar

from numpy.typing import ArrayLike
from pydantic import BaseModel

from kinematics.arrays import Array
from kinematics.model.chain import Chain
from kinematics.root_frame import frame_pose, root_notes
from service.storage.caches import worker_cache
from service.storage.caches.cache_key import Reference
from service.workers.result import ChainTask
from service.workers.task import Task, register

_Body = TypeVar("_Body", bound=BaseModel)


def in_frame(chain: Chain, frame: str | None = None) -> dict[str, str | None]:
    """Fields of an answer that say which frame its poses are in.

    Args:
        chain: The robot.
        frame: The frame that was asked for; the root where none was.
    """
    if "frame_note" not in chain.memo:
        chain.memo["frame_note"] = next(iter(root_notes(chain)), None)
    return {"frame": frame or chain.root_link, "frame_note": chain.memo["frame_note"]}


def frame_transform(chain: Chain, joints: ArrayLike, name: str | None) -> Array | None:
    """T_root_frame of the frame of a request, shape (4, 4); of the tool (..., 4, 4).

    Args:
        chain: The robot.
        joints: Joints of the request, shape (..., n) [rad or m].
        name: The frame; None for the root frame, which is answered by None.

    Raises:
        InvalidLinkName: There is no such frame, or it moves.
        InvalidRobotState: Wrong length.
    """
    if name is None:
        return None
    return frame_pose(chain, name, chain.configuration(joints), "frame")


def chain_task(function: Callable[[Chain, _Body], bytes], model: type[_Body]) -> ChainTask:
    """The task of a function that the server calls itself where there is little to compute.

    Args:
        function: Answers a request about a chain.
        model: Model of the request.
    """

    def run(robot: Reference, content: bytes) -> bytes:
        return function(worker_cache.chain(robot), model.model_validate_json(content))

    return register(Task(f"{function.__module__}:{function.__qualname__}", run))
