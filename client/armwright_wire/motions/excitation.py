"""Exciting motions on the wire: those from whose logs an arm is identified well."""

from typing import Annotated

from pydantic import ConfigDict, Field

from armwright_wire.base import Answer, JointVector, Ratio, Seed, examples
from armwright_wire.motions.certificate import CertificateAnswer
from armwright_wire.motions.trajectory import TrajectoryAnswer
from armwright_wire.robots.identification import Drives
from armwright_wire.scenes.check import SceneRequest, WithFingers


class ExcitationRequest(SceneRequest, WithFingers):
    """A motion from whose logs an arm is identified well, free of collision."""

    model_config = ConfigDict(json_schema_extra={"examples": examples("ExcitationRequest")})

    start: JointVector | None = None
    """where it begins and ends, at rest; the middle of the limits if left out"""
    period: Annotated[float, Field(ge=0.1, le=600.0)] = 10.0
    """its duration [s]"""
    harmonics: Annotated[int, Field(ge=3, le=20)] = 5
    """sines and cosines of each joint, of 1, 2, ... turns in a period"""
    drives: Drives | None = None
    """parameters of the drives to be found too; all four if left out"""
    velocity_scaling: Ratio = 1.0
    """share of the velocity limits"""
    acceleration_scaling: Ratio = 1.0
    """share of the acceleration limits"""
    evaluations: Annotated[int, Field(ge=1, le=100_000)] = 600
    """motions that are tried, about a millisecond each"""
    sample_period: Annotated[float, Field(ge=1e-4, le=60.0)] | None = None
    """samples are answered at this period [s], else none"""
    seed: Seed = 0


class ExcitationAnswer(Answer):
    """A motion that is proved, and how well its logs determine the parameters."""

    trajectory: TrajectoryAnswer
    certificate: CertificateAnswer
    condition: float
    """condition number of the base regressor along it, columns scaled to length 1"""
    base_parameters: list[str]
    """combinations that its logs determine"""
    notes: list[str] = Field(default_factory=list)
    """what was done to the request"""
