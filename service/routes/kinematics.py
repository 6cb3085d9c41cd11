"""Forward and inverse kinematics and Jacobians of a robot."""

from fastapi import APIRouter, Request, Response

from kinematics.chain import Chain
from service.http.body import JsonRoute
from service.http.openapi import RESPONSES
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
from service.storage import robot_repository
from service.tasks import kinematics as kinematics_tasks
from service.workers.main import Job

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
    chain = await robot_repository.chain(request, name)
    if _costs_little(body.joints, chain):
        return _json(kinematics_tasks.fk(chain, body))
    return _json(await _in_worker(request, name, "fk_batch"))


@router.post("/jacobian", summary="Jacobians", response_model=JacobianAnswer)
async def jacobian(name: str, body: JacobianRequest, request: Request) -> Response:
    """The Jacobian of a link or of a point on it, linear rows first, in the base frame."""
    chain = await robot_repository.chain(request, name)
    if _costs_little(body.joints, chain):
        return _json(kinematics_tasks.jacobian(chain, body))
    return _json(await _in_worker(request, name, "jacobian_batch"))


@router.post("/velocity", summary="Velocity kinematics", response_model=VelocityAnswer)
async def velocity(name: str, body: VelocityRequest, request: Request) -> Response:
    """The twist that joint velocities cause, or the joint velocities that cause a twist.

    The least-norm solution, or that of least residual, plus the null-space term; damped near
    singularities, and what was damped is told.
    """
    chain = await robot_repository.chain(request, name)
    if _count(body.joints) <= _INLINE_TWISTS:
        return _json(kinematics_tasks.velocity(chain, body))
    return _json(await _in_worker(request, name, "velocity_batch"))


@router.post("/ik", summary="Configurations that reach a pose", response_model=IkAnswer)
async def ik(name: str, body: IkRequest, request: Request) -> Response:
    """Configurations that bring a link to a pose, best first.

    With a scene each is judged; those in collision are answered only where all are asked for.
    """
    content = await request.body()
    result = await robot_repository.answer(
        request,
        lambda robot, scene: Job("service.tasks.inverse_kinematics:ik", (robot, scene, content)),
        name,
        body.scene,
        timeout=body.timeout,
    )
    return _json(result)


async def _in_worker(request: Request, name: str, task: str) -> bytes:
    content = await request.body()
    result: bytes = await robot_repository.answer(
        request, lambda robot, _: Job(f"service.tasks.kinematics:{task}", (robot, content)), name
    )
    return result


def _costs_little(joints: list[float] | list[list[float]], chain: Chain) -> bool:
    return _count(joints) == 1 or _count(joints) * len(chain.links) <= _INLINE_FRAMES


def _count(joints: list[float] | list[list[float]]) -> int:
    return len(joints) if isinstance(joints[0], list) else 1


def _json(content: bytes) -> Response:
    return Response(content, media_type="application/json")
