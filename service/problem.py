"""Problems: what is wrong with a request or with the service, as values that any layer can raise.

`service.http.errors` turns them into problem documents (RFC 9457).
"""

import logging
import secrets
from collections.abc import Mapping
from typing import Any

_log = logging.getLogger(__name__)


class ProblemError(Exception):
    """A problem that ends a request.

    Args:
        code: The kind of problem, one of those that ``GET /v1/problems`` lists.
        detail: Fault of this one request, and its place.
        hint: Advice on how to mend it.
        stage: The step that failed.
        status: Another HTTP status than that of the kind.
        retry_after: Seconds after which a new attempt makes sense.
        headers: Headers of its answer beside the usual ones, by name.
        details: Values a program can use.
    """

    def __init__(
        self,
        code: str,
        detail: str,
        *,
        hint: str | None = None,
        stage: str | None = None,
        status: int | None = None,
        retry_after: int | None = None,
        headers: Mapping[str, str] | None = None,
        **details: Any,
    ) -> None:
        super().__init__(detail)
        self.code = code
        self.detail = detail
        self.hint = hint
        self.stage = stage
        self.status = status
        self.retry_after = retry_after
        self.headers = dict(headers or {})
        self.details = details


def request_problem(code: str, detail: str, **more: Any) -> ProblemError:
    """A fault of a request, found before anything was computed of it."""
    return ProblemError(code, detail, stage="request", **more)


def storage_problem(code: str, detail: str, **more: Any) -> ProblemError:
    """A fault about what is stored, or about the storage."""
    return ProblemError(code, detail, stage="storage", **more)


def from_fields(
    code: str, message: str, hint: str | None, details: Mapping[str, Any]
) -> ProblemError:
    """The problem of an error that came as values, for example from a worker.

    Args:
        code: The kind of problem.
        message: Fault and its place.
        hint: Advice on how to mend it.
        details: Values a program can use; those named ``stage`` and ``retry_after`` become the
            stage and the `retry_after` of the problem.
    """
    rest = {str(name): value for name, value in details.items()}
    stage, retry_after = rest.pop("stage", None), rest.pop("retry_after", None)
    problem = ProblemError(code, message, hint=hint, stage=None if stage is None else str(stage))
    problem.retry_after = None if retry_after is None else int(retry_after)
    problem.details = rest
    return problem


def unexpected_fault(what: str, trace: str | None = None, **details: Any) -> ProblemError:
    """Log a fault of the service under a new reference, and give the problem that names only that.

    Args:
        what: The request or task in which it happened.
        trace: The traceback, where it is not that of the exception being handled.
        details: More values for the problem.
    """
    reference = secrets.token_hex(8)
    if trace is None:
        _log.exception("unexpected error %s in %r", reference, what)
    else:
        _log.error("unexpected error %s in %r\n%s", reference, what, trace)
    return ProblemError(
        "CRASH",
        f"an unexpected error happened; it was logged as {reference}",
        hint="This is a fault of the service. Report the reference to whoever runs it.",
        reference=reference,
        **details,
    )
