"""Endpoints of the API that commands ask, here or at a service."""

from typing import NamedTuple


class Endpoint(NamedTuple):
    """One endpoint: where a service has it, and what answers it in this process.

    Args:
        path: Path of the URL, with ``{robot}`` for the name of a robot.
        model: Schema of the request, ``"module:class"``.
        task: The task that answers it, ``"module:function"``.
        takes_robot: Whether the task takes a robot.
        takes_scene: Whether the task takes a stored scene too.
        long: Duration: long ones are worked on as jobs by a service while a terminal shows their
            stages.
        keepable: Whether a service keeps what becomes of it as a job, unless told not to.
    """

    path: str
    model: str
    task: str
    takes_robot: bool = True
    takes_scene: bool = True
    long: bool = False
    keepable: bool = False


FK = Endpoint(
    "/v1/robots/{robot}/fk",
    "armwright_wire.robots.kinematics:FkRequest",
    "service.endpoints.kinematics.task:fk_task",
    takes_scene=False,
)
JACOBIAN = Endpoint(
    "/v1/robots/{robot}/jacobian",
    "armwright_wire.robots.kinematics:JacobianRequest",
    "service.endpoints.kinematics.task:jacobian_task",
    takes_scene=False,
)
CONVERT_POSE = Endpoint(
    "/v1/poses/convert",
    "armwright_wire.pose:ConvertPoseRequest",
    "service.endpoints.kinematics.task:convert_pose",
    takes_robot=False,
    takes_scene=False,
)
IK = Endpoint(
    "/v1/robots/{robot}/ik",
    "armwright_wire.robots.kinematics:IkRequest",
    "service.endpoints.ik.task:ik",
)
CHECK = Endpoint(
    "/v1/check", "armwright_wire.scenes.check:CheckRequest", "service.endpoints.check.task:check"
)
PLAN = Endpoint(
    "/v1/plan",
    "armwright_wire.plans.plan:PlanRequest",
    "service.endpoints.plan.task:plan",
    long=True,
    keepable=True,
)
VALIDATE = Endpoint(
    "/v1/validate",
    "armwright_wire.plans.plan:ValidateRequest",
    "service.endpoints.plan.task:validate",
)
RETIME = Endpoint(
    "/v1/retime",
    "armwright_wire.motions.retime:RetimeRequest",
    "service.endpoints.retime.task:retime",
    takes_scene=False,
)
FIT = Endpoint(
    "/v1/paths/fit",
    "armwright_wire.motions.paths:FitRequest",
    "service.endpoints.retime.task:fit",
    takes_scene=False,
)
SIMULATE = Endpoint(
    "/v1/simulate",
    "armwright_wire.motions.simulation:SimulateRequest",
    "service.endpoints.simulate.task:simulate",
)
REACH = Endpoint(
    "/v1/robots/{robot}/reach",
    "armwright_wire.robots.reach:ReachRequest",
    "service.endpoints.reach.task:reach",
    long=True,
)
IDENTIFY = Endpoint(
    "/v1/robots/{robot}/identify",
    "armwright_wire.robots.identification:IdentifyRequest",
    "service.endpoints.identification.task:identify",
    takes_scene=False,
)
TASK = Endpoint(
    "/v1/tasks",
    "armwright_wire.plans.task:TaskRequest",
    "service.endpoints.tasks.task:plan_sequence",
    long=True,
    keepable=True,
)
TOUR = Endpoint(
    "/v1/tours",
    "armwright_wire.plans.tour:TourRequest",
    "service.endpoints.tours.task:tour",
    long=True,
    keepable=True,
)
CONVERT = Endpoint(
    "/v1/convert",
    "armwright_wire.motions.retime:ConvertRequest",
    "service.endpoints.retime.task:convert",
    takes_robot=False,
    takes_scene=False,
)
EXPORT = Endpoint(
    "/v1/export",
    "armwright_wire.motions.export:ExportRequest",
    "service.endpoints.export.task:export",
)


def answering(path: str) -> Endpoint:
    """The endpoint that answers requests which a service keeps.

    Args:
        path: Path of the URL.
    """
    known = {one.path: one for one in (CHECK, PLAN, VALIDATE, TASK, TOUR)}
    return known.get(path, IK)
