"""Pages for people: what they load, and what browsers are told about them and about answers."""

import re

import httpx

from service.http.layer.middleware import SECURITY_HEADERS


def test_the_start_page_leads_everywhere(client: httpx.Client) -> None:
    page = client.get("/")
    assert page.status_code == 200
    links = re.findall(r'href="([^"]+)"', page.text)
    assert len(links) >= 6
    for link in links:
        assert client.get(f"/{link}").status_code == 200, link
    assert "script" not in page.text


def test_the_documentation_loads_nothing_from_elsewhere(client: httpx.Client) -> None:
    page = client.get("/docs")
    policy = page.headers["content-security-policy"]
    assert "script-src 'self';" in policy
    assert "default-src 'none'" in policy
    assert "<script>" not in page.text, "the policy runs no script inside the page"
    loaded = re.findall(r'(?:src|href)="([^"]+)"', page.text)
    assert len(loaded) == 4
    for address in loaded:
        assert "//" not in address
        part = client.get(f"/{address}")
        assert part.status_code == 200, address
        assert part.headers["content-type"].split(";")[0] in (
            "text/javascript", "text/css", "image/png"
        )  # fmt: skip
    assert client.get("/docs/../../etc/passwd").status_code == 404
    assert client.get("/docs/%2e%2e%2fcore.py").status_code in (404, 422)


def test_every_answer_has_the_headers(client: httpx.Client) -> None:
    for path in ("/healthz", "/v1/robots", "/v1/robots/none", "/nowhere", "/docs/start.js"):
        headers = client.get(path).headers
        for name, value in SECURITY_HEADERS.items():
            assert headers[name] == value, (path, name)


def test_options_names_the_methods(client: httpx.Client) -> None:
    answer = client.options("/v1/scenes/x")
    assert (answer.status_code, answer.headers["allow"]) == (204, "GET, PUT, DELETE")
    assert client.options("/nowhere").status_code == 404
