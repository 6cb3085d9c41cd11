"""From the code of a problem document to the class of its error."""

from collections.abc import Iterator, Mapping
from types import MappingProxyType

from armwright_client.errors import ApiError
from armwright_wire.job import Problem


def _kinds(base: type[ApiError]) -> Iterator[type[ApiError]]:
    for kind in base.__subclasses__():
        yield kind
        yield from _kinds(kind)


#: The class of every code that the service may answer.
BY_CODE: Mapping[str, type[ApiError]] = MappingProxyType(
    {kind.code: kind for kind in _kinds(ApiError) if kind.code}
)


def from_problem(problem: Problem, status: int, retry_after: float | None = None) -> ApiError:
    """The error of a problem document; `ApiError` itself for a code that is not known here."""
    return BY_CODE.get(problem.code, ApiError)(problem, status, retry_after)
