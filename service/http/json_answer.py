"""Answers that are JSON already."""

from starlette.responses import Response


class JsonAnswer(Response):
    """An answer of some bytes of JSON, made without a look at what other answers may be.

    Args:
        content: JSON.
    """

    media_type = "application/json"

    def __init__(self, content: bytes) -> None:
        self.status_code = 200
        self.background = None
        self.body = content
        self.raw_headers = [
            (b"content-length", b"%d" % len(content)),
            (b"content-type", b"application/json"),
        ]
