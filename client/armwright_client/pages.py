"""Iteration over lists that are answered page by page."""

from collections.abc import AsyncIterator, Awaitable, Callable, Iterator, Sequence
from typing import Protocol, TypeVar


class Page(Protocol):
    """A page of a list."""

    @property
    def next(self) -> str | None:
        """To be given as `after` for the next page, None on the last one."""


P = TypeVar("P", bound=Page)
T = TypeVar("T")


def items(read: Callable[[str | None], P], of: Callable[[P], Sequence[T]]) -> Iterator[T]:
    """All items of a list; each page is asked for when the one before it is used up.

    Args:
        read: The page after a key, the first page after None.
        of: The items of a page.
    """
    after = None
    while True:
        page = read(after)
        yield from of(page)
        after = page.next
        if after is None:
            return


async def items_async(
    read: Callable[[str | None], Awaitable[P]], of: Callable[[P], Sequence[T]]
) -> AsyncIterator[T]:
    """`items` for pages that are awaited."""
    after = None
    while True:
        page = await read(after)
        for item in of(page):
            yield item
        after = page.next
        if after is None:
            return
