"""The error tree of the whole application: one base, one class a kind of caller's fault."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from types import MappingProxyType
from typing import Any, ClassVar


class ArmwrightError(Exception):
    """A fault of the caller, reported so that the caller can mend it.

    Args:
        message: Description of the fault and its place.
        hint: Remedy, with the valid choices where there are any.
        details: Values a program can use (joint, value, limit, pair, depth, ...).
    """

    code: ClassVar[str] = "INVALID_REQUEST"

    def __init__(self, message: str, *, hint: str | None = None, **details: Any) -> None:
        super().__init__(message)
        self.message = message
        self.hint = hint
        self.details: Mapping[str, Any] = MappingProxyType(details)

    def __str__(self) -> str:
        """The message, and the hint behind it."""
        message, hint = self.message, self.hint
        if not hint:
            return message
        return f"{message}{'' if message.endswith(('.', '!', '?')) else '.'} {hint}"

    def __reduce__(self) -> tuple[object, ...]:
        # A process pool sends errors back pickled, which a mapping proxy can't be.
        return _restore, (type(self), self.message, self.hint, dict(self.details))


@contextmanager
def located(
    where: str,
    *kinds: type[ArmwrightError],
    kind: type[ArmwrightError] | None = None,
    unless: str | None = None,
    details: Mapping[str, Any] = MappingProxyType({}),
) -> Iterator[None]:
    """Put a place before the messages of errors that are raised within.

    Args:
        where: Place in the request, or name of the object.
        kinds: Kinds of errors that are meant; every kind if left out.
        kind: Kind that they become; the own kind if left out.
        unless: Text of messages that say the place already.
        details: Details that are added.
    """
    try:
        yield
    except ArmwrightError as error:
        if (kinds and not isinstance(error, kinds)) or (unless and unless in error.message):
            raise
        made = kind or type(error)
        message, known = f"{where}: {error.message}", {**error.details, **details}
        raise made(message, hint=error.hint, **known) from None


def _restore(
    kind: type[ArmwrightError], message: str, hint: str | None, details: dict[str, Any]
) -> ArmwrightError:
    return kind(message, hint=hint, **details)


class InvalidRobotDescription(ArmwrightError):
    """The URDF, SRDF or DH table does not describe a serial chain that can be built."""

    code = "INVALID_ROBOT_DESCRIPTION"


class InvalidScene(ArmwrightError):
    """A shape, an obstacle or a planning-scene text is malformed."""

    code = "INVALID_SCENE"


class InvalidPose(ArmwrightError):
    """A rotation or pose is malformed (not finite, not normalised, not orthonormal)."""

    code = "INVALID_GOAL_CONSTRAINTS"


class InvalidRobotState(ArmwrightError):
    """A joint vector has the wrong length, is not finite or lies outside the limits."""

    code = "INVALID_ROBOT_STATE"


class InvalidLinkName(ArmwrightError):
    """A link that the robot does not have was named."""

    code = "INVALID_LINK_NAME"


class InvalidObjectName(ArmwrightError):
    """An obstacle or object that the scene does not have was named."""

    code = "INVALID_OBJECT_NAME"


class MissingLimit(ArmwrightError):
    """A limit that the computation needs is not given by the robot or the request."""

    code = "MISSING_LIMIT"


class MissingInertia(ArmwrightError):
    """A mass or inertia that the dynamics need is not given by the robot."""

    code = "MISSING_INERTIA"


class InvalidTrajectory(ArmwrightError):
    """A trajectory's pieces are malformed (shapes, order of times, not finite)."""

    code = "INVALID_MOTION_PLAN"


class InvalidGoal(ArmwrightError):
    """A goal is malformed or asks for what the robot can't be asked."""

    code = "INVALID_GOAL_CONSTRAINTS"


class InvalidOption(ArmwrightError):
    """An option has an unknown name or a value out of its range."""

    code = "VALIDATION_ERROR"


class InvalidNumbers(InvalidOption, ValueError):
    """Input that is no array of numbers; numpy would raise ValueError."""


class NotAvailable(ArmwrightError):
    """The robot does not have what was asked for, such as a closed form."""

    code = "VALIDATION_ERROR"
