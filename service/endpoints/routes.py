"""Routes whose body is the work of one task."""

from typing import Any

from fastapi import Request, Response
from pydantic_core import to_json

from armwright_wire.motions.export import ExportAnswer, ExportRequest
from armwright_wire.motions.retime import (
    ConvertRequest,
    FitAnswer,
    FitRequest,
    JointTrajectoryAnswer,
    RetimeAnswer,
    RetimeRequest,
    SimplifyAnswer,
    SimplifyRequest,
)
from armwright_wire.motions.simulation import SimulateAnswer, SimulateRequest
from armwright_wire.plans.task import TaskAnswer, TaskRequest
from armwright_wire.plans.tour import TourAnswer, TourRequest
from armwright_wire.pose import ConvertPoseAnswer, ConvertPoseRequest
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
from armwright_wire.robots.lyapunov import LyapunovAnswer, LyapunovRequest
from armwright_wire.robots.potential import PotentialAnswer, PotentialRequest
from armwright_wire.robots.reach import ReachAnswer, ReachRequest
from armwright_wire.scenes.check import CheckAnswer, CheckRequest
from service import task_references as tasks
from service.endpoints.plans.replay import pinned_references
from service.http import answers
from service.http.answers import json_answer, of_robot
from service.http.compute import compute
from service.http.json_route import json_router
from service.http.state import REPLAY, Replay, kept_plan
from service.validation import parse_json, validate_as
from service.workers.result import ChainTask

checking = json_router("checking")
kinematics = json_router("kinematics")
planning = json_router("planning")
timing = json_router("timing")
tracking = json_router("tracking")
ROUTERS = (kinematics, checking, planning, timing, tracking)

_REACH = {
    200: {
        "description": "Arrays with a number for each pose, a picture or a mesh",
        "model": ReachAnswer,
        "content": {"image/svg+xml": {}, "model/gltf-binary": {}},
    }
}
_MEDIA_TYPES = {
    "json": "application/json",
    "svg": "image/svg+xml",
    "glb": "model/gltf-binary",
}


@kinematics.post(
    "/poses/convert", summary="Convert and compose poses", response_model=ConvertPoseAnswer
)
async def convert_pose(body: ConvertPoseRequest, request: Request) -> Response:  # noqa: ARG001
    """A pose, or motions carried out in turn about current or fixed axes, in every form.

    Both branches of the angles are answered. Where an angle is not determined, `singular` says
    which combination is, and the choice made for the rest.
    """
    return json_answer(await compute(request, tasks.convert_pose.job(await request.body())))


@checking.post("/check", summary="Check configurations", response_model=CheckAnswer)
async def check(body: CheckRequest, request: Request) -> Response:
    """Whether configurations are within limits and free, and how far from anything they are."""
    return await answers.respond(request, tasks.check.job, body.robot, body)


@planning.post(
    "/robots/{name}/potential", summary="The artificial potential", response_model=PotentialAnswer
)
async def potential(name: str, body: PotentialRequest, request: Request) -> Response:
    """U(q), its slope, and the forces on the control points that make it.

    Control points are the origins O_i of the robot's Denavit-Hartenberg frames, the last one that
    of the tip. Each is pulled to where it is at the goal, with a force that no longer grows beyond
    `attractive_cap`, and pushed away by every obstacle nearer than `influence_distance`, along the
    line to its orthogonal projection. Inside an obstacle it is pushed along the shortest way out;
    an obstacle of several pieces (a mesh, a cloud) pushes once, from the nearest of them.
    """
    return await answers.respond(request, tasks.potential.job, name, body)


@kinematics.post(
    "/robots/{name}/reach",
    summary="Reach of task poses",
    response_model=ReachAnswer,
    responses=_REACH,  # type: ignore[arg-type]
)
async def reach(name: str, body: ReachRequest, request: Request) -> Response:
    """For each pose whether it is reached free of collision, by how many branches and how well.

    Poses are listed, or stand on a grid in a box. With candidates for the base they are answered
    best first: those that reach most poses, then those with the largest least clearance.
    """
    return await answers.respond(request, tasks.reach.job, name, body, _MEDIA_TYPES[body.format])


