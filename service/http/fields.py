"""Fields of a request's head, without an object that holds all of them."""

from starlette.types import Scope


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
