"""Refusals of requests that would be too late, before anything of them is parsed.

Under overload most requests are refused, so a refusal must cost next to nothing: the path tells
which task a request is for, the mean duration of that task how long it takes.
"""

import json
import re
from dataclasses import dataclass

from service.http.errors import PROBLEM_MEDIA_TYPE, document, headers_of
from service.http.security_headers import SECURITY_HEADERS
from service.settings import Settings
from service.workers.faults import QueueFull
from service.workers.supervisor import WorkerSupervisor

#: A timeout, wherever in a body it stands.
_TIMEOUT = re.compile(rb'"timeout"\s*:\s*(\d+(?:\.\d+)?(?:[eE][+-]?\d+)?)')
#: The head of a request that is simple enough to be judged without a parser: POST, a body of a
#: length, nothing to be negotiated. All others take the usual way.
_REQUEST_LINE = re.compile(rb"POST (/v1/[A-Za-z0-9/_.\-]+) HTTP/1\.1\r\n")
_LENGTH = re.compile(rb"\r\ncontent-length:[ \t]*(\d{1,9})[ \t]*(?=\r\n)", re.IGNORECASE)
_NEGOTIATED = re.compile(
    rb"\r\n(transfer-encoding|expect|upgrade|prefer|connection[ \t]*:[ \t]*close)", re.IGNORECASE
)


@dataclass(frozen=True, slots=True)
class SimpleRequest:
    """A POST that arrived in one piece.

    Args:
        path: Its path.
        body: Its body.
    """

    path: str
    body: bytes


def read_simple(data: bytes) -> SimpleRequest | None:
    """The request that some bytes are, if it is simple and complete and nothing follows it."""
    line = _REQUEST_LINE.match(data)
    if line is None:
        return None
    head, mark, body = data.partition(b"\r\n\r\n")
    lengths = _LENGTH.findall(head + b"\r\n")
    if not mark or len(lengths) != 1 or int(lengths[0]) != len(body) or _NEGOTIATED.search(head):
        return None
    return SimpleRequest(line[1].decode("ascii"), body)


class Admission:
    """Admission of requests that compute: those that would be too late are refused.

    Args:
        supervisor: Of the workers.
        settings: With the timeout of a request that names none.
    """

    def __init__(self, supervisor: WorkerSupervisor, settings: Settings) -> None:
        self._supervisor = supervisor
        self._settings = settings
        self._tasks: dict[str, str] = {}

    def note(self, method: str, path: str, task: str) -> None:
        """Note which task a request was for; of POST the last part of a path is never a name."""
        if method == "POST":
            self._tasks[path.rpartition("/")[2]] = task

    def refusal(self, data: bytes, client: str) -> bytes | None:
        """The answer to a request that would be too late, in full; None for all others.

        Args:
            data: Of the request, as they arrived.
            client: Whom it is from.
        """
        if self._supervisor.expected_wait(client) <= 0.0:
            return None
        request = read_simple(data)
        if request is None:
            return None
        task = self._tasks.get(request.path.rpartition("/")[2])
        if task is None:
            return None
        seconds = named_timeout(request.body, self._settings)
        problem = self._supervisor.refusal(task, seconds, client)
        return None if problem is None else _answer(problem, request.path)


def named_timeout(content: bytes, settings: Settings) -> float:
    """Time that a body names as its timeout, the longest one where there are several [s]."""
    named = [float(match[1]) for match in _TIMEOUT.finditer(content)]
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
