"""Errors of a scene's file, raised again with the place in it."""

from collections.abc import Callable

from kinematics.errors import ArmwrightError, InvalidScene


class ErrorPlace:
    """Context in which errors are raised again as ``InvalidScene``, with the place in the file.

    Args:
        begin: How messages begin that tell their place already.
        where: The place, asked for when there is an error; ``begin`` where None.
    """

    __slots__ = ("_begin", "_where")

    def __init__(self, begin: str, where: Callable[[], str] | None = None) -> None:
        self._begin = begin
        self._where = where

    def __enter__(self) -> None:
        """Begin."""

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        """End."""
        if not isinstance(error, ArmwrightError):
            return
        message = error.message
        if not message.startswith(self._begin):
            message = f"{self._begin if self._where is None else self._where()}: {message}"
        raise InvalidScene(message, hint=error.hint) from None
