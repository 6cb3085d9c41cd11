"""Conditional requests: the headers If-Match and If-None-Match (RFC 9110, section 13)."""

from fastapi import Request

from service.problem import ProblemError


def check_precondition(request: Request, current: str | None) -> None:
    """See whether what exists is what a request that changes it expects.

    Args:
        request: With the headers If-Match and If-None-Match, or without.
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
    return ProblemError(
        "PRECONDITION_FAILED",
        detail,
        stage="storage",
        hint="Get what there is, look at it, and send the request with its ETag.",
    )
