"""Refusals of requests that would be too late, before anything of them is parsed.

Under overload most requests are refused, so a refusal must cost next to nothing: the path tells
which task a request is for, the mean duration of that task how long it takes.
"""

import json
import re
from typing import NamedTuple

from service.http.errors import PROBLEM_MEDIA_TYPE, document, headers_of
from service.http.intake import Intake
from service.http.refusals import Refusals
from service.http.security_headers import SECURITY_HEADERS
from service.settings import Settings
from service.workers.faults import QueueFull
from service.workers.supervisor import WorkerSupervisor

#: A timeout, wherever in a body it stands. The pattern is tried where its name was found, from the
#: end on: to look for it from the beginning takes twice as long, for the pattern thrice.
_TIMEOUT_NAME = b'"timeout"'
_TIMEOUT = re.compile(rb'"timeout"\s*:\s*(\d+(?:\.\d+)?(?:[eE][+-]?\d+)?)')
#: The head of a request that is simple enough to be judged without a parser: POST, a body of a
#: length, nothing to be negotiated. All others take the usual way.
_REQUEST_LINE = re.compile(rb"POST (/v1/[A-Za-z0-9/_.\-]+) HTTP/1\.1\r\n")
_LENGTH = re.compile(rb"\r\ncontent-length:[ \t]*(\d{1,9})[ \t]*(?=\r\n)", re.IGNORECASE)
_NEGOTIATED = re.compile(
    rb"\r\n(transfer-encoding|expect|upgrade|prefer|connection[ \t]*:[ \t]*close)", re.IGNORECASE
)


#: Refusals that are kept as they are sent: most of a crowd get the same.
_KEPT_ANSWERS = 256
#: Bodies up to this size are waited for, where they may be refused before they are parsed [byte].
_AWAITED_BYTES = 64 * 1024


class SimpleRequest(NamedTuple):
    """A POST whose head has arrived.

    Attributes:
        path: its path.
        body: what has arrived of its body.
        missing: bytes of its body that are still to come.
    """

    path: str
    body: bytes
    missing: int = 0


def read_simple(data: bytes) -> SimpleRequest | None:
    """The request that some bytes are, if it is simple and nothing follows it."""
    line = _REQUEST_LINE.match(data)
    if line is None:
        return None
    head, mark, body = data.partition(b"\r\n\r\n")
    lengths = _LENGTH.findall(head + b"\r\n")
    if not mark or len(lengths) != 1 or _NEGOTIATED.search(head):
        return None
    missing = int(lengths[0]) - len(body)
    return None if missing < 0 else SimpleRequest(line[1].decode("ascii"), body, missing)


class Admission:
    """Admission of requests that compute: those that would be too late are refused.

    Args:
        supervisor: Of the workers.
        settings: With the timeout of a request that names none.

    Attributes:
        intake: where requests that were let in wait for their turn to be parsed.
        refusals: answers to those that were not.
    """

    def __init__(self, supervisor: WorkerSupervisor, settings: Settings) -> None:
        self._supervisor = supervisor
        self._settings = settings
        self.intake = Intake()
        self.refusals = Refusals()
        self._tasks: dict[str, str] = {}
        self._answers: dict[tuple[str, int | None, str], bytes] = {}

    def note(self, method: str, path: str, task: str) -> None:
        """Note which task a request was for; of POST the last part of a path is never a name."""
        if method == "POST":
            self._tasks[path.rpartition("/")[2]] = task

    def wants_rest(self, request: SimpleRequest) -> bool:
        """Whether a request may be refused once the rest of its short body is there."""
        is_short = 0 < request.missing <= _AWAITED_BYTES - len(request.body)
        return is_short and self._supervisor.has_work and self._task(request) is not None

    def refusal(self, request: SimpleRequest, client: str, carrier: object) -> bytes | None:
        """The answer to a request that would be too late, in full; None for all others.

        Args:
            request: All of it has arrived.
            client: Whom it is from.
            carrier: What carries it, and says by `forget` when it was answered.
        """
        task = self._task(request)
        if task is None:
            return None
        if not self._supervisor.is_free:
            seconds = named_timeout(request.body, self._settings)
            problem = self._supervisor.early_refusal(task, seconds, client, len(request.body))
            if problem is not None:
                return self._answer(problem, request.path)
        self._supervisor.coming.note(carrier, task, client)
        return None

    def forget(self, carrier: object) -> None:
        """Note that the request of a carrier, if there is one, was answered or given up."""
        self._supervisor.coming.forget(carrier)

    def _answer(self, problem: QueueFull, path: str) -> bytes:
        key = problem.detail, problem.retry_after, path
        answer = self._answers.get(key)
        if answer is None:
            if len(self._answers) >= _KEPT_ANSWERS:
                self._answers.clear()
            answer = self._answers[key] = _answer(problem, path)
        return answer

    def _task(self, request: SimpleRequest) -> str | None:
        return self._tasks.get(request.path.rpartition("/")[2])


def named_timeout(content: bytes, settings: Settings) -> float:
    """Time that a body names as its timeout, the longest one where there are several [s]."""
    named, place = list[float](), len(content)
    while (place := content.rfind(_TIMEOUT_NAME, 0, place)) >= 0:
        match = _TIMEOUT.match(content, place)
        if match is not None:
            named.append(float(match[1]))
    return min(max(named, default=settings.default_timeout), settings.max_timeout)


def _answer(problem: QueueFull, path: str) -> bytes:
    content = json.dumps(document(problem, path)).encode()
    headers = {
        **SECURITY_HEADERS,
        **headers_of(problem),
        "Content-Type": PROBLEM_MEDIA_TYPE,
        "Content-Length": str(len(content)),
    }
    lines = [b"HTTP/1.1 429 Too Many Requests"]
    lines += [f"{name}: {value}".encode() for name, value in headers.items()]
    return b"\r\n".join([*lines, b"", content])
