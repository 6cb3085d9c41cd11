"""Equations of motion, regressors and statics of a robot."""

from fastapi import APIRouter, Request, Response

from service.http.body import JsonRoute
from service.http.openapi import RESPONSES
from service.schemas.dynamics import (
    DynamicsAnswer,
    DynamicsRequest,
    RegressorAnswer,
    RegressorRequest,
    WrenchAnswer,
    WrenchRequest,
)
from service.storage import robot_repository
from service.tasks import dynamics as dynamics_tasks
from service.workers.main import Job

router = APIRouter(
    prefix="/v1/robots/{name}", tags=["dynamics"], route_class=JsonRoute, responses=RESPONSES
)

#: States that are computed within a millisecond; more of them go to a worker.
_INLINE_STATES = 10


@router.post("/wrench", summary="Torques that hold a wrench", response_model=WrenchAnswer)
async def wrench(name: str, body: WrenchRequest, request: Request) -> Response:
    """τ = Jᵀ F for a wrench F = [f; n] that a link exerts, in the base frame."""
    chain = await robot_repository.chain(request, name)
    if _count(body.joints) <= _INLINE_STATES:
        return _json(dynamics_tasks.wrench(chain, body))
    return _json(await _in_worker(request, name, "wrench_batch"))


@router.post("/dynamics", summary="Equations of motion", response_model=DynamicsAnswer)
async def dynamics(name: str, body: DynamicsRequest, request: Request) -> Response:
    """Mass matrix, Coriolis matrix, gravity and the torques of a motion.

    A robot without inertias is refused with MISSING_INERTIA, which names the links.
    """
    chain = await robot_repository.chain(request, name)
    if _count(body.joints) <= _INLINE_STATES:
        return _json(dynamics_tasks.dynamics(chain, body))
    return _json(await _in_worker(request, name, "dynamics_batch"))


@router.post("/regressor", summary="Linear parametrisation", response_model=RegressorAnswer)
async def regressor(name: str, _body: RegressorRequest, request: Request) -> Response:
    """The regressor of the equations of motion, the standard and the base parameters.

    Finding the base parameters takes longer than a request should hold up others: a worker does.
    """
    await robot_repository.chain(request, name)
    return _json(await _in_worker(request, name, "regressor_batch"))


async def _in_worker(request: Request, name: str, task: str) -> bytes:
    content = await request.body()
    result: bytes = await robot_repository.answer(
        request, lambda robot, _: Job(f"service.tasks.dynamics:{task}", (robot, content)), name
    )
    return result


def _count(joints: list[float] | list[list[float]]) -> int:
    return len(joints) if isinstance(joints[0], list) else 1


def _json(content: bytes) -> Response:
    return Response(content, media_type="application/json")