@timing.post(
    "/retime", summary="Time a path, or the motion between two states", response_model=RetimeAnswer
)
async def retime(body: RetimeRequest, request: Request) -> Response:
    """A path, or two states, as a timed motion within a robot's limits or those given.

    The limits are certified. Of collisions nothing is known, which the certificate says.
    """
    return await answers.respond(request, of_robot(tasks.retime.job), body.robot, body)


@timing.post(
    "/paths/simplify",
    summary="Tell a path by the fewest waypoints within a tolerance",
    response_model=SimplifyAnswer,
)
async def simplify(body: SimplifyRequest, request: Request) -> Response:
    """Waypoints of a path whose straight lines follow it within a tolerance in every joint.

    With a robot the lines are proved against its limits of position and the scene; where they are
    not free, nearer ones are tried.
    """
    return await answers.respond(request, tasks.simplify.job, body.robot, body)


@timing.post("/paths/fit", summary="Polynomials for a recorded motion", response_model=FitAnswer)
async def fit(body: FitRequest, request: Request) -> Response:
    """Few cubics with continuous accelerations within a tolerance of recorded samples, in time.

    With a robot they are proved against its limits and for collisions with itself.
    """
    return await answers.respond(request, of_robot(tasks.fit.job), body.robot, body)


@timing.post(
    "/convert", summary="Tell a motion in another shape", response_model=JointTrajectoryAnswer
)
async def convert(body: ConvertRequest, request: Request) -> Response:
    """A motion as trajectory_msgs/JointTrajectory of ROS in JSON, or as a table in CSV."""
    content = await request.body()
    result = await compute(request, tasks.convert.job(content))
    media_type = "text/csv" if body.format == "csv" else "application/json"
    return Response(result, media_type=media_type)


@timing.post(
    "/export", summary="Write a motion for a robot controller", response_model=ExportAnswer
)
async def export(body: ExportRequest, request: Request) -> Response:
    """A motion, or a whole kept task or tour, as a ROS 2 message, a table or a program.

    Proved is the motion that the controller makes of the points in the file, by the interpolation
    that its manual names, with what is held in each part. The file says what is proved and what is
    not.
    """
    if body.plan is None:
        return await answers.respond(request, tasks.export.job, body.robot or "", body)
    sent = parse_json(await request.body())
    if isinstance(body.plan, str):
        sent["plan"] = await _kept_motion(request, body.plan)
        validate_as(ExportRequest, sent)
    content, asked = to_json(sent), sent["plan"]["request"]
    scene = asked.get("scene")
    result = await answers.answer(
        request,
        lambda robot, stored: tasks.export.job(robot, stored, content),
        str(asked.get("robot", "")),
        scene if isinstance(scene, str) else None,
        timeout=body.timeout,
        asked=asked,
    )
    return json_answer(result)


async def _kept_motion(request: Request, plan_id: str) -> dict[str, Any]:
    """The request and answer of a kept plan, its robot and scene pinned as they were."""
    record, kept = await kept_plan(request, plan_id)
    request.scope[REPLAY] = Replay(record.id, pinned_references(request, record))
    told = {"request": parse_json(kept.request), "answer": parse_json(kept.answer)}
    return {"operation": f"{record.method} {record.path}", **told}


@tracking.post("/simulate", summary="Follow a motion", response_model=SimulateAnswer)
async def simulate(body: SimulateRequest, request: Request) -> Response:
    """Simulation of a controller that makes the robot follow a motion, for example a planned one.

    With a scene the answer says what the tracking error leaves of the clearance.
    """
    return await answers.respond(request, tasks.simulate.job, body.robot, body)


