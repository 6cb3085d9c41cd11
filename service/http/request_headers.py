"""Headers of a request: first values, Accept-Encoding, If-Match and If-None-Match (RFC 9110)."""

import re
from functools import lru_cache

from fastapi import Request
from starlette.types import Scope

from service.validation import ProblemError, storage_problem

#: The quality of what is not accepted.
_REFUSED = re.compile(rb"q=0(\.0{0,3})?")


#: Key in the scope of a request, with its headers as `first_values` reads them.
FIELDS = "armwright.fields"


def first_values(scope: Scope) -> dict[str, str]:
    """The first value of each header of a request, by name in lower case."""
    return {name.decode("latin-1"): v.decode("latin-1") for name, v in reversed(scope["headers"])}


def values(scope: Scope, name: bytes) -> list[str]:
    """All values of a header, in their order.

    Args:
        scope: Scope of the request.
        name: Name in lower case.
    """
    return [value.decode("latin-1") for known, value in scope["headers"] if known == name]


def accepts_gzip(scope: Scope) -> bool:
    """Whether the client of a request accepts answers that are compressed."""
    for name, value in scope["headers"]:
        if name == b"accept-encoding" and _takes_gzip(value):
            return True
    return False


@lru_cache(64)
def _takes_gzip(accepted: bytes) -> bool:
    """Whether a field Accept-Encoding names gzip, and not with the quality 0."""
    if b"gzip" not in accepted:
        return False
    for choice in accepted.split(b","):
        name, *parameters = choice.replace(b" ", b"").lower().split(b";")
        if name == b"gzip":
            return not any(_REFUSED.fullmatch(parameter) for parameter in parameters)
    return False


def check_precondition(request: Request, current: str | None) -> None:
    """See whether what exists is what a request that changes it expects.

    Args:
        request: Request with the headers If-Match and If-None-Match, or without.
        current: The hash of what exists; None if there is nothing.

    Raises:
        ProblemError: PRECONDITION_FAILED.
    """
    expected, unexpected = (_tags(request, name) for name in ("if-match", "if-none-match"))
    if expected is not None and not _matches(expected, current):
        there = "there is nothing" if current is None else f'there is "{current}"'
        raise _failed(f"If-Match names another version: {there}")
    if unexpected is not None and _matches(unexpected, current):
        raise _failed(f'If-None-Match names what there is: "{current}"')


def names_tag(request: Request, tag: str) -> bool:
    """Whether If-None-Match of a request that reads names the tag of what there is."""
    tags = _tags(request, "if-none-match") or frozenset()
    # Comparison is weak here: a proxy that compresses marks tags as weak.
    return "*" in tags or tag in {item.removeprefix("W/") for item in tags}


def _tags(request: Request, header: str) -> frozenset[str] | None:
    values = request.headers.getlist(header)
    if not values:
        return None
    return frozenset(tag.strip() for tag in ",".join(values).split(","))


def _matches(tags: frozenset[str], current: str | None) -> bool:
    # Comparison is strong: a tag marked as weak, W/"...", equals none.
    return current is not None and ("*" in tags or f'"{current}"' in tags)


def _failed(detail: str) -> ProblemError:
    return storage_problem(
        "PRECONDITION_FAILED",
        detail,
        hint="Get what there is, look at it, and send the request with its ETag.",
    )
