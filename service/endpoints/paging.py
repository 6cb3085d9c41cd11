"""Lists that are answered page by page."""

from collections.abc import Callable, Sequence
from typing import TypeVar

_T = TypeVar("_T")


def page(
    items: Sequence[_T], limit: int, key: Callable[[_T], str]
) -> tuple[Sequence[_T], str | None]:
    """The items of a page, and the key after which the next page begins.

    Args:
        items: Items in order, one more than the page holds where there is a next page.
        limit: Items of a page.
        key: Key of an item.

    Returns:
        The first items, and the key of the last one, None where nothing follows.
    """
    following = key(items[limit - 1]) if len(items) > limit else None
    return items[:limit], following
