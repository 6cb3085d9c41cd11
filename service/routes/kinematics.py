"""Forward and inverse kinematics and Jacobians of a robot."""

from fastapi import APIRouter, Request, Response

from kinematics.chain import Chain
from service.http import answers
from service.http.json_route import JsonRoute
from service.http.openapi import RESPONSES
from service.routes.configurations import count, in_worker, json_answer
from service.schemas.kinematics import (
    FkAnswer,
    FkRequest,
    IkAnswer,
    IkRequest,
    JacobianAnswer,
    JacobianRequest,
    VelocityAnswer,
    VelocityRequest,
)
from service.tasks import kinematics as tasks
from service.tasks.inverse_kinematics import ik as ik_task

router = APIRouter(
    prefix="/v1/robots/{name}", tags=["kinematics"], route_class=JsonRoute, responses=RESPONSES
)

#: Frames that are computed in a millisecond; more of them go to a worker.
_INLINE_FRAMES = 200
#: Configurations whose Jacobians are decomposed in a millisecond.
_INLINE_TWISTS = 10


@router.post("/fk", summary="Poses of the links", response_model=FkAnswer)
async def fk(name: str, body: FkRequest, request: Request) -> Response:
    """The pose of one link, the tip if none is named, and of all links, in the base frame."""
    chain = await answers.chain(request, name)
    if _is_cheap(body.joints, chain):
        return json_answer(tasks.fk(chain, body))
    return await in_worker(request, name, tasks.fk_task)


@router.post("/jacobian", summary="Jacobians", response_model=JacobianAnswer)
async def jacobian(name: str, body: JacobianRequest, request: Request) -> Response:
    """The Jacobian of a link or of a point on it, linear rows first, in the base frame."""
    chain = await answers.chain(request, name)
    if _is_cheap(body.joints, chain):
        return json_answer(tasks.jacobian(chain, body))
    return await in_worker(request, name, tasks.jacobian_task)


@router.post("/velocity", summary="Velocity kinematics", response_model=VelocityAnswer)
async def velocity(name: str, body: VelocityRequest, request: Request) -> Response:
    """The twist that joint velocities cause, or the joint velocities that cause a twist.

    The least-norm solution, or that of least residual, plus the null-space term; damped near
    singularities; the answer lists what was damped.
    """
    chain = await answers.chain(request, name)
    if count(body.joints) <= _INLINE_TWISTS:
        return json_answer(tasks.velocity(chain, body))
    return await in_worker(request, name, tasks.velocity_task)


@router.post("/ik", summary="Configurations that reach a pose", response_model=IkAnswer)
async def ik(name: str, body: IkRequest, request: Request) -> Response:
    """Configurations that bring a link to a pose, best first.

    With a scene each is judged; those in collision are answered only where all are asked for.
    """
    content = await request.body()
    result = await answers.answer(
        request,
        lambda robot, scene: ik_task.job(robot, scene, content),
        name,
        body.scene,
        timeout=body.timeout,
    )
    return json_answer(result)


def _is_cheap(joints: list[float] | list[list[float]], chain: Chain) -> bool:
    return count(joints) == 1 or count(joints) * len(chain.links) <= _INLINE_FRAMES
