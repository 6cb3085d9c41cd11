"""Lyapunov functions of linear systems and of formulas."""

from fastapi import Request, Response

from armwright_wire.robots.lyapunov import LyapunovAnswer, LyapunovRequest
from service.http.compute import compute
from service.http.json_route import json_router
from service.task_references import lyapunov as lyapunov_task

router = json_router("tracking")


@router.post("/lyapunov", summary="Examine V = x'Px", response_model=LyapunovAnswer)
async def lyapunov(body: LyapunovRequest, request: Request) -> Response:  # noqa: ARG001
    """The quadratic form V = xᵀ P x of dx/dt = A x, or V(x) of dx/dt = f(x), as Lyapunov function.

    With Q in place of P the Lyapunov equation Aᵀ P + P A = −Q is solved. The answer has minors,
    eigenvalues and definiteness of P and Q, V and dV/dt as formulas and at states, and a verdict.

    Formulas `f` and `V`, or a `system` by name, are examined near x = 0: `reason` names the theorem
    (Lyapunov, LaSalle, instability) or says what is not shown, `lasalle` has the sets.
    """
    content = await request.body()
    result = await compute(request, lyapunov_task.job(content))
    return Response(result, media_type="application/json")
