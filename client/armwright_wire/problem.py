"""The problem document (RFC 9457) that every error is answered with."""

from typing import Any

from pydantic import BaseModel, ConfigDict, Field


class Problem(BaseModel):
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

    type: str = Field(description="where the kind of problem is explained")
    title: str = Field(description="the kind of problem in words, the same for every occurrence")
    status: int = Field(description="the HTTP status")
    detail: str = Field(description="what is wrong this time, and where")
    instance: str = Field(description="the path that was asked")
    code: str = Field(description="the kind of problem for a program")
    stage: str | None = Field(None, description="the step that failed, where there are several")
    hint: str | None = Field(None, description="what to do about it, with the valid choices")
    details: dict[str, Any] = Field(default_factory=dict, description="values of this occurrence")
