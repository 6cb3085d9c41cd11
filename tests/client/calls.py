"""Calls by both clients on scripted transports."""

from collections.abc import Callable
from typing import Any

import httpx

from armwright_client import AsyncClient, Client
from tests.client.scripted import Answer, Scripted

Ask = Callable[..., Any]


URL = "http://robots.example"


def once(answers: list[Answer], ask: Callable[[Client], Any], **options: Any) -> Any:
    """Ask a scripted service by `Client`; and the same by `AsyncClient`, for the same answer."""
    with Client(URL, transport=Scripted(list(answers)), **options) as client:
        return ask(client)


async def asked_async(transport: Scripted, ask: Callable[[AsyncClient], Any]) -> httpx.Request:
    async with AsyncClient(URL, transport=transport) as client:
        await ask(client)
    return transport.requests[-1]
