"""The problem document (RFC 9457) that the service answers errors with."""

from typing import Any

from pydantic import Field

from armwright_client.base import Answer


class Problem(Answer):
    """A problem document: `code` and `details` for programs, `detail` and `hint` for people.

    Args:
        type: Where the kind of problem is explained.
        title: The kind of problem in words, the same for every occurrence.
        status: The HTTP status.
        detail: What is wrong this time, and where.
        instance: The path that was asked.
        code: The kind of problem for a program; empty where the document is somebody else's.
        stage: The step that failed, where there are several.
        hint: What to do about it, with the valid choices.
        details: Values of this occurrence: pair, depth, joint, value, limit, ...
    """

    type: str = "about:blank"
    title: str = ""
    status: int | None = None
    detail: str = ""
    instance: str = ""
    code: str = ""
    stage: str | None = None
    hint: str | None = None
    details: dict[str, Any] = Field(default_factory=dict)
