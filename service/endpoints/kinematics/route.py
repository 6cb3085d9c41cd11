"""Forward and inverse kinematics and Jacobians of a robot."""

from fastapi import Request, Response

from armwright_wire.robots.kinematics import (
    FkAnswer,
    FkRequest,
    IkAnswer,
    IkRequest,
    JacobianAnswer,
    JacobianRequest,
    VelocityAnswer,
    VelocityRequest,
)
from service.http import answers
from service.http.answers import of_robot
from service.http.json_route import json_router
from service.task_references import finger_poses
from service.task_references import fk as fk_task
from service.task_references import ik as ik_task
from service.task_references import jacobian as jacobian_task
from service.task_references import velocity as velocity_task
from service.workers.result import ChainTask

router = json_router("kinematics", "/v1/robots/{name}")

#: Frames that are computed in a millisecond; a request for more of them waits for its turn.
_BRIEF_FRAMES = 200
#: Configurations whose Jacobians are decomposed in a millisecond.
_BRIEF_TWISTS = 10


@router.post("/fk", summary="Poses of the links", response_model=FkAnswer)
async def fk(name: str, body: FkRequest, request: Request) -> Response:
    """The pose of one link, the tip if none is named, and of all links."""
    if body.fingers is not None:
        return await answers.respond(request, of_robot(finger_poses.job), name, body)
    return await _frames(request, name, fk_task, body)


@router.post("/jacobian", summary="Jacobians", response_model=JacobianAnswer)
async def jacobian(name: str, body: JacobianRequest, request: Request) -> Response:
    """The Jacobian of a link or of a point on it, linear rows first, in the frame asked for."""
    return await _frames(request, name, jacobian_task, body)


@router.post("/velocity", summary="Velocity kinematics", response_model=VelocityAnswer)
async def velocity(name: str, body: VelocityRequest, request: Request) -> Response:
    """The twist that joint velocities cause, or the joint velocities that cause a twist.

    The least-norm solution, or that of least residual, plus the null-space term; damped near
    singularities; the answer lists what was damped.
    """
    is_brief = answers.count(body.joints) <= _BRIEF_TWISTS
    return await answers.respond(request, of_robot(velocity_task.job), name, body, at_once=is_brief)


@router.post("/ik", summary="Configurations that reach a pose", response_model=IkAnswer)
async def ik(name: str, body: IkRequest, request: Request) -> Response:
    """Configurations that bring a link to a pose, best first.

    With a scene each is judged; those in collision are answered only where all are asked for.
    """
    return await answers.respond(request, ik_task.job, name, body)


async def _frames(
    request: Request, robot: str, task: ChainTask, body: FkRequest | JacobianRequest
) -> Response:
    """The answer of a task whose time goes by the frames that it computes."""
    count = answers.count(body.joints)
    links = 1 if count == 1 else (await answers.model(request, robot)).links
    is_brief = count * links <= _BRIEF_FRAMES
    return await answers.respond(request, of_robot(task.job), robot, body, at_once=is_brief)