@planning.post("/tours", summary="Visit many goals in the best order", response_model=TourAnswer)
async def tour(body: TourRequest, request: Request) -> Response:
    """Order, configurations and proved motions of a tour over 2 to 500 goals.

    The search goes by the times of straight motions; only legs that a tour takes are planned and
    proved, and where one takes longer the order is searched again. The shortest tour proved before
    the deadline is answered, with a bound that no tour beats.
    """
    return await answers.respond(request, tasks.tour.job, body.robot, body)


@tracking.post("/lyapunov", summary="Examine V = x'Px", response_model=LyapunovAnswer)
async def lyapunov(body: LyapunovRequest, request: Request) -> Response:  # noqa: ARG001
    """The quadratic form V = xᵀ P x of dx/dt = A x, or V(x) of dx/dt = f(x), as Lyapunov function.

    With Q in place of P the Lyapunov equation Aᵀ P + P A = −Q is solved. The answer has minors,
    eigenvalues and definiteness of P and Q, V and dV/dt as formulas and at states, and a verdict.

    Formulas `f` and `V`, or a `system` by name, are examined near x = 0: `reason` names the theorem
    (Lyapunov, LaSalle, instability) or says what is not shown, `lasalle` has the sets.
    """
    return json_answer(await compute(request, tasks.lyapunov.job(await request.body())))


#: Frames that are computed in a millisecond; a request for more of them waits for its turn.
_BRIEF_FRAMES = 200
#: Configurations whose Jacobians are decomposed in a millisecond.
_BRIEF_TWISTS = 10


@kinematics.post("/robots/{name}/fk", summary="Poses of the links", response_model=FkAnswer)
async def fk(name: str, body: FkRequest, request: Request) -> Response:
    """The pose of one link, the tip if none is named, and of all links."""
    if body.fingers is not None:
        return await answers.respond(request, of_robot(tasks.finger_poses.job), name, body)
    return await _frames(request, name, tasks.fk_task, body)


@kinematics.post("/robots/{name}/jacobian", summary="Jacobians", response_model=JacobianAnswer)
async def jacobian(name: str, body: JacobianRequest, request: Request) -> Response:
    """The Jacobian of a link or of a point on it, linear rows first, in the frame asked for."""
    return await _frames(request, name, tasks.jacobian_task, body)


@kinematics.post(
    "/robots/{name}/velocity", summary="Velocity kinematics", response_model=VelocityAnswer
)
async def velocity(name: str, body: VelocityRequest, request: Request) -> Response:
    """The twist that joint velocities cause, or the joint velocities that cause a twist.

    The least-norm solution, or that of least residual, plus the null-space term; damped near
    singularities; the answer lists what was damped.
    """
    is_brief = answers.count(body.joints) <= _BRIEF_TWISTS
    return await answers.respond(
        request, of_robot(tasks.velocity_task.job), name, body, at_once=is_brief
    )


@kinematics.post(
    "/robots/{name}/ik", summary="Configurations that reach a pose", response_model=IkAnswer
)
async def ik(name: str, body: IkRequest, request: Request) -> Response:
    """Configurations that bring a link to a pose, best first.

    With a scene each is judged; those in collision are answered only where all are asked for.
    """
    return await answers.respond(request, tasks.ik.job, name, body)


async def _frames(
    request: Request, robot: str, task: ChainTask, body: FkRequest | JacobianRequest
) -> Response:
    """The answer of a task whose time goes by the frames that it computes."""
    count = answers.count(body.joints)
    links = 1 if count == 1 else (await answers.model(request, robot)).links
    is_brief = count * links <= _BRIEF_FRAMES
    return await answers.respond(request, of_robot(task.job), robot, body, at_once=is_brief)


@planning.post("/tasks", summary="Plan a task of several stages", response_model=TaskAnswer)
async def plan_task(body: TaskRequest, request: Request) -> Response:
    """The motions of all stages, each proved with what is held in it; they join at rest.

    Grasps, configurations and places are chosen together; what was tried is told with the reasons.
    Where no combination can be done, or time is up, the answer is a problem that says where.
    """
    return await answers.respond(request, tasks.plan_sequence.job, body.robot, body)
