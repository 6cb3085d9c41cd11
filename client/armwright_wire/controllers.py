"""Controllers on the wire."""

from typing import Annotated, Literal

from pydantic import AliasChoices, ConfigDict, Field

from armwright_wire.base import MAX_JOINTS, Body, JointVector, Label, Number, Positive
from armwright_wire.motor import Motor

#: Base parameters: thirteen a joint at most.
MAX_PARAMETERS = 13 * MAX_JOINTS

Gain = Positive | JointVector
GainMatrix = Positive | JointVector | list[JointVector]
Frequency = Annotated[
    Gain | None, Field(description="of the closed loop's poles [rad/s], in place of the gains")
]
Damping = Annotated[
    Gain,
    Field(
        description="ratio of the poles: 1 is critical; with natural_frequency only, and not for "
        "passivity and adaptive, whose gains it does not enter"
    ),
]


class ControllerBody(Body):
    """Fields of every controller; a gain may be one number for all joints."""

    model_config = ConfigDict(populate_by_name=True)

    natural_frequency: Frequency = None
    damping: Damping = 1.0


class IndependentJoint(ControllerBody):
    """Each joint a motor of its own: u = J q̈ʳ + B q̇ʳ + Kp q̃ + Kd dq̃/dt."""

    type: Literal["independent_joint"] = "independent_joint"
    Kp: Gain | None = Field(None, validation_alias=AliasChoices("Kp", "kp"))
    Kd: Gain | None = Field(None, validation_alias=AliasChoices("Kd", "kd"))
    inertia: Gain | None = Field(
        None,
        description="J fed forward; the motors' own if left out, or where the robot gives none "
        "what each joint feels of the arm at the start of the trajectory",
    )
    motors: list[Motor] | None = Field(
        None, description="one a joint; as `motors` of the request, which every controller takes"
    )


class ComputedTorque(ControllerBody):
    """Feedback linearisation: u = M (q̈ʳ + Kd dq̃/dt + Kp q̃) + C q̇ + B q̇ + G."""

    type: Literal["computed_torque"] = "computed_torque"
    Kp: Gain | None = Field(None, validation_alias=AliasChoices("Kp", "kp"))
    Kd: Gain | None = Field(None, validation_alias=AliasChoices("Kd", "kd"))


class PdGravity(ControllerBody):
    """u = Kp q̃ + Kd dq̃/dt + G, for a reference that stands still."""

    type: Literal["pd_gravity"] = "pd_gravity"
    Kp: GainMatrix | None = Field(None, validation_alias=AliasChoices("Kp", "kp"))
    Kd: GainMatrix | None = Field(None, validation_alias=AliasChoices("Kd", "kd"))


class Passivity(ControllerBody):
    """u = M a + C v + B q̇ + G + K r with r = dq̃/dt + Λ q̃."""

    type: Literal["passivity"] = "passivity"
    Lambda: Gain | None = Field(
        None, description="Λ [1/s]", validation_alias=AliasChoices("Lambda", "lambda")
    )
    K: GainMatrix | None = Field(None, validation_alias=AliasChoices("K", "k"))


class Adaptive(ControllerBody):
    """Slotine and Li: u = Y Θ̂ + K r with dΘ̂/dt = Γ Yᵀ r on the base parameters."""

    type: Literal["adaptive"] = "adaptive"
    Lambda: Gain | None = Field(
        None, description="Λ [1/s]", validation_alias=AliasChoices("Lambda", "lambda")
    )
    K: GainMatrix | None = Field(None, validation_alias=AliasChoices("K", "k"))
    Gamma: GainMatrix = Field(
        1.0,
        description="Γ, one number, one a base parameter, or a matrix",
        validation_alias=AliasChoices("Gamma", "gamma"),
    )
    estimate: Literal["model", "zero"] | list[Number] = Field(
        "model", description="Θ̂ at the start: the model's, nothing, or one number a base parameter"
    )
    motors: bool | None = Field(
        None, description="learn motor inertias and frictions too; by default where there are any"
    )
    known_zeros: bool = Field(
        False,
        description="parameters that are exactly 0 in the model are known to be 0, so that fewer "
        "base parameters are learned",
    )
    parameters: Annotated[list[Label], Field(min_length=1, max_length=MAX_PARAMETERS)] | None = (
        Field(
            None,
            description="the base parameters that are learned, by their names in "
            "`parameter_names` or by what leads these (mx2); all if left out. The model's values "
            "are taken for the others",
        )
    )


Controller = Annotated[
    IndependentJoint | ComputedTorque | PdGravity | Passivity | Adaptive,
    Field(discriminator="type"),
]
