"""Endpoints of the API that commands ask, here or at a service."""

from typing import NamedTuple


class Endpoint(NamedTuple):
    """One endpoint: where a service has it, and what answers it in this process.

    Args:
        path: Path of the URL, with ``{robot}`` for the name of a robot.
        model: Schema of the request, ``"module:class"`` below ``armwright_wire``.
        task: The task that answers it, ``"module:function"`` below ``service.endpoints``.
        long: Duration: long ones are worked on as jobs by a service while a terminal shows their
            stages.
        keepable: Whether a service keeps what becomes of it as a job, unless told not to.
    """

    path: str
    model: str
    task: str
    long: bool = False
    keepable: bool = False


FK = Endpoint("/v1/robots/{robot}/fk", "robots.kinematics:FkRequest", "kinematics.task:fk_task")
JACOBIAN = Endpoint(
    "/v1/robots/{robot}/jacobian",
    "robots.kinematics:JacobianRequest",
    "kinematics.task:jacobian_task",
)
CONVERT_POSE = Endpoint(
    "/v1/poses/convert", "pose:ConvertPoseRequest", "kinematics.task:convert_pose"
)
IK = Endpoint("/v1/robots/{robot}/ik", "robots.kinematics:IkRequest", "ik.task:ik")
CHECK = Endpoint("/v1/check", "scenes.check:CheckRequest", "check.task:check")
PLAN = Endpoint("/v1/plan", "plans.plan:PlanRequest", "plan.task:plan", long=True, keepable=True)
VALIDATE = Endpoint("/v1/validate", "plans.plan:ValidateRequest", "plan.task:validate")
RETIME = Endpoint("/v1/retime", "motions.retime:RetimeRequest", "retime.task:retime")
FIT = Endpoint("/v1/paths/fit", "motions.retime:FitRequest", "retime.task:fit")
SIMULATE = Endpoint("/v1/simulate", "motions.simulation:SimulateRequest", "simulate.task:simulate")
REACH = Endpoint(
    "/v1/robots/{robot}/reach", "robots.reach:ReachRequest", "reach.task:reach", long=True
)
IDENTIFY = Endpoint(
    "/v1/robots/{robot}/identify",
    "robots.identification:IdentifyRequest",
    "identification.task:identify",
)
EXCITE = Endpoint(
    "/v1/robots/{robot}/excitation",
    "motions.excitation:ExcitationRequest",
    "identification.task:excitation",
)
CALIBRATE = Endpoint(
    "/v1/robots/{robot}/calibrate",
    "robots.calibration:CalibrateRequest",
    "identification.task:calibrate",
)
TASK = Endpoint(
    "/v1/tasks", "plans.task:TaskRequest", "tasks.task:plan_sequence", long=True, keepable=True
)
TOUR = Endpoint("/v1/tours", "plans.tour:TourRequest", "tours.task:tour", long=True, keepable=True)
CONVERT = Endpoint("/v1/convert", "motions.retime:ConvertRequest", "retime.task:convert")
EXPORT = Endpoint("/v1/export", "motions.export:ExportRequest", "export.task:export")


def answering(path: str) -> Endpoint:
    """The endpoint that answers requests which a service keeps.

    Args:
        path: Path of the URL.
    """
    known = {one.path: one for one in (CHECK, PLAN, VALIDATE, TASK, TOUR)}
    return known.get(path, IK)
