"""Jobs as they are answered."""

from base64 import b64encode
from datetime import UTC, datetime

from pydantic_core import to_json

from armwright_wire.job import JobSummary
from service.storage.job_store import JobAnswer, JobRecord


def job_summary(record: JobRecord, lifetime: float | None = None) -> JobSummary:
    """Status of a job; ended ones are kept for a lifetime [s]."""
    expires = None
    if record.ended is not None and lifetime is not None:
        expires = record.ended + lifetime
    return JobSummary(
        id=record.id,
        operation=f"{record.method} {record.path}",
        status=record.status,
        progress=record.progress,
        stage=record.stage,
        created=_moment(record.created) or "",
        started=_moment(record.started),
        ended=_moment(record.ended),
        expires=_moment(expires),
        location=record.location,
    )


def job_document(record: JobRecord, answer: JobAnswer | None, lifetime: float) -> bytes:
    """The JSON of a job; its answer, perhaps megabytes, goes in as it is, without being parsed."""
    result, error = b"null", b"null"
    if answer is not None and record.status == "succeeded":
        result = _embed(answer)
    elif answer is not None and record.status == "failed":
        error = _embed(answer)
    head = job_summary(record, lifetime).model_dump_json().encode()[:-1]
    return b"".join((head, b',"result":', result, b',"error":', error, b"}"))


def _embed(answer: JobAnswer) -> bytes:
    media_type = answer.content_type.split(";")[0]
    if media_type.endswith("json"):
        return answer.content or b"null"
    if media_type.startswith("text/") or media_type.endswith("xml"):
        return to_json(answer.content.decode("utf-8", "replace"))
    # A file, such as a mesh: as base64, which keeps every byte.
    return to_json(b64encode(answer.content).decode())


def _moment(seconds: float | None) -> datetime | None:
    return None if seconds is None else datetime.fromtimestamp(seconds, UTC)
