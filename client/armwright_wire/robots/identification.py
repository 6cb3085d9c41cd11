"""Logs of motions on the wire, and the parameters that are found from them."""

from typing import Annotated, ClassVar, Literal

from pydantic import ConfigDict, Field, model_validator

from armwright_wire.base import (
    MAX_JOINTS,
    Answer,
    Beside,
    BodyWithRules,
    InFrame,
    JointVector,
    Label,
    Number,
    Positive,
    Timeout,
    examples,
    only_where,
)
from armwright_wire.robots.payload import Payload
from armwright_wire.robots.robot import RobotInertias
from armwright_wire.scenes.tool import WithTool

#: Instants of one log: twenty seconds at 1 kHz.
MAX_INSTANTS = 20_000
#: Instants of all logs of one request: their regressors take some hundred megabytes.
MAX_TOTAL = 40_000
#: Logs of one request.
MAX_LOGS = 20

DriveName = Literal["motor_inertia", "viscous_friction", "coulomb_friction", "offset"]
Drives = Annotated[list[DriveName], Field(max_length=4)]
Rows = Annotated[list[JointVector], Field(min_length=1, max_length=MAX_INSTANTS)]


class LogBody(BodyWithRules):
    """A log of one motion, or of poses at rest where it has neither times nor a period."""

    one_of: ClassVar[tuple[str, ...]] = ("torques", "currents")
    needs: ClassVar[Beside] = {"currents": ("gains",), "gains": ("currents",)}
    at_most_one = (("times", "period"),)

    positions: Rows
    """q, a row for each instant [rad or m]"""
    torques: Rows | None = None
    """τ, a row for each instant [N m or N]"""
    currents: Rows | None = None
    """in place of torques, a row for each instant [A]"""
    gains: Annotated[list[Number], Field(min_length=1, max_length=MAX_JOINTS)] | None = None
    """of currents: torque of the joint for one ampere [N m/A or N/A]"""
    times: Annotated[list[Number], Field(min_length=1, max_length=MAX_INSTANTS)] | None = None
    """ascending instants, one for each row [s]"""
    period: Positive | None = None
    """from one row to the next, for times [s]"""
    velocities: Rows | None = None
    """q̇; derivatives of the positions if left out [rad/s or m/s]"""
    accelerations: Rows | None = None
    """q̈; derivatives if left out [rad/s² or m/s²]"""


class IdentifyRequest(WithTool):
    """Logs of a robot whose bodies and drives, or whose load, are to be found."""

    model_config = ConfigDict(json_schema_extra={"examples": examples("IdentifyRequest")})

    published_rules = (only_where("link", find="payload"),)

    logs: Annotated[list[LogBody], Field(min_length=1, max_length=MAX_LOGS)]
    """motions that differ, or poses at rest"""
    find: Literal["robot", "payload"] = "robot"
    """payload: ten parameters of a load, the robot's own being known"""
    link: Label | None = None
    """that carries the payload; the tip if left out"""
    drives: Drives | None = None
    """parameters of the drives to be found too; all four of a robot, none with a payload if left
    out
    """
    cutoff: Positive | None = None
    """of a low-pass filter without delay [Hz]; if left out 10 Hz where derivatives are missing,
    else none
    """
    timeout: Timeout | None = None

    @model_validator(mode="after")
    def _check_drives(self) -> "IdentifyRequest":
        total = sum(len(log.positions) for log in self.logs)
        if total > MAX_TOTAL:
            raise ValueError(
                f"logs have {total} instants, at most {MAX_TOTAL} are taken: thin them"
            )
        drives = self.drives or []
        if len(set(drives)) < len(drives):
            raise ValueError("drives: each must be unique")
        if self.find == "payload" and set(drives) - {"offset"}:
            raise ValueError("drives: with a payload only offset can be found")
        if self.find == "robot" and self.link is not None:
            raise ValueError('link belongs to "find": "payload"')
        return self


class FoundParameterAnswer(Answer):
    """A combination of parameters that the logs determine."""

    name: str = Field(examples=["Izz1 + 0.25 m2"])
    """the combination, as a formula"""
    unit: str = Field(examples=["kg m²"])
    """of its value"""
    value: float
    """by weighted least squares"""
    standard_error: float
    """standard deviation of the value"""
    consistent: float
    """of the bodies with positive density that fit best"""
    believed: float
    """of the robot as it is stored; 0 for a payload"""
    excited: bool
    """the standard error is below the usual size of such a one"""


class JointResidual(Answer):
    """What is left of the torques of a joint, root mean squares."""

    joint: str
    """name of the joint"""
    torque: float
    """of the torques [N m or N]"""
    residual: float
    """that least squares leave [N m or N]"""
    consistent_residual: float
    """that the bodies found leave [N m or N]"""
    offset: float
    """constant torque of the sensor [N m or N]; 0 if not sought"""


class IdentifyAnswer(InFrame):
    """Parameters found, how sure they are, and what robots or requests take of them."""

    parameters: list[FoundParameterAnswer]
    """combinations determined"""
    not_excited: list[str]
    """combinations that motions can determine and these logs do not, and why"""
    joints: list[JointResidual]
    """residuals, by joint"""
    condition: float
    """of the weighted equations, their columns scaled"""
    samples: int
    """instants that count, after the filter"""
    inertias: RobotInertias | None = None
    """of a robot: as PATCH /v1/robots/{name} takes them"""
    payload: Payload | None = None
    """as other requests take it"""
