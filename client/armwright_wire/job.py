"""Jobs on the wire."""

from typing import Any, Literal

from pydantic import ConfigDict, Field

from armwright_wire.base import Answer
from armwright_wire.problem import Problem

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

    id: str = Field(examples=[_ID], description="name of the job in `/v1/jobs/{id}`")
    operation: str = Field(examples=["POST /v1/plan"], description="the request that it answers")
    status: Literal["queued", "running", "succeeded", "failed", "cancelled"] = Field(
        description="where it stands"
    )
    progress: float = Field(ge=0.0, le=1.0, description="share that is done, 0 … 1")
    stage: str | None = Field(None, examples=["rrt_connect"], description="what is being done")
    created: str = Field(description="when it was accepted")
    started: str | None = Field(None, description="when a worker began with it")
    ended: str | None = Field(None, description="when it succeeded, failed or was cancelled")
    expires: str | None = Field(None, description="when it is forgotten at the latest")
    location: str | None = Field(None, description="what it created", examples=["/v1/robots/arm"])


class JobAnswer(JobSummary):
    """Status of a job, with its result or error once it has ended."""

    result: Any = Field(None, description="once succeeded: what the request is answered")
    error: Problem | None = Field(None, description="once failed: the problem document")


class JobList(Answer):
    """Jobs, newest first."""

    jobs: list[JobSummary] = Field(description="without their answers")
    next: str | None = Field(description="give it as `after` for the next page")
