"""The gate for motions that others make."""

import asyncio
import uuid
from typing import Any, cast

from fastapi import Request, Response, WebSocket, WebSocketDisconnect
from pydantic_core import to_json

from armwright_wire.plans.guard import GuardAnswer, GuardOpening, GuardRequest
from kinematics.errors import ArmwrightError
from service.access.authentication import caller_of
from service.http import answers
from service.http.compute import compute_at_once
from service.http.errors import problem_content, problem_of
from service.http.json_route import json_router
from service.storage.caches.cache_key import Reference
from service.task_references import guard as guard_task
from service.task_references import guard_message
from service.validation import ProblemError, parse_json, validate_as
from service.workers.result import SessionState

router = json_router("planning")

#: Codes of closing (RFC 6455): a policy is not kept, the service ends.
_REFUSED, _GOING = 1008, 1001
#: Time in which the first message has to come, and the longest silence after it [s].
_FIRST, _SILENCE = 10.0, 600.0


class _Session:
    """A session as the server keeps it: the arm's state between messages, which any worker answers.

    Args:
        request: Request that opened it.
        references: Robot and stored scene, as they were then.
        opening: The opening as JSON.
    """

    def __init__(
        self, request: Request, references: tuple[Reference, Reference | None], opening: bytes
    ) -> None:
        self._request, self._references, self._opening = request, references, opening
        self._state = SessionState(uuid.uuid4().hex)

    async def answer(self, message: bytes) -> bytes:
        """The answer to a message; to the opening where it is empty.

        Raises:
            ProblemError: The message is at fault, or the service has no time for it.
        """
        job = guard_message.job(*self._references, self._opening, self._state, message)
        reply = await answers.prepared_result(
            self._request, lambda: compute_at_once(self._request, job)
        )
        self._state = reply.state
        return reply.content


@router.post("/guard", summary="Prove a proposal and its stop", response_model=GuardAnswer)
async def guard(body: GuardRequest, request: Request) -> Response:
    """How much of somebody's motion is proved, at what speed, together with the stop behind it.

    Where nothing is, `accepted_until` is 0, and `stop` is that from the state itself.
    """
    return await answers.respond(request, guard_task.job, body.robot, body)


@router.websocket("/guard")
async def guard_session(socket: WebSocket) -> None:
    """A session of one arm: an opening, then proposals and changes of the scene, each answered."""
    await socket.accept()
    guarded: set[tuple[str, str]] = socket.app.state.guarded
    held: tuple[str, str] | None = None
    try:
        opening, first = _split(await _message(socket, _FIRST))
        body = validate_as(GuardOpening, opening)
        if body.arm is not None:
            wanted = caller_of(socket.scope).tenant, body.arm
            if wanted in guarded:
                raise ProblemError(
                    "CONFLICT",
                    f"another session guards the arm {body.arm!r}",
                    stage="guard",
                    hint="Close that one first.",
                )
            guarded.add(wanted)
            held = wanted
        request = cast(Request, socket)
        robot, scene = await answers.references(request, body.robot, body.scene, body)
        session = _Session(request, (cast(Reference, robot), scene), to_json(opening))
        ready = await session.answer(b"")
        await socket.send_text((await _told(session, to_json(first)) if first else ready).decode())
        while True:
            message = await _message(socket, _SILENCE)
            await socket.send_text((await _told(session, message)).decode())
    except WebSocketDisconnect:
        pass
    except (ProblemError, ArmwrightError) as error:
        await socket.send_text(_problem(error).decode())
        await socket.close(_REFUSED)
    except TimeoutError:
        await socket.close(_GOING, "nothing was proposed for too long")
    finally:
        if held is not None:
            guarded.discard(held)


async def _message(socket: WebSocket, seconds: float) -> bytes:
    """The next message, text or binary, which has to come in so many seconds.

    Raises:
        TimeoutError: It has not.
        WebSocketDisconnect: The client left.
    """
    message = await asyncio.wait_for(socket.receive(), seconds)
    if message["type"] == "websocket.disconnect":
        raise WebSocketDisconnect(message.get("code", 1005))
    text: str | None = message.get("text")
    return message["bytes"] if text is None else text.encode()


async def _told(session: _Session, message: bytes) -> bytes:
    """The answer to a message, or the problem with it: the session goes on."""
    try:
        return await session.answer(message)
    except (ProblemError, ArmwrightError) as error:
        return _problem(error)


def _split(content: bytes) -> tuple[dict[str, Any], dict[str, Any]]:
    """The first message as an opening, and as the proposal that may come with it."""
    message = parse_json(content)
    if not isinstance(message, dict):
        raise ProblemError(
            "VALIDATION_ERROR",
            "the first message is no JSON object",
            stage="request",
            hint="Send robot, scene and stop first.",
        )
    known = GuardOpening.model_fields
    step = {"state", "proposal", "latency", "scene_hash", "exact"}
    opening = {name: value for name, value in message.items() if name in known or name not in step}
    return opening, {name: value for name, value in message.items() if name not in opening}


def _problem(error: ProblemError | ArmwrightError) -> bytes:
    return problem_content(problem_of(error), "/v1/guard")
