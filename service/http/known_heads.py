"""Heads of requests that were parsed before: clients send the same one again and again.

To have llhttp call back for each header, and to make of them what a request is answered by, takes
as long as all that the layers do. What it found in a head is remembered by the bytes of that head.
"""

from typing import Any, NamedTuple

#: Heads that are remembered; each is some hundred bytes, and requests differ by their lengths.
_KEPT = 512
#: Longer heads are not remembered [byte].
_LONGEST = 1024
#: Headers that are secrets: they are not kept in memory for longer than their requests.
_SECRETS = frozenset({b"authorization", b"x-api-key", b"cookie", b"proxy-authorization"})


class KnownHead(NamedTuple):
    """A head as a parser has read it.

    Attributes:
        target: what is asked for, as it was sent.
        path: of the scope of the request.
        raw_path: of the scope of the request.
        query: of the scope of the request.
        headers: names in lower case, and values.
        length: of the body [byte].
        keep_alive: whether another request may follow.
    """

    target: bytes
    path: str
    raw_path: bytes
    query: bytes
    headers: tuple[tuple[bytes, bytes], ...]
    length: int
    keep_alive: bool


class KnownHeads:
    """Heads of POSTs by HTTP/1.1 with a body of a length, and nothing to be negotiated."""

    def __init__(self) -> None:
        self._heads: dict[bytes, KnownHead] = {}

    def find(self, head: bytes) -> KnownHead | None:
        """The head of some bytes, without the empty line that ends it, if it is known."""
        return self._heads.get(head)

    def note(
        self, head: bytes, target: bytes, scope: Any, length: int, *, keep_alive: bool
    ) -> None:
        """Remember what was found in a head.

        Args:
            head: Its bytes, without the empty line that ends it.
            target: What is asked for.
            scope: Of the request.
            length: Of its body [byte].
            keep_alive: Whether another request may follow.
        """
        headers = tuple(scope["headers"])
        if len(head) > _LONGEST or any(name in _SECRETS for name, _ in headers):
            return
        if len(self._heads) >= _KEPT:
            self._heads.clear()
        self._heads[head] = KnownHead(
            target, scope["path"], scope["raw_path"], scope["query_string"], headers,
            length, keep_alive,
        )  # fmt: skip


#: Of all connections of this process: a head means the same on each of them.
KNOWN_HEADS = KnownHeads()
