"""Second look at kept answers that state a proof, by other code, at a share of the time."""

import logging
import time
from collections.abc import Mapping
from typing import Any

from fastapi import Request
from pydantic_core import from_json, to_json
from starlette.concurrency import run_in_threadpool

from kinematics.errors import ArmwrightError
from service.http import answers
from service.http.metrics import Metrics
from service.http.state import repository_of, settings_of
from service.task_references import audit as audit_task
from service.validation import ProblemError

#: What looks may take of the time of the answers.
_SHARE = 0.05
#: Operations whose answers are looked at.
_PATHS = ("/v1/plan", "/v1/validate", "/v1/tasks")
_LISTED = 10
_log = logging.getLogger(__name__)


class AuditAccount:
    """Time that looks may take: what answers took earns a share of it, looks spend it."""

    def __init__(self) -> None:
        self._balance = 0.0

    def earn(self, seconds: float) -> bool:
        """Earn the share of an answer's time [s]; whether a look is due."""
        self._balance += _SHARE * seconds
        return self._balance >= 0.0

    def spend(self, seconds: float) -> None:
        """Spend time [s]; the first look may take more than there is, later ones pay it back."""
        self._balance -= seconds


async def check_answer(request: Request, content: bytes, seconds: float) -> None:
    """Look once more at an answer that is to be kept, where it states a proof and a look is due.

    Args:
        request: Request that it answers.
        content: The answer, JSON.
        seconds: Time that it took [s].

    Raises:
        ProblemError: CERTIFICATE_DISPUTED: the other code does not agree.
    """
    path = request.url.path
    account: AuditAccount = request.app.state.audit_account
    metrics: Metrics = request.app.state.metrics
    if path not in _PATHS or settings_of(request).audit == "off" or not account.earn(seconds):
        return
    answer = from_json(content)
    if not answer.get("certificate", answer).get("verified", True):
        return
    begun = time.monotonic()
    try:
        found = await _look(request, from_json(await request.body()), answer)
    # The time is up, say, or the form is one that is not read: the answer stands as without a look.
    except (ProblemError, ArmwrightError) as problem:
        metrics.count_audit("left out")
        _log.info("a certified answer was not looked at again: %s", problem)
        return
    finally:
        account.spend(time.monotonic() - begun)
    if isinstance(found, str):
        metrics.count_audit("left out")
    elif not found:
        metrics.count_audit("agreed")
    else:
        metrics.count_audit("disputed")
        raise _dispute(found)


async def _look(
    request: Request, body: Mapping[str, Any], answer: Mapping[str, Any]
) -> list[dict[str, Any]] | str:
    content = to_json({"request": body, "answer": answer}, inf_nan_mode="null")
    repository = repository_of(request)
    source = body.get("scene")
    stored = None
    if isinstance(source, str):
        reference = await answers.scene(request, source)
        stored = (await run_in_threadpool(repository.document, reference))[1]
    documents = (await answers.robot_document(request, body["robot"]), stored)
    return await answers.answer(
        request,
        lambda robot, scene: audit_task.job(robot, scene, content, documents),
        body["robot"],
        source if isinstance(source, str) else None,
        timeout=body.get("timeout"),
    )


def _dispute(found: list[dict[str, Any]]) -> ProblemError:
    first = found[0]
    about = first.get("link") or first.get("body") or " and ".join(first.get("pair", ()))
    return ProblemError(
        "CERTIFICATE_DISPUTED",
        f"a second look by other code does not agree with the proof: {first['kind']} of {about}",
        stage="audit",
        disagreements=found[:_LISTED],
    )
