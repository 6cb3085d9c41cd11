"""Connections: how many there are, how long a request's head may take, and what is no HTTP."""

import asyncio
import json
import resource
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, cast

from starlette.types import Receive, Scope, Send
from uvicorn.protocols.http.httptools_impl import STATUS_LINE

from service.http.admission import Admission, SimpleRequest, read_simple
from service.http.body_limit import ARRIVAL
from service.http.departure import DEPARTURE, Departure
from service.http.errors import PROBLEM_MEDIA_TYPE, document, status_of
from service.http.joined_writes import JoinedWrites
from service.http.known_heads import KNOWN_HEADS, KnownHead
from service.http.plain_requests import PlainRequests
from service.http.request_parser import MalformedRequestError, RequestParser
from service.http.security_headers import SECURITY_HEADERS
from service.problem import ProblemError

#: Descriptors that are left for the storage, the workers and files.
_RESERVED_DESCRIPTORS = 128
#: Time in which the rest of a short body is waited for [s]; after it the parser takes over.
_REST_TIME = 0.05
#: What comes while a request waits for its turn or its answer is held up to this, then no more is
#: read [byte].
_HELD_BYTES = 64 * 1024
#: Answers up to this are copied behind their heads; longer ones follow them [byte].
_JOINED_BYTES = 256 * 1024
_REASONS = {400: b"Bad Request", 408: b"Request Timeout", 503: b"Service Unavailable"}


@dataclass(frozen=True, slots=True)
class ConnectionLimits:
    """Limits of connections.

    Args:
        count: Connections that may be open at the same time.
        head_timeout: Time in which the head of a request must arrive [s].
    """

    count: int
    head_timeout: float


def possible_connections(wanted: int) -> int:
    """The connections that the system's limit of descriptors leaves room for, at most `wanted`.

    The limit is raised as far as the system allows it.
    """
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if hard != resource.RLIM_INFINITY and soft < hard:
        resource.setrlimit(resource.RLIMIT_NOFILE, (hard, hard))
        soft = hard
    return max(1, min(wanted, soft - _RESERVED_DESCRIPTORS))


def connection_class(limits: ConnectionLimits) -> Callable[..., "Connection"]:
    """The function that makes a protocol for each connection, as uvicorn calls it."""

    def make(**arguments: Any) -> Connection:
        return Connection(limits, **arguments)

    return make


