"""Compressed answers: only on request, of the same content, and large ones in a thread."""

import asyncio
import gzip
import json
import threading
import zlib
from pathlib import Path
from typing import Any

import httpx
import pytest
from fastapi import FastAPI, Response
from starlette.middleware import gzip as middleware_module

from service.http.layer.middleware import ServiceMiddleware
from service.http.metrics import Metrics
from service.http.request_headers import accepts_gzip
from service.settings import Settings
from tests.service.planning import BODY

PLAN = BODY


def raw(client: httpx.Client, encoding: str) -> tuple[httpx.Headers, bytes]:
    """Headers of a plan's answer, and its body as it passes the wire."""
    with client.stream(
        "POST", "/v1/plan", json=PLAN, headers={"Accept-Encoding": encoding}
    ) as response:
        return response.headers, b"".join(response.iter_raw())


def test_an_answer_is_compressed_where_gzip_is_accepted(client: httpx.Client) -> None:
    plain_headers, plain = raw(client, "identity")
    headers, packed = raw(client, "gzip")
    assert "content-encoding" not in plain_headers
    assert headers["content-encoding"] == "gzip"
    assert "Accept-Encoding" in headers["vary"]
    unpacked, expected = json.loads(gzip.decompress(packed)), json.loads(plain)
    assert unpacked["trajectory"] == expected["trajectory"]
    assert len(packed) < 0.6 * len(plain)


@pytest.mark.parametrize(("size", "elsewhere"), [(8_000, False), (31_000, False), (40_000, True)])
def test_large_answers_are_compressed_beside_the_event_loop(
    size: int, elsewhere: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    threads = list[int]()

    class Noting:
        """A module like zlib that notes which thread compresses."""

        def __getattr__(self, name: str) -> Any:
            return getattr(zlib, name)

        def compressobj(self, *args: Any, **kwargs: Any) -> Any:
            packer = zlib.compressobj(*args, **kwargs)

            class Packer:
                def compress(self, data: bytes) -> bytes:
                    threads.append(threading.get_ident())
                    return packer.compress(data)

                def flush(self) -> bytes:
                    return packer.flush()

            return Packer()

    monkeypatch.setattr(middleware_module, "zlib", Noting())
    app, loops = FastAPI(), list[int]()

    @app.get("/x")
    async def answer() -> Response:
        loops.append(threading.get_ident())
        return Response(b"0123456789" * (size // 10), media_type="application/json")

    settings = Settings(data_dir=tmp_path)
    layer = ServiceMiddleware(app, app, settings, Metrics(app))

    async def ask() -> httpx.Response:
        transport = httpx.ASGITransport(layer)
        async with httpx.AsyncClient(transport=transport, base_url="http://127.0.0.1") as client:
            return await client.get("/x", headers={"Accept-Encoding": "gzip"})

    answered = asyncio.run(ask())
    assert answered.headers["content-encoding"] == "gzip"
    assert len(answered.content) == size
    assert threads
    assert (threads != loops) is elsewhere


@pytest.mark.parametrize(
    ("accepted", "taken"),
    [
        (b"gzip", True), (b"br, gzip;q=0.5", True), (b"gzip;q=0.001", True), (b"", False),
        (b"gzip;q=0", False), (b"identity, gzip ; q=0.000", False), (b"xgzip", False),
    ],
)  # fmt: skip
def test_a_quality_of_zero_refuses_it(accepted: bytes, taken: bool) -> None:
    assert accepts_gzip({"headers": [(b"accept-encoding", accepted)]}) is taken


def test_short_answers_stay_as_they_are(client: httpx.Client) -> None:
    answer = client.get("/healthz", headers={"Accept-Encoding": "gzip"})
    assert "content-encoding" not in answer.headers
