"""Write the answers of the example requests in the OpenAPI document.

    python scripts/openapi_examples.py

The requests stand in `service/http/openapi_examples.json`. They are sent, in their order, to a
service that is started for them; the answers are written beside them. To add an example, write its
operation, title, path and request, with status 0 and answer null, and run this. In paths `{job}`
and `{plan}` stand for what the last header Location named. A job is waited for, unless the next
request cancels it. Of files the first bytes are shown.
"""

import json
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import httpx

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))

from service.app import create_app  # noqa: E402
from service.http.openapi import BUNDLE, Example, examples  # noqa: E402
from service.settings import Settings  # noqa: E402
from tests.service.processes import wait_until  # noqa: E402
from tests.service.server import serving  # noqa: E402

FILE = ROOT / "service/http/openapi_examples.json"
#: Lists of more rows are cut to so many in the document.
ROWS = 4
#: Lists of numbers that are no joint vectors or matrix rows are cut likewise.
NUMBERS = 16
#: Lines of texts that the document shows.
LINES = 12
#: Bytes of files that the document shows.
BYTES = 120
#: A batch of two motions of two joints [s].
_JOB_TIME = 30.0


def send_all(client: httpx.Client, requests: Sequence[Example]) -> Iterator[Example]:
    """Send the requests, in their order.

    Args:
        client: Of a service that has none of what the examples store.
        requests: The examples; their answers are not looked at.

    Yields:
        Each example with the answer that the service gives.
    """
    methods = _methods(client.get("/openapi.json").json())
    last: dict[str, str] = {}
    bundle: Any = None
    following = [example.operation for example in requests[1:]] + [""]
    for example, follower in zip(requests, following, strict=True):
        path = example.path.format_map(last)
        body = bundle if example.request == BUNDLE else example.request
        response = client.request(methods[example.operation], path, json=body)
        folder, _, name = response.headers.get("location", "").rpartition("/")
        last[folder.rpartition("/")[2].removesuffix("s")] = name
        if response.status_code == httpx.codes.ACCEPTED and follower != "cancel_job":
            assert wait_until(lambda: _ended(client, last["job"]), _JOB_TIME)
        answer = _content(response)
        bundle = answer if example.operation == "get_bundle" else bundle
        yield example._replace(status=response.status_code, answer=answer)


def cut(value: Any) -> Any:
    """An answer with its long lists and texts cut."""
    if isinstance(value, dict):
        return {key: cut(item) for key, item in value.items()}
    if isinstance(value, str) and value.count("\n") > LINES:
        return "\n".join([*value.split("\n")[:LINES], "..."])
    if not isinstance(value, list):
        return value
    flat = all(isinstance(item, int | float) for item in value)
    matrix = not flat and all(isinstance(item, list) for item in value) and len(value) <= 2 * ROWS
    return [cut(item) for item in value[: NUMBERS if flat or matrix else ROWS]]


def _methods(document: dict[str, Any]) -> dict[str, str]:
    return {
        operation["operationId"]: method.upper()
        for operations in document["paths"].values()
        for method, operation in operations.items()
    }


def _ended(client: httpx.Client, job: str) -> bool:
    return bool(client.get(f"/v1/jobs/{job}").json()["ended"])


def _content(response: httpx.Response) -> Any:
    if response.content and "json" in response.headers.get("content-type", ""):
        return response.json()
    if "octet-stream" in response.headers.get("content-type", ""):
        return response.content[:BYTES].decode("latin-1").encode("unicode_escape").decode() + "..."
    return response.text or None


def main() -> None:
    """Send the requests and write the answers."""
    with tempfile.TemporaryDirectory() as folder:
        app = create_app(Settings(data_dir=Path(folder), workers=1))
        with serving(app) as client:
            answered = [
                example._replace(answer=cut(example.answer))._asdict()
                for example in send_all(client, examples())
            ]
    lines = [json.dumps(example, ensure_ascii=False) for example in answered]
    FILE.write_text("[\n" + ",\n".join(lines) + "\n]\n", "utf-8")
    print(f"{len(answered)} answers, {FILE.stat().st_size} bytes")


if __name__ == "__main__":
    main()
