"""A session of the gate as the server keeps it: the arm's state between messages."""

from fastapi import Request

from armwright_wire.plans.guard import GuardOpening
from service.endpoints.guard.state import SessionState
from service.http import answers
from service.storage.caches.cache_key import Reference
from service.task_references import guard_message


class GuardSession:
    """A session; any worker may answer its messages.

    Args:
        request: Request that opened it.
        references: Robot and stored scene, as they were then.
        opening: The opening as JSON.
        identity: Name of the session.
    """

    def __init__(
        self,
        request: Request,
        references: tuple[Reference, Reference | None],
        opening: bytes,
        identity: str,
    ) -> None:
        self._request, self._references, self._opening = request, references, opening
        self._state = SessionState(identity)

    @classmethod
    async def open(
        cls, request: Request, body: GuardOpening, opening: bytes, identity: str
    ) -> "GuardSession":
        """A session about the robot and the scene of an opening.

        Raises:
            ProblemError: NOT_FOUND.
        """
        found = await answers.references(request, body.robot, body.scene, body)
        return cls(request, found, opening, identity)

    async def answer(self, message: bytes) -> bytes:
        """The answer to a message; to the opening where it is empty.

        Raises:
            ProblemError: The message is at fault, or the service has no time for it.
        """
        job = guard_message.job(*self._references, self._opening, self._state, message)
        reply = await answers.result_at_once(self._request, job)
        self._state = reply.state
        return reply.content