class Connection(RequestParser):
    """A connection of a client, refused in problem documents.

    Args:
        limits: Of connections.
        arguments: Of uvicorn.
    """

    def __init__(self, limits: ConnectionLimits, **arguments: Any) -> None:
        super().__init__(**arguments)
        self._limits = limits
        self._application, self.app = self.app, self._answer
        self._arrival: float | None = None
        self._head_timer: asyncio.TimerHandle | None = None
        self._held: bytes | None = None
        self._fault: str | None = None
        self._begun = b""
        self._rest_timer: asyncio.TimerHandle | None = None
        self._departure = Departure()

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Begin to wait for a request, or refuse the connection where there are too many."""
        # Of any event loop: those of uvloop look like asyncio's, but don't descend from them.
        self._joined = JoinedWrites(cast(asyncio.Transport, transport))
        super().connection_made(self._joined)
        if len(self.connections) > self._limits.count:
            self._refuse(
                ProblemError(
                    "OVERLOADED",
                    "too many connections are open",
                    stage="connection",
                    hint="Ask again after the time in Retry-After.",
                    status=503,
                    retry_after=1,
                )
            )
            return
        if (admission := self._admission) is not None:
            admission.intake.note_connection()
        self._watch_head()

    def connection_lost(self, exc: Exception | None) -> None:
        """Forget the connection."""
        self._stop_timer()
        self._stop_rest_timer()
        self._end_request()
        super().connection_lost(exc)
        self._departure.come()

    def data_received(self, data: bytes) -> None:
        """Take what arrived; a head that has begun must end in time."""
        if self.transport.is_closing():
            return
        data, self._begun = self._begun + data, b""
        if not self._refuse_early(data):
            self._pass_on(data)

    @property
    def _is_idle(self) -> bool:
        """Whether nothing of a request has been passed on that was not answered."""
        return self._expects_head and not self._has_begun

    def _wait_for_rest(self, data: bytes) -> None:
        """Wait for the rest of a request, but not longer because some more of it comes."""
        self._begun = data
        self._unset_keepalive_if_required()
        if self._rest_timer is None:
            self._rest_timer = self.loop.call_later(_REST_TIME, self._stop_waiting)

    def _pass_on(self, data: bytes) -> None:
        self._stop_rest_timer()
        self._unset_keepalive_if_required()
        try:
            rest = self._parse(data)
        except MalformedRequestError as error:
            self.logger.warning("Invalid HTTP request received.")
            self._refuse_in_turn(str(error))
            return
        if rest:
            self._keep(rest)
        self._watch_head()

    def _keep(self, data: bytes) -> None:
        """Hold what has to wait, and have no more of it read than fits."""
        self._held = (self._held or b"") + data
        if len(self._held) > _HELD_BYTES:
            self.flow.pause_reading()

    def _refuse_in_turn(self, fault: str) -> None:
        """Refuse what is no HTTP, once all before it is answered."""
        self._stop_timer()
        if self._drop_broken():
            self._fault = fault
            self._held = b""
        else:
            self.send_400_response(fault)

    def _take_turn(self, data: bytes, known: KnownHead | None, admission: Admission) -> None:
        """Have a whole request read in its turn, and hold what comes meanwhile."""
        self._hold()
        # The time of a request begins now, not with its turn.
        admission.intake.take(partial(self._begin, data, known, time.monotonic()))

    def _hold(self) -> None:
        self._unset_keepalive_if_required()
        self._stop_timer()
        self._stop_rest_timer()
        self._held = b""

    def _release(self) -> bytes:
        held, self._held = self._held or b"", None
        self.flow.resume_reading()
        return held

    def _begin(self, data: bytes, known: KnownHead | None, arrival: float) -> None:
        held = self._release()
        if not self.transport.is_closing():
            self._arrival = arrival
            if known is not None:
                self._take_known(known, data[-known.length :])
            else:
                self._pass_on(data)
                self._remember_head(data)
            if held:
                self.data_received(held)

    def _remember_head(self, data: bytes) -> None:
        """Remember the head of a simple request that was parsed, and found to be whole."""
        cycle = self.cycle
        if self._fault is not None or self.transport.is_closing() or cycle is None:
            return
        head, _, body = data.partition(b"\r\n\r\n")
        scope: Any = cycle.scope
        is_whole = not (cycle.more_body or self._is_in_body) and len(cycle.body) == len(body) > 0
        if is_whole and (scope["method"], scope["http_version"]) == ("POST", "1.1"):
            KNOWN_HEADS.note(head, self.url, scope, len(body), keep_alive=cycle.keep_alive)

    async def _answer(self, scope: Scope, receive: Receive, send: Send) -> None:
        """The application, told when a request came that had to wait for its turn."""
        scope[DEPARTURE] = self._departure
        arrival, self._arrival = self._arrival, None
        if arrival is not None:
            scope[ARRIVAL] = arrival
            if (plain := self._plain_requests) is not None:
                route = plain.route(scope)
                active = self._active
                if route is not None and active is not None and not active.more_body:
                    content = bytes(active.body)
                    await plain.answer(route, content, self, scope, receive, send)
                    return
        await self._application(scope, receive, send)

    def write_answer(self, head: bytes, content: bytes) -> bool:
        """Write an answer of status 200, unless something is in the way; see `Writer`."""
        active = self._active
        if active is None or active.disconnected or not active.keep_alive or active.access_log:
            return False
        if self.flow.write_paused or active.response_started:
            return False
        first = STATUS_LINE[200] + b"".join(b"%b: %b\r\n" % f for f in active.default_headers)
        # As uvicorn does it when all has been sent.
        active.response_started = active.response_complete = True
        active.message_event.set()
        if len(content) <= _JOINED_BYTES:
            self._joined.write_whole(first + head + content)
        else:
            self._joined.write(first + head)
            self._joined.write(content)
        active.on_response()
        return True

    def _stop_rest_timer(self) -> None:
        if self._rest_timer is not None:
            self._rest_timer.cancel()
            self._rest_timer = None

    def _stop_waiting(self) -> None:
        """Have a request read whose rest does not come."""
        begun, self._begun = self._begun, b""
        if not self.transport.is_closing():
            self._pass_on(begun)

    def on_response_complete(self) -> None:
        """Wait for the next request; until something of it arrives, uvicorn's own timer runs."""
        self._end_request()
        super().on_response_complete()
        if self._is_unanswered or self.transport.is_closing():
            return
        if self._fault is not None:
            self.send_400_response(self._fault)
            return
        if held := self._release():
            self.data_received(held)
        elif self._has_begun:
            self._unset_keepalive_if_required()
            self._watch_head()

    @property
    def _plain_requests(self) -> PlainRequests | None:
        plain: PlainRequests | None = getattr(
            getattr(self.config.app, "state", None), "plain_requests", None
        )
        return plain

    @property
    def _admission(self) -> Admission | None:
        admission: Admission | None = getattr(
            getattr(self.config.app, "state", None), "admission", None
        )
        return admission

    def _end_request(self) -> None:
        if (admission := self._admission) is not None:
            admission.forget(self)

    def _refuse_early(self, data: bytes) -> bool:
        """Refuse a request that would be too late, before it is parsed.

        Returns:
            Whether that was done, or the request waits for its rest or its turn.
        """
        if self._held is not None or self._is_unanswered:
            self._keep(data)
            return True
        admission = self._admission
        if admission is None or not self._is_idle or self._limits.count < len(self.connections):
            return False
        head, _, body = data.partition(b"\r\n\r\n")
        known = KNOWN_HEADS.find(head) if self.limit_concurrency is None else None
        if known is not None and known.length == len(body):
            request: SimpleRequest | None = SimpleRequest(known.path, body)
        else:
            known, request = None, read_simple(data)
        if request is None:
            return False
        if request.missing:
            if not admission.wants_rest(request):
                return False
            self._wait_for_rest(data)
            return True
        client = "" if self.client is None else self.client[0]
        content = admission.refusal(request, client, self)
        if content is None:
            self._take_turn(data, known, admission)
            return True
        self._hold()
        admission.refusals.add(partial(self._answer_early, content))
        return True

    def _answer_early(self, content: bytes) -> None:
        data = self._release()
        if self.transport.is_closing():
            return
        self._joined.write_whole(content)
        if data:
            self.data_received(data)
        else:
            self.timeout_keep_alive_task = self.loop.call_later(
                self.timeout_keep_alive, self.timeout_keep_alive_handler
            )

    def send_400_response(self, msg: str) -> None:
        """Refuse what is no HTTP."""
        self._refuse(
            ProblemError(
                "INVALID_REQUEST",
                msg,
                stage="connection",
                hint="The request must follow HTTP/1.1 (RFC 9112).",
                status=400,
            )
        )

    def _watch_head(self) -> None:
        if not self._expects_head or self.transport.is_closing():
            self._stop_timer()
        elif self._head_timer is None:
            self._head_timer = self.loop.call_later(self._limits.head_timeout, self._head_is_late)

    def _stop_timer(self) -> None:
        if self._head_timer is not None:
            self._head_timer.cancel()
            self._head_timer = None

    def _head_is_late(self) -> None:
        self._head_timer = None
        if not self.transport.is_closing() and self._expects_head:
            seconds = self._limits.head_timeout
            self._refuse(
                ProblemError(
                    "REQUEST_TIMEOUT",
                    f"the head of a request did not arrive within {seconds:g} s",
                    stage="connection",
                )
            )

    def _refuse(self, problem: ProblemError) -> None:
        """Answer a problem in place of a request that never came, and close."""
        self._stop_timer()
        self._unset_keepalive_if_required()
        content = json.dumps(document(problem, "")).encode()
        status = status_of(problem)
        headers = {
            **SECURITY_HEADERS,
            "Content-Type": PROBLEM_MEDIA_TYPE,
            "Content-Length": str(len(content)),
            "Connection": "close",
        }
        if problem.retry_after is not None:
            headers["Retry-After"] = str(problem.retry_after)
        lines = [f"HTTP/1.1 {status} ".encode() + _REASONS[status]]
        lines += [f"{name}: {value}".encode() for name, value in headers.items()]
        active = self._active
        is_between = active is None or (active.response_complete and not self._is_in_body)
        if is_between or (active is not None and not active.response_started):
            self.transport.write(b"\r\n".join([*lines, b"", content]))
        self.transport.close()
