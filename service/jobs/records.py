"""Records and answers of jobs that this package makes itself."""

import dataclasses
import json
import secrets
import time

from service.access.caller import Caller
from service.http.errors import PROBLEM_MEDIA_TYPE, document
from service.problem import ProblemError
from service.storage.stores.job_store import JobAnswer, JobRecord, StoredRequest

#: Servers that may die while they work on a job: after that, it may be what kills them.
MAX_ATTEMPTS = 2


def new_record(request: StoredRequest, caller: Caller) -> JobRecord:
    """The record of a new job of a caller, which waits."""
    # Twelve digits of time let later jobs sort after earlier ones; the rest can't be guessed.
    now = time.time()
    job_id = f"{int(1000 * now):012x}{secrets.token_hex(10)}"
    return JobRecord(
        job_id,
        request.method,
        request.path,
        "queued",
        created=now,
        tenant=caller.tenant,
        api_key=caller.api_key,
    )


def problem_answer(problem: ProblemError, instance: str) -> JobAnswer:
    """The answer of a job that failed: the problem of a request to the path `instance`."""
    content = json.dumps(document(problem, instance), ensure_ascii=False, allow_nan=False)
    return JobAnswer(PROBLEM_MEDIA_TYPE, content.encode())


def next_attempt(record: JobRecord) -> JobRecord:
    """The record of a job that waits again, since the server died that worked on it."""
    return dataclasses.replace(
        record,
        status="queued",
        progress=0.0,
        stage=None,
        started=None,
        attempt=record.attempt + 1,
    )


def lost_job() -> ProblemError:
    """The problem of a job that ran each time that a server died."""
    return ProblemError(
        "CRASH",
        f"the service died {MAX_ATTEMPTS} times while it was working on this job",
        stage="job",
        hint="Send the request again: nothing of it was kept.",
    )


def overdue_job(seconds: float) -> ProblemError:
    """The problem of a job that did not end within the time that a job may take [s]."""
    return ProblemError(
        "TIMED_OUT",
        f"the job did not end within {seconds:g} s",
        stage="job",
        hint="Ask for less at once, or raise ARMWRIGHT_JOB_DEADLINE where the service is run.",
    )
