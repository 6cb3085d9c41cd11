"""Jobs, and the problem document that every error is answered with, on the wire."""

from typing import Any, Literal

from pydantic import ConfigDict, Field, GetJsonSchemaHandler
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema

from armwright_wire.base import Answer, Instant, Wire, publish_as_required


class Problem(Wire):
    """Problem document: `code` and `details` for programs, `detail` and `hint` for people."""

    model_config = ConfigDict(
        extra="forbid",
        json_schema_extra={
            "examples": [
                {
                    "type": "/v1/problems/START_STATE_IN_COLLISION",
                    "title": "The start configuration is in collision",
                    "status": 422,
                    "detail": "link panda_hand penetrates obstacle shelf by 0.012 m at the start",
                    "instance": "/v1/plan",
                    "code": "START_STATE_IN_COLLISION",
                    "stage": "start",
                    "hint": "Move the arm away from shelf, or allow the pair if they may touch.",
                    "details": {"pair": ["panda_hand", "shelf"], "depth": 0.012},
                }
            ]
        },
    )

    # The service gives all of these; documents of what stands before it may lack any.
    type: str = "about:blank"
    """where the kind of problem is explained"""
    title: str = ""
    """the kind of problem in words, the same for every occurrence"""
    status: int = 0
    """the HTTP status"""
    detail: str = ""
    """what is wrong this time, and where"""
    instance: str = ""
    """the path that was asked"""
    code: str = ""
    """the kind of problem for a program"""
    stage: str | None = None
    """the step that failed, where there are several"""
    hint: str | None = None
    """what to do about it, with the valid choices"""
    details: dict[str, Any] = Field(default_factory=dict)
    """values of this occurrence"""

    @classmethod
    def __get_pydantic_json_schema__(
        cls, core_schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> JsonSchemaValue:
        """The JSON schema of problems of the service."""
        schema = super().__get_pydantic_json_schema__(core_schema, handler)
        for name in ("type", "title", "status", "detail", "instance", "code"):
            publish_as_required(handler.resolve_ref_schema(schema), name)
        return schema


_ID = "0199f3b1c2d40123456789abcdef0123"


class JobSummary(Answer):
    """Status of a job."""

    model_config = ConfigDict(
        json_schema_extra={
            "examples": [
                {
                    "id": _ID,
                    "operation": "POST /v1/plan",
                    "status": "running",
                    "progress": 0.2,
                    "stage": "rrt_connect",
                    "created": "2026-11-21T09:00:00+00:00",
                    "started": "2026-11-21T09:00:01+00:00",
                    "ended": None,
                    "expires": None,
                    "location": None,
                }
            ]
        }
    )

    id: str = Field(examples=[_ID])
    """name of the job in `/v1/jobs/{id}`"""
    operation: str = Field(examples=["POST /v1/plan"])
    """the request that it answers"""
    status: Literal["queued", "running", "succeeded", "failed", "cancelled"]
    """where it stands"""
    progress: float = Field(ge=0.0, le=1.0)
    """share that is done, 0 … 1"""
    stage: str | None = Field(None, examples=["rrt_connect"])
    """what is being done"""
    created: Instant
    """when it was accepted"""
    started: Instant | None = None
    """when a worker began with it"""
    ended: Instant | None = None
    """when it succeeded, failed or was cancelled"""
    expires: Instant | None = None
    """when it is forgotten at the latest"""
    location: str | None = Field(None, examples=["/v1/robots/arm"])
    """what it created"""


class JobAnswer(JobSummary):
    """Status of a job, with its result or error once it has ended."""

    result: Any = None
    """once succeeded: what the request is answered"""
    error: Problem | None = None
    """once failed: the problem document"""


class JobList(Answer):
    """Jobs, newest first."""

    jobs: list[JobSummary]
    """without their answers"""
    next: str | None
    """give it as `after` for the next page"""
