"""Equations of motion, regressors and statics of a robot, and what logs tell of them."""

from typing import Annotated, Literal

from fastapi import Query, Request, Response

from armwright_wire.base import Timeout
from armwright_wire.motions.excitation import ExcitationAnswer, ExcitationRequest
from armwright_wire.robots.calibration import CalibrateAnswer, CalibrateRequest
from armwright_wire.robots.dynamics import (
    DynamicsAnswer,
    DynamicsRequest,
    EquationsAnswer,
    ForwardDynamicsAnswer,
    ForwardDynamicsRequest,
    RegressorAnswer,
    RegressorRequest,
    WrenchAnswer,
    WrenchRequest,
)
from armwright_wire.robots.identification import (
    IdentifyAnswer,
    IdentifyRequest,
)
from service.http import answers
from service.http.answers import of_robot
from service.http.json_route import json_router
from service.task_references import calibrate as calibrate_task
from service.task_references import (
    dynamics_task,
    forward_dynamics_task,
    regressor_task,
    wrench_task,
)
from service.task_references import equations as equations_task
from service.task_references import excitation as excitation_task
from service.task_references import identify as identify_task

router = json_router("dynamics", "/v1/robots/{name}")

#: States that are computed within a millisecond; a request for more of them waits for its turn.
_BRIEF_STATES = 10
#: Pattern of the name of a row of the Jacobian.
_AXIS = "r?[xyz]"


@router.post("/wrench", summary="Torques that hold a wrench", response_model=WrenchAnswer)
async def wrench(name: str, body: WrenchRequest, request: Request) -> Response:
    """τ = Jᵀ F for a wrench F = [f; n] that a link exerts, in the root frame."""
    is_brief = answers.count(body.joints) <= _BRIEF_STATES
    return await answers.respond(request, of_robot(wrench_task.job), name, body, at_once=is_brief)


@router.post("/dynamics", summary="Equations of motion", response_model=DynamicsAnswer)
async def dynamics(name: str, body: DynamicsRequest, request: Request) -> Response:
    """Mass matrix, Coriolis matrix, gravity and the torques of a motion.

    A robot without inertias is refused with MISSING_INERTIA, which names the links.
    """
    is_brief = not (body.christoffel_symbols or body.partial_jacobians)
    is_brief = is_brief and answers.count(body.joints) <= _BRIEF_STATES
    return await answers.respond(request, of_robot(dynamics_task.job), name, body, at_once=is_brief)


@router.post(
    "/forward-dynamics", summary="Accelerations of torques", response_model=ForwardDynamicsAnswer
)
async def forward_dynamics(name: str, body: ForwardDynamicsRequest, request: Request) -> Response:
    """The joint accelerations that torques and a wrench at the tip cause in a state of motion.

    A robot without inertias is refused with MISSING_INERTIA, which names the links.
    """
    is_brief = answers.count(body.joints) <= _BRIEF_STATES
    return await answers.respond(
        request, of_robot(forward_dynamics_task.job), name, body, at_once=is_brief
    )


@router.post("/regressor", summary="Linear parametrisation", response_model=RegressorAnswer)
async def regressor(name: str, body: RegressorRequest, request: Request) -> Response:
    """The regressor of the equations of motion, the standard and the base parameters.

    Finding the base parameters takes longer than a request should hold up others: a worker does.
    """
    return await answers.respond(request, of_robot(regressor_task.job), name, body)


@router.post(
    "/identify", summary="Bodies, drives or a load from logs", response_model=IdentifyAnswer
)
async def identify(name: str, body: IdentifyRequest, request: Request) -> Response:
    """Base parameters, frictions and motor inertias, or a payload, from motions and torques.

    Weighted least squares with standard errors, and the bodies with positive density that fit best.
    Nothing is stored: PATCH the robot with the `inertias` that are answered.
    """
    return await answers.respond(request, of_robot(identify_task.job), name, body)


@router.post(
    "/excitation", summary="A motion to identify an arm by", response_model=ExcitationAnswer
)
async def excitation(name: str, body: ExcitationRequest, request: Request) -> Response:
    """A motion of Fourier series whose base regressor has a small condition number, certified.

    It begins and ends at rest at `start`, keeps all limits, those of torque by the inertias that
    are known so far, and is free of collisions.
    """
    return await answers.respond(request, excitation_task.job, name, body)


@router.post(
    "/calibrate", summary="Frames of joints from measurements", response_model=CalibrateAnswer
)
async def calibrate(name: str, body: CalibrateRequest, request: Request) -> Response:
    """Corrections of joints' frames from poses, positions, distances or a plane that is touched.

    With their errors, and for each joint's bodies the margin that these leave. Nothing is stored:
    PATCH the robot with the `calibration` that is answered.
    """
    return await answers.respond(request, of_robot(calibrate_task.job), name, body)


@router.get("/equations", summary="Formulas", response_model=EquationsAnswer)
async def equations(
    name: str,
    request: Request,
    notation: Annotated[
        Literal["latex", "text"],
        Query(alias="format", description="LaTeX, or plain text that Python evaluates"),
    ] = "latex",
    axes: Annotated[
        str,
        Query(
            pattern=f"^({_AXIS}(,{_AXIS})*)?$",
            description="rows of the Jacobian, as many as joints, for a determinant, as `x,y,z`",
        ),
    ] = "",
    timeout: Annotated[
        Timeout | None, Query(description="[s]; the service's `default_timeout` if left out")
    ] = None,
) -> Response:
    """Forward kinematics, Jacobian, D, C, G and the regressor of a robot as readable formulas.

    Symbols are named as in textbooks: q_1, c_12, m_2, l_1, l_c2, I_2. Their values are answered
    too. The dynamics of long arms are left out where nobody could read them; `notes` says so. With
    `axes` the determinant of these rows of the Jacobian is answered, for arms of up to four joints.
    Slow arms take some seconds. A GET never becomes a job: `Prefer: respond-async` has no effect.
    """
    document = await answers.robot_document(request, name)
    rows = tuple(filter(None, axes.split(",")))
    content = await answers.answer(
        request,
        lambda robot, _: equations_task.job(robot, document, notation, rows),
        name,
        timeout=timeout,
    )
    return answers.json_answer(content)
