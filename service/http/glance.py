"""Glances at requests that a free worker is going to validate: the server reads a few fields.

To validate a body takes as long in the server as in the worker, which needs what comes of it. Where
a worker waits for work already, the request goes there unvalidated, and is validated here only if
something is wrong with it: what is malformed is refused by the same problem as ever.
"""

import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from fastapi import Request

from armwright_wire.base import NAME_PATTERN
from service.http.job_context import DRY_RUN, job_context
from service.workers.supervisor import WorkerSupervisor

_NAME = re.compile(NAME_PATTERN)
#: Longest timeout that a request may name [s].
_LONGEST = 86_400.0


@dataclass(frozen=True, slots=True)
class Glance:
    """The fields of a request that the server itself reads.

    Args:
        robot: The name of the robot.
        scene: The name of a stored scene, where one is named.
        timeout: As it is named [s].
        check: Validates the request; raises what the framework raises.
    """

    robot: str
    scene: str | None
    timeout: float | None
    check: Callable[[], object]


def glance_at(request: Request, value: Any, check: Callable[[], object]) -> Glance | None:
    """The glance at a request; None where it has to be validated here and now.

    Args:
        request: For which somebody waits; a job is validated before it is accepted.
        value: Its body, parsed.
        check: As `Glance` has it.
    """
    if type(value) is not dict or DRY_RUN in request.scope or job_context(request) is not None:
        return None
    supervisor: WorkerSupervisor | None = getattr(request.app.state, "supervisor", None)
    if supervisor is None or not supervisor.is_ready_for_work:
        return None
    robot, scene, timeout = value.get("robot"), value.get("scene"), value.get("timeout")
    if type(scene) is dict:
        scene = None  # inline: it goes to the worker with the rest
    if type(robot) is not str or _NAME.fullmatch(robot) is None:
        return None
    if scene is not None and (type(scene) is not str or _NAME.fullmatch(scene) is None):
        return None
    if timeout is not None and not (type(timeout) in (int, float) and 0.0 < timeout <= _LONGEST):
        return None
    return Glance(robot, scene, timeout, check)
