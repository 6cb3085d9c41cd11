"""Fields of a request's head, without an object that holds all of them."""

import re

from starlette.types import Scope

#: The quality of what is not accepted.
_REFUSED = re.compile(rb"q=0(\.0{0,3})?")


def field(scope: Scope, name: bytes) -> str | None:
    """The first value of a header; None where there is none.

    Args:
        scope: Of the request.
        name: In lower case.
    """
    for known, value in scope["headers"]:
        if known == name:
            text: str = value.decode("latin-1")
            return text
    return None


def values(scope: Scope, name: bytes) -> list[str]:
    """All values of a header, in their order.

    Args:
        scope: Of the request.
        name: In lower case.
    """
    return [value.decode("latin-1") for known, value in scope["headers"] if known == name]


def accepts_gzip(scope: Scope) -> bool:
    """Whether the client of a request accepts answers that are compressed."""
    return any(
        name == b"accept-encoding" and _takes_gzip(value) for name, value in scope["headers"]
    )


def _takes_gzip(accepted: bytes) -> bool:
    """Whether a field Accept-Encoding names gzip, and not with the quality 0."""
    if b"gzip" not in accepted:
        return False
    for choice in accepted.split(b","):
        name, *parameters = choice.replace(b" ", b"").lower().split(b";")
        if name == b"gzip":
            return not any(_REFUSED.fullmatch(parameter) for parameter in parameters)
    return False
