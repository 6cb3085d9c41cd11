"""Errors of code that makes and reads models; the client raises them too."""


class ArmwrightError(Exception):
    """Base of all errors of this library."""


class InvalidArgument(ArmwrightError, ValueError):
    """An argument was refused before anything was sent.

    Args:
        message: Fault and its place.
        hint: Advice on how to mend it.
    """

    def __init__(self, message: str, *, hint: str | None = None) -> None:
        super().__init__(message if hint is None else f"{message}. {hint}")
        self.hint = hint
