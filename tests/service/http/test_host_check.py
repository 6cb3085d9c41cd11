"""Host allow-list: which names a request may be sent to."""

import httpx
import pytest

from service.http.layer.request_checks import allowed_host, is_foreign

NONE: frozenset[str] = frozenset()


@pytest.mark.parametrize(
    "header",
    ["127.0.0.1", "127.0.0.1:8000", "localhost", "LOCALHOST:80", "armwright", "[::1]", "[::1]:8000",
     "10.1.2.3:8000", "192.168.0.7"],
)  # fmt: skip
def test_addresses_and_names_without_a_dot_are_allowed(header: str) -> None:
    assert allowed_host(header, NONE)


@pytest.mark.parametrize(
    "header",
    ["evil.example", "evil.example:8000", "EVIL.example.", "127.0.0.1.evil.example", "1.2.3.4.5",
     "localhost.evil.example", "a b", "", "x/y", "evil.example@localhost", "[::1", "x:y", "x:",
     "[evil.example]", "x,localhost"],
)  # fmt: skip
def test_other_names_are_not(header: str) -> None:
    assert not allowed_host(header, NONE)
    assert not allowed_host(header, frozenset({"arm.example", ".arms.example"}))


def test_names_on_the_list_are_allowed() -> None:
    names = frozenset({"arm.example", ".arms.example"})
    for header in ("arm.example", "ARM.example:443", "arm.example.", "a.arms.example"):
        assert allowed_host(header, names)
    for header in ("sub.arm.example", "armsx.example", "arms.example", "xarms.example"):
        assert not allowed_host(header, names)
    assert allowed_host("anything.example", frozenset({"*"}))
    assert not allowed_host("no host", frozenset({"*"}))


@pytest.mark.parametrize(
    ("origin", "site", "foreign"),
    [
        (None, None, False),  # no browser
        (None, "none", False),  # typed by a person
        (None, "same-origin", False),
        (None, "cross-site", True),
        ("http://arm.example:8000", "same-origin", False),
        ("https://arm.example:8000", None, False),  # a proxy with TLS in front
        ("https://arm.example", "same-origin", False),  # and one that changes Host
        ("http://evil.example", "cross-site", True),
        ("http://evil.example", None, True),
        ("http://arm.example:9000", "same-site", True),
        ("http://arm.example:8000.evil.example", None, True),
        ("null", None, True),
        ("null", "cross-site", True),
        ("https://own.example", "cross-site", False),  # on the list
        ("https://own.example.evil.example", "cross-site", True),
    ],
)
def test_changes_by_pages_of_other_origins_are_foreign(
    origin: str | None, site: str | None, foreign: bool
) -> None:
    assert is_foreign(origin, site, "arm.example:8000", ("https://own.example",)) == foreign
    assert not is_foreign(origin, site, "arm.example:8000", ("*",))


@pytest.mark.parametrize("method", ["POST", "PUT", "PATCH", "DELETE"])
def test_a_page_elsewhere_changes_nothing(client: httpx.Client, method: str) -> None:
    foreign: list[dict[str, str]] = [
        {"Origin": "http://evil.example"},
        {"Origin": "null"},
        {"Sec-Fetch-Site": "cross-site"},
    ]
    form = {"file": ("arm.zip", b"PK", "application/zip")}
    for headers in foreign:
        answer = client.request(method, "/v1/robots", headers=headers, files=form)
        assert answer.status_code == 403
        assert answer.json()["code"] == "FORBIDDEN"
        assert "ARMWRIGHT_CORS_ORIGINS" in answer.json()["hint"]
        assert client.get("/v1/robots", headers=headers).status_code == 200  # says nothing to it
    own = {"Origin": f"http://{client.base_url.netloc.decode()}", "Sec-Fetch-Site": "same-origin"}
    for headers in ({}, own):
        answer = client.request(method, "/v1/scenes", headers=headers, json={"name": "x y"})
        assert answer.status_code in (405, 422)
