"""Example requests with their real answers, in the OpenAPI document.

`scripts/openapi_examples.py` writes the answers.
"""

import json
from importlib.resources import files
from typing import Any, NamedTuple

#: Kinds of content that an example's answer may have, the likely one first.
_JSON = "application/json"
#: A request that sends the bundle of the example before it.
BUNDLE = "the bundle"


class Example(NamedTuple):
    """A request with its answer.

    Attributes:
        operation: Identifier of the operation.
        title: What the example shows.
        path: Where the request is sent, with its query.
        request: Body, None for none.
        status: HTTP status of the answer.
        answer: Body of the answer: JSON, or a text.
    """

    operation: str
    title: str
    path: str
    request: Any
    status: int
    answer: Any


def examples() -> list[Example]:
    """All examples, in an order in which they can be sent to an empty service."""
    text = files("service.http").joinpath("openapi_examples.json").read_text("utf-8")
    return [Example(**fields) for fields in json.loads(text)]


def add_examples(paths: dict[str, Any]) -> None:
    """Add the examples to their operations.

    Args:
        paths: Operations by path and method, as the document has them; they are changed.
    """
    operations = {
        operation["operationId"]: operation
        for methods in paths.values()
        for operation in methods.values()
    }
    bundle = None
    for example in examples():
        if example.operation == "get_bundle":
            bundle = example.answer
        request = bundle if example.request == BUNDLE else example.request
        operation = operations.get(example.operation)
        if operation is None:
            continue
        if request is not None:
            body = operation["requestBody"]["content"][_JSON]
            _add(body, example.title, request)
        content = operation["responses"].get(str(example.status), {}).get("content", {})
        for answer in content.values():
            _add(answer, example.title, example.answer)


def _add(media: dict[str, Any], title: str, value: Any) -> None:
    """Add an example under the next free name of a kind of content."""
    listed = media.setdefault("examples", {})
    number = 1 + sum(name.startswith("example_") for name in listed)
    listed[f"example_{number}"] = {"summary": title, "value": value}
    media.pop("example", None)
