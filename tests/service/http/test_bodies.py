"""Request bodies: JSON, sizes, content types and junk."""

import gzip
import json
import random
from typing import Any

import httpx
import pytest

from tests.service.http.exchange import BOX, LIMIT
from tests.service.robots import problem


@pytest.fixture
def client(faulty_client: httpx.Client) -> httpx.Client:
    return faulty_client


JSON = {"Content-Type": "application/json"}


def post(client: httpx.Client, content: bytes | str, path: str = "/v1/scenes") -> httpx.Response:
    return client.post(path, content=content, headers=JSON)


@pytest.mark.parametrize("number", ["NaN", "Infinity", "-Infinity", "1e999"])
def test_numbers_that_json_does_not_have(client: httpx.Client, number: str) -> None:
    text = json.dumps({"name": "n", "obstacles": [BOX]}).replace("[0, 0, 1]", f"[0, 0, {number}]")
    document = problem(post(client, text), 422, "VALIDATION_ERROR")
    assert document["details"]["errors"][0]["path"] == "obstacles[0].pose.position[2]"


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"{",
        b"nonsense",
        b'{"name": "a",}',
        b'"\xff\xfe"',
        b'{"name": "\xed\xa0\x80"}',
        b'{"name": "\\ud800", "obstacles": []}',
        b'{"name": "a\\u0000", "obstacles": []}',
        b"[" * 100_000,
        b'{"a":' * 50_000,
        b"1" * 5_000,
        b'{"name": ' + b"9" * 400 + b"}",
        b"null",
        b"[]",
        b'"text"',
        b"\x00",
        '{"name": "a"}'.encode("utf-16"),
        b"\xef\xbb\xbf{}",
        b'{"' + b"k" * 100_000 + b'": 1}',
    ],
)
def test_bodies_that_are_no_request(client: httpx.Client, content: bytes) -> None:
    document = problem(post(client, content), 422, "VALIDATION_ERROR")
    assert len(document["detail"]) < 3_000


def test_a_name_twice_in_an_object_is_refused(client: httpx.Client) -> None:
    text = '{"name": "x", "name": "doubled", "obstacles": []}'
    document = problem(post(client, text), 422, "VALIDATION_ERROR")
    assert document["details"]["errors"] == [{"path": "name", "problem": "given twice"}]
    large = text.encode() + b" " * 100_000
    assert problem(post(client, large), 422, "VALIDATION_ERROR")["detail"] == document["detail"]


@pytest.mark.parametrize("path", ["/v1/scenes", "/v1/robots"])
def test_encoded_bodies_are_refused_as_such(client: httpx.Client, path: str) -> None:
    headers = {"Content-Type": "application/json", "Content-Encoding": "gzip"}
    response = client.post(path, content=gzip.compress(b"{}"), headers=headers)
    document = problem(response, 415, "UNSUPPORTED_MEDIA_TYPE")
    assert "gzip" in document["detail"]
    plain = headers | {"Content-Encoding": "identity"}
    problem(client.post(path, content=b"{}", headers=plain), 422, "VALIDATION_ERROR")


def test_a_body_that_is_announced_too_large(client: httpx.Client) -> None:
    document = problem(post(client, b" " * (LIMIT + 1)), 413, "PAYLOAD_TOO_LARGE")
    assert document["details"]["max_body_size"] == LIMIT
    problem(post(client, b" " * LIMIT), 422, "VALIDATION_ERROR")


def test_a_body_that_grows_too_large(client: httpx.Client) -> None:
    chunks = (b" " * 10_000 for _ in range(LIMIT // 10_000 + 20))
    response = client.post("/v1/scenes", content=chunks, headers=JSON)
    problem(response, 413, "PAYLOAD_TOO_LARGE")


_ATOMS: tuple[Any, ...] = (
    None, True, False, 0, -1, 1.5, 1e308, -1e308, 1e-308, 10**30, "", "a", "\u0000", "é😀", "panda",
    [], {}, [[]], [0, 0, 0], [0, 0, 0, 1], [1e308] * 3, "x" * 5_000, {"type": "box"}, {"": None},
)  # fmt: skip


def _junk(source: random.Random, schema: Any, components: dict[str, Any], depth: int = 0) -> Any:
    """Something that nearly follows a schema."""
    if source.random() < 0.12 or depth > 6 or not isinstance(schema, dict):
        return source.choice(_ATOMS)
    if "$ref" in schema:
        name = schema["$ref"].rpartition("/")[2]
        return _junk(source, components[name], components, depth + 1)
    for union in ("anyOf", "oneOf"):
        if union in schema:
            return _junk(source, source.choice(schema[union]), components, depth + 1)
    if "const" in schema or "enum" in schema:
        return schema.get("const", source.choice(schema.get("enum", [0])))
    kind = schema.get("type")
    if kind == "object":
        required = schema.get("required", [])
        return {
            name: _junk(source, part, components, depth + 1)
            for name, part in schema.get("properties", {}).items()
            if (name in required and source.random() > 0.05) or source.random() < 0.3
        }
    if kind == "array":
        length = schema.get("minItems", source.randrange(3))
        return [_junk(source, schema.get("items"), components, depth + 1) for _ in range(length)]
    if kind in ("number", "integer"):
        return source.choice(
            (0, 1, 2, 0.5, -0.5, schema.get("minimum", 0), schema.get("maximum", 9))
        )
    return source.choice(("a", "b", "box", "panda", "table"))


def test_junk_never_brings_the_service_down(client: httpx.Client) -> None:
    source = random.Random(20_261_121)
    document = client.get("/openapi.json").json()
    components = document["components"]["schemas"]
    operations = [
        (method, path, operation)
        for path, methods in document["paths"].items()
        for method, operation in methods.items()
        if method in ("post", "put", "delete") and not path.startswith("/mishaps")
    ]
    assert operations
    statuses: dict[int, int] = {}
    for _ in range(600):
        method, path, operation = source.choice(operations)
        for parameter in ("name", "id"):
            path = path.replace(
                f"{{{parameter}}}", source.choice(("a", "panda", "%00", "é", "..a"))
            )
        content_schemas = operation.get("requestBody", {}).get("content", {})
        schema = content_schemas.get("application/json", {}).get("schema")
        content = json.dumps(_junk(source, schema, components)).encode()
        if source.random() < 0.2:
            cut = source.randrange(len(content) + 1)
            content = content[:cut] + source.randbytes(source.randrange(1, 5)) + content[cut:]
        response = client.request(method, path, content=content, headers=JSON)
        statuses[response.status_code] = statuses.get(response.status_code, 0) + 1
        assert response.status_code < 500 or response.status_code == 503, (
            path,
            content,
            response.text,
        )
        if response.status_code >= 400:
            problem(response, response.status_code, response.json()["code"])
    assert statuses[422] > 50
    assert client.get("/readyz").status_code == 200
