"""Equations of motion, regressors and statics of a robot."""

from fastapi import APIRouter, Request, Response

from service.http import answers
from service.http.json_route import JsonRoute
from service.http.openapi import RESPONSES
from service.routes.configurations import count, in_worker, json_answer
from service.schemas.dynamics import (
    DynamicsAnswer,
    DynamicsRequest,
    RegressorAnswer,
    RegressorRequest,
    WrenchAnswer,
    WrenchRequest,
)
from service.tasks import dynamics as tasks

router = APIRouter(
    prefix="/v1/robots/{name}", tags=["dynamics"], route_class=JsonRoute, responses=RESPONSES
)

#: States that are computed within a millisecond; more of them go to a worker.
_INLINE_STATES = 10


@router.post("/wrench", summary="Torques that hold a wrench", response_model=WrenchAnswer)
async def wrench(name: str, body: WrenchRequest, request: Request) -> Response:
    """τ = Jᵀ F for a wrench F = [f; n] that a link exerts, in the base frame."""
    chain = await answers.chain(request, name)
    if count(body.joints) <= _INLINE_STATES:
        return json_answer(tasks.wrench(chain, body))
    return await in_worker(request, name, tasks.wrench_task)


@router.post("/dynamics", summary="Equations of motion", response_model=DynamicsAnswer)
async def dynamics(name: str, body: DynamicsRequest, request: Request) -> Response:
    """Mass matrix, Coriolis matrix, gravity and the torques of a motion.

    A robot without inertias is refused with MISSING_INERTIA, which names the links.
    """
    chain = await answers.chain(request, name)
    if count(body.joints) <= _INLINE_STATES:
        return json_answer(tasks.dynamics(chain, body))
    return await in_worker(request, name, tasks.dynamics_task)


@router.post("/regressor", summary="Linear parametrisation", response_model=RegressorAnswer)
async def regressor(name: str, _body: RegressorRequest, request: Request) -> Response:
    """The regressor of the equations of motion, the standard and the base parameters.

    Finding the base parameters takes longer than a request should hold up others: a worker does.
    """
    await answers.chain(request, name)
    return await in_worker(request, name, tasks.regressor_task)
