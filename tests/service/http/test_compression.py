"""Compressed answers: only on request, of the same content, and much shorter."""

import gzip
import json

import httpx
import pytest

from armwright_client import Client
from tests.service.planning import BODY
from tests.service.robots import ASIDE

PLAN = BODY | {"goal": {"joints": ASIDE}}


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


def test_short_answers_stay_as_they_are(client: httpx.Client) -> None:
    answer = client.get("/healthz", headers={"Accept-Encoding": "gzip"})
    assert "content-encoding" not in answer.headers


@pytest.mark.parametrize(("compress", "header"), [(True, "gzip"), (False, "identity")])
def test_the_client_asks_for_it_only_if_told(compress: bool, header: str) -> None:
    seen = []

    def handle(request: httpx.Request) -> httpx.Response:
        seen.append(request.headers["Accept-Encoding"])
        return httpx.Response(200, json={"status": "ok"})

    with Client("http://test", compress=compress, transport=httpx.MockTransport(handle)) as service:
        service.healthz()
    assert seen == [header]
