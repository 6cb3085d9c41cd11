"""Quadratic Lyapunov functions of linear systems."""

from fastapi import Request, Response

from armwright_wire.robots.lyapunov import LyapunovAnswer, LyapunovRequest
from service.http.compute import compute
from service.http.json_route import json_router
from service.task_references import lyapunov as lyapunov_task

router = json_router("tracking")


@router.post("/lyapunov", summary="Examine V = x'Px", response_model=LyapunovAnswer)
async def lyapunov(body: LyapunovRequest, request: Request) -> Response:  # noqa: ARG001
    """The quadratic form V = xᵀ P x as a Lyapunov function of dx/dt = A x.

    With Q in place of P the Lyapunov equation Aᵀ P + P A = −Q is solved. The answer has minors,
    eigenvalues and definiteness of P and Q, V and dV/dt as formulas and at states, and a verdict.
    """
    content = await request.body()
    result = await compute(request, lyapunov_task.job(content))
    return Response(result, media_type="application/json")
