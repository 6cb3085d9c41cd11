"""The errors that all others are kinds of, and those that no problem of the service is behind."""

from collections.abc import Mapping
from typing import Any, ClassVar

from armwright_client.problem import Problem

__all__ = [
    "ApiError",
    "ArmwrightError",
    "InvalidArgument",
    "TransportError",
    "TransportTimeout",
    "UnexpectedAnswer",
]


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


class TransportError(ArmwrightError):
    """No answer came: the service can't be reached, or the connection broke off."""


class TransportTimeout(TransportError):
    """No answer came in time."""


class UnexpectedAnswer(ArmwrightError):
    """The answer is none of the service's, say a page of a proxy in between.

    Args:
        message: What was asked and what came.
        status: The HTTP status.
        excerpt: The beginning of the body.
    """

    def __init__(self, message: str, status: int, excerpt: str = "") -> None:
        super().__init__(message, status, excerpt)
        self.message = message
        self.status = status
        self.excerpt = excerpt

    def __str__(self) -> str:
        return f"{self.message}: {self.excerpt}" if self.excerpt else self.message


class ApiError(ArmwrightError):
    """A problem that the service reports.

    Args:
        problem: The document.
        status: The HTTP status.
        retry_after: Seconds after which asking again makes sense, where the service says so.
    """

    #: The code of the problems that are raised as this class; empty for a class of several.
    code: ClassVar[str] = ""

    def __init__(self, problem: Problem, status: int, retry_after: float | None = None) -> None:
        super().__init__(problem, status, retry_after)
        self.problem = problem
        self.status = status
        self.retry_after = retry_after

    def __str__(self) -> str:
        problem = self.problem
        detail = problem.detail or problem.title or f"HTTP status {self.status}"
        text = f"{problem.code}: {detail}" if problem.code else detail
        return f"{text}. {problem.hint}" if problem.hint else text

    @property
    def details(self) -> Mapping[str, Any]:
        """Values of this occurrence."""
        return self.problem.details
