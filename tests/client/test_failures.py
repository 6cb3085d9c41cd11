"""Failures that the client reports: problems, broken answers, silence, streams."""

import asyncio
import contextlib
import gzip
import socket
from collections.abc import Iterator

import httpx
import pytest

import armwright_client as ours
from armwright_client import AsyncClient, Client
from tests.client.scripted import URL, Scripted, asked_async, once, problem


def test_a_problem_is_raised_as_its_class() -> None:
    answer = problem(
        422,
        "START_STATE_IN_COLLISION",
        detail="hand penetrates shelf",
        details={"pair": ["hand", "shelf"], "depth": 0.01},
        from_the_future=1,
    )
    with pytest.raises(ours.StartStateInCollision, match="hand penetrates shelf") as caught:
        once([answer], lambda client: client.plan("r", [0.0], [1.0]))
    assert caught.value.pair == ("hand", "shelf")
    assert caught.value.problem.type == "/v1/problems/START_STATE_IN_COLLISION"


def test_a_problem_of_somebody_else_is_an_api_error() -> None:
    media = {"content-type": "application/problem+json; charset=utf-8"}
    answer = httpx.Response(403, json={"title": "Forbidden by policy"}, headers=media)
    with pytest.raises(ours.ApiError, match="Forbidden by policy") as caught:
        once([answer], lambda client: client.healthz())
    assert type(caught.value) is ours.ApiError


@pytest.mark.parametrize(
    ("answer", "words"),
    [
        (httpx.Response(502, html="<html>Bad gateway</html>"), "502 Bad Gateway by something"),
        (httpx.Response(503, text="no upstream", headers={"Retry-After": "99"}), "no upstream"),
        (httpx.Response(404, json={"message": "no route"}), "no route"),
        (httpx.Response(500, json=["?"]), "not an Armwright service"),
        (httpx.Response(502), "not an Armwright service"),
        (
            httpx.Response(502, content=b"{", headers={"content-type": "application/problem+json"}),
            "not an Armwright service",
        ),
        (httpx.Response(302, headers={"Location": "https://login"}), "302 Found to https://login"),
        (httpx.Response(200, html="<html>Welcome</html>"), "something else than Health"),
        (httpx.Response(200, json={"state": "ok"}), r"something else than Health \(status:"),
        (httpx.Response(200), "something else than Health"),
    ],
)
def test_what_is_not_the_services_is_told(answer: httpx.Response, words: str) -> None:
    with pytest.raises(ours.UnexpectedAnswer, match=words) as caught:
        once([answer], lambda client: client.healthz())
    assert caught.value.status == answer.status_code
    assert "GET /healthz" in str(caught.value)
    assert len(str(caught.value)) < 500


def test_long_pages_are_cut() -> None:
    with pytest.raises(ours.UnexpectedAnswer) as caught:
        once([httpx.Response(502, text="x" * 10**6)], lambda client: client.healthz())
    assert len(caught.value.excerpt) == 200


def below(kind: type[httpx.RequestError]) -> Iterator[type[httpx.RequestError]]:
    for child in kind.__subclasses__():
        yield child
        yield from below(child)


KINDS_OF_HTTPX = list(below(httpx.RequestError))


@pytest.mark.parametrize("kind", KINDS_OF_HTTPX)
def test_no_exception_of_httpx_leaks(kind: type[httpx.RequestError]) -> None:
    for text in ("it broke", ""):
        with pytest.raises(ours.TransportError, match=kind.__name__) as caught:
            once([kind(text)], lambda client: client.healthz())
        timed_out = isinstance(caught.value, ours.TransportTimeout)
        assert timed_out == issubclass(kind, httpx.TimeoutException)
        with pytest.raises(ours.TransportError):
            asyncio.run(asked_async(Scripted([kind(text)]), lambda client: client.healthz()))


def test_an_answer_that_can_not_be_unpacked_is_told() -> None:
    body = gzip.compress(b"{}")[:-8] + b"????????"

    class Broken(httpx.SyncByteStream):
        def __iter__(self) -> Iterator[bytes]:
            yield b"not gzip" + body

    answer = httpx.Response(200, stream=Broken(), headers={"content-encoding": "gzip"})
    with pytest.raises(ours.TransportError, match="DecodingError"):
        once([answer], lambda client: client.healthz())


def test_nobody_listens() -> None:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    with (
        Client(f"http://127.0.0.1:{port}") as client,
        pytest.raises(ours.TransportError, match="GET /healthz: ConnectError"),
    ):
        client.healthz()


@contextlib.contextmanager
def mute() -> Iterator[str]:
    """A server that takes connections and says nothing."""
    with socket.create_server(("127.0.0.1", 0)) as listener:
        yield f"http://127.0.0.1:{listener.getsockname()[1]}"


def test_nobody_answers() -> None:
    async def ask(url: str) -> None:
        async with AsyncClient(url, timeout=0.2) as client:
            await client.healthz()

    with mute() as url:
        with (
            Client(url, timeout=0.2) as client,
            pytest.raises(ours.TransportTimeout, match="GET /healthz: ReadTimeout"),
        ):
            client.healthz()
        with pytest.raises(ours.TransportTimeout):
            asyncio.run(ask(url))


def test_a_closed_client_says_so() -> None:
    client = Client(URL)
    client.close()
    with pytest.raises(ours.TransportError, match="the client is closed"):
        client.healthz()

    async def ask() -> None:
        client = AsyncClient(URL)
        await client.close()
        await client.healthz()

    with pytest.raises(ours.TransportError, match="the client is closed"):
        asyncio.run(ask())
