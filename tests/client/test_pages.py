"""Iteration over pages: all items once, and no page before it is needed."""

import asyncio
from dataclasses import dataclass

import httpx

from armwright_client import Client
from armwright_client.client import items, items_async


@dataclass
class Numbers:
    """A page of numbers."""

    numbers: list[int]
    next: str | None


PAGES = {None: Numbers([1, 2], "b"), "b": Numbers([], "c"), "c": Numbers([3], None)}


def test_all_items_come_once_and_pages_when_needed() -> None:
    asked: list[str | None] = []

    def read(after: str | None) -> Numbers:
        asked.append(after)
        return PAGES[after]

    numbers = items(read, lambda page: page.numbers)
    assert (next(numbers), next(numbers), asked) == (1, 2, [None])
    assert list(numbers) == [3]
    assert asked == [None, "b", "c"]


def test_awaited_pages_are_the_same() -> None:
    async def read(after: str | None) -> Numbers:
        return PAGES[after]

    async def collect() -> list[int]:
        return [one async for one in items_async(read, lambda page: page.numbers)]

    assert asyncio.run(collect()) == [1, 2, 3]


def test_the_client_asks_for_page_after_page() -> None:
    def answer(request: httpx.Request) -> httpx.Response:
        after = request.url.params.get("after")
        names = ["a", "b"] if after is None else ["c"]
        robots = [{"name": name, "built_in": True, "joints": 6} for name in names]
        return httpx.Response(200, json={"robots": robots, "next": None if after else "b"})

    with Client(transport=httpx.MockTransport(answer)) as client:
        assert [robot.name for robot in client.robots.iterate()] == ["a", "b", "c"]
