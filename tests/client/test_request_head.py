"""Heads of requests are those that the standard library writes, whatever was asked before."""

import http.client
import ssl
from typing import Any

import pytest

from armwright_client.request_head import RequestHeads

#: To make one reads all certificates of the system; no head depends on it.
TLS = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
HEADERS = {"Accept": "application/json", "Content-Type": "application/json"}
ASKED: list[tuple[str, str, dict[str, str], bytes | None]] = [
    ("POST", "/v1/plan", HEADERS, b"{}"),
    ("POST", "/v1/plan", HEADERS, b"Content-Length: 2"),
    ("POST", "/v1/plan", HEADERS, 12_345 * b"x"),
    ("POST", "/v1/plan", HEADERS | {"Prefer": "respond-async"}, b"{}"),
    ("POST", "/v1/plan", {}, b"{}"),
    ("PUT", "/v1/plan", HEADERS, b"{}"),
    ("POST", "/v1/scenes/Content-Length:%20", HEADERS, b"{}"),
    ("POST", "/v1/plan", HEADERS, b""),
    ("POST", "/v1/plan", HEADERS, None),
    ("GET", "/v1/plan", HEADERS, None),
    ("DELETE", "/v1/plan", HEADERS, None),
]


def expected(kind: type[http.client.HTTPConnection], port: int | None, *asked: Any) -> bytes:
    class Written(kind):  # type: ignore[misc,valid-type]
        content = b""

        def send(self, data: bytes) -> None:
            self.content += data

    options = {"context": TLS} if kind is http.client.HTTPSConnection else {}
    connection = Written("arm.example", port, **options)
    method, target, headers, content = asked
    connection.request(method, target, content, headers)
    written: bytes = connection.content
    return written.removesuffix(content or b"")


@pytest.mark.parametrize("port", [None, 80, 443, 8000])
@pytest.mark.parametrize(
    ("kind", "default_port"),
    [(http.client.HTTPConnection, 80), (http.client.HTTPSConnection, 443)],
)
def test_heads_are_those_of_the_standard_library(
    kind: type[http.client.HTTPConnection], default_port: int, port: int | None
) -> None:
    heads = RequestHeads("arm.example", port, default_port)
    for asked in [*ASKED, *reversed(ASKED)]:
        assert heads.head(asked[0], asked[1], asked[2], asked[3]) == expected(kind, port, *asked)


@pytest.mark.parametrize(
    ("target", "headers"),
    [("/v1/a b", {}), ("/v1/plan", {"X": "a\r\nY: b"}), ("/v1/plan", {"X\r\nY": "b"})],
)
def test_what_would_be_another_request_is_refused(target: str, headers: dict[str, str]) -> None:
    heads = RequestHeads("arm.example", None, 80)
    for _ in range(2):
        with pytest.raises((ValueError, http.client.InvalidURL)):
            heads.head("POST", target, headers, b"{}")


def test_few_heads_are_remembered() -> None:
    heads = RequestHeads("arm.example", None, 80)
    for number in range(1000):
        assert b"/v1/%d " % number in heads.head("POST", f"/v1/{number}", {}, b"{}")
    assert len(heads._kept) <= 256
