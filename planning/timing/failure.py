"""Exception for paths that can not be timed although the request is sound."""

from typing import ClassVar

from kinematics.errors import ArmwrightError


class TimingFailed(ArmwrightError):
    """No timing of the path was found: the solver gave up, or its answer was not finite."""

    code: ClassVar[str] = "INVALID_MOTION_PLAN"
