"""Errors of code that makes and reads models; the client raises them too."""


class ArmwrightError(Exception):
    """Anything that goes wrong in this library."""


class InvalidArgument(ArmwrightError, ValueError):
    """An argument was refused before anything was sent.

    Args:
        message: What is wrong and where.
        hint: What to do about it.
    """

    def __init__(self, message: str, *, hint: str | None = None) -> None:
        super().__init__(message if hint is None else f"{message}. {hint}")
        self.hint = hint
