"""Answers of a service at a URL, asked through the client package."""

import hashlib
import json
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any, Literal
from urllib.parse import quote

from pydantic import ConfigDict
from rich.console import Console
from rich.status import Status

from armwright_client import (
    ApiError,
    ArmwrightError,
    Client,
    ClientOptions,
    Conflict,
    InvalidArgument,
    Pending,
    RobotUpload,
)
from armwright_client.call import Call, Sender
from armwright_client.call import path as path_of
from armwright_client.client import items
from armwright_wire.base import Body
from command_line.backends.endpoints import Endpoint
from command_line.parameters import RobotSource
from command_line.problems import CommandProblem, invalid_value, unreachable
from command_line.robot_files import is_file, robot_document


def answer_of_job(sender: Sender, call: Call[bytes], console: Console) -> bytes:
    """The answer to a request that runs as a job; whoever interrupts it here ends it there.

    Args:
        sender: Sender of the client.
        call: The request.
        console: Console that shows the stages.

    Raises:
        ArmwrightError: The service answers a problem, or not at all.
    """
    with console.status("queued") as status:
        pending = sender.postpone(call)
        try:
            _follow(pending, status)
            return pending.wait()
        except KeyboardInterrupt:
            with suppress(ArmwrightError):  # it has ended, or nobody is there to be told
                pending.cancel()
            raise


def _follow(pending: Pending[Any], status: Status) -> None:
    """Show the stages of a job until it ends or its events do; the answer is asked for anyway."""
    with suppress(ArmwrightError):
        for event in pending.events():
            job = event.job()
            status.update(job.stage or job.status)


#: Digits of a digest in the name of an uploaded robot.
_DIGITS = 16


class RemoteBackend:
    """A service at a URL.

    Args:
        url: Address of the service.
        token: API key.

    Raises:
        ProblemError: The address or the key is malformed.
    """

    def __init__(self, url: str, token: str | None) -> None:
        options: ClientOptions = {} if token is None else {"token": token}
        self._url = url
        with _problems(url):
            self._client = Client(url, **options)
        self._uploaded: list[str] = []

    def robot_name(self, source: RobotSource) -> str:
        """The name that requests call a robot by; one of a file is uploaded for this command.

        Raises:
            ProblemError: The file is malformed.
            CommandProblem: The service refuses it.
        """
        if not is_file(source):
            return source.robot
        document = robot_document(source)
        digest = hashlib.sha256(json.dumps(document, sort_keys=True).encode()).hexdigest()
        name = f"file-{digest[:_DIGITS]}"
        with _problems(self._url):
            try:
                self._client.robots.create(RobotUpload.of(**document | {"name": name}))
                self._uploaded.append(name)
            except Conflict:  # the same content is there already
                pass
        return name

    def keep_robot(self, document: dict[str, Any]) -> str:
        """Store a robot in the service; gives where.

        Raises:
            CommandProblem: The service refuses it.
        """
        with _problems(self._url):
            self._client.robots.create(RobotUpload.of(**document))
        return self._url

    def forget_robot(self, name: str) -> None:
        """Delete a robot of the service.

        Raises:
            CommandProblem: The service refuses it.
        """
        with _problems(self._url):
            self._client.robots.delete(name)

    def robot_model(self, name: str) -> dict[str, Any]:
        """The model of a robot."""
        return dict(json.loads(self._send("GET", path_of("robots", name))))

    def equations(self, robot: str, notation: Literal["latex", "text"], axes: list[str]) -> bytes:
        """The formulas of a robot."""
        rows = f"&axes={quote(','.join(axes))}" if axes else ""
        path = f"/v1/robots/{quote(robot, safe='')}/equations?format={notation}{rows}"
        return self._send("GET", path)

    def robot_names(self) -> list[dict[str, Any]]:
        """Summaries of all robots."""
        return self._pages(self._client.robots.list, "robots")

    def scenes(self) -> list[dict[str, Any]]:
        """Summaries of the stored scenes."""
        return self._pages(self._client.scenes.list, "scenes")

    def answer(self, endpoint: Endpoint, robot: str | None, body: dict[str, Any]) -> bytes:
        """The answer to a request; on a terminal long ones run as jobs, and their stages are shown.

        Args:
            endpoint: Endpoint of the request.
            robot: Name of the robot, if there is one.
            body: The request.

        Raises:
            CommandProblem: The service answers a problem, or not at all.
        """
        path = endpoint.path.format(robot=quote(robot or "", safe=""))
        console = Console(stderr=True)
        if not (endpoint.long and console.is_terminal):
            return self._send("POST", path, body)

        # A command keeps no plan that it would not keep without a terminal.
        call = _call("POST", path, {"keep": False} | body if endpoint.keepable else body)
        with _problems(self._url):
            return answer_of_job(self._client._sender, call, console)

    def projections(self, scene: dict[str, Any] | str, body: dict[str, Any]) -> bytes:
        """The projections of points onto the obstacles of a scene; that of a file is stored for it.

        Args:
            scene: Scene as the API takes it, or the name of a stored one.
            body: The request of ``POST /v1/scenes/{name}/project``.

        Raises:
            CommandProblem: The service answers a problem, or not at all.
        """
        if isinstance(scene, str):
            return self._send("POST", f"/v1/scenes/{quote(scene, safe='')}/project", body)
        digest = hashlib.sha256(json.dumps(scene, sort_keys=True).encode()).hexdigest()
        path = f"/v1/scenes/file-{digest[:_DIGITS]}"
        self._send("PUT", path, scene)
        try:
            return self._send("POST", f"{path}/project", body)
        finally:
            self._send("DELETE", path)

    def of_plan(
        self, method: str, plan_id: str, door: str, body: dict[str, Any] | None = None
    ) -> bytes:
        """The answer of one of the addresses of a kept plan.

        Args:
            method: GET or POST.
            plan_id: Id of the plan.
            door: Last part of the address: "view", "replay".
            body: The request, if there is one.

        Raises:
            CommandProblem: There is no such plan, or the service does not answer.
        """
        return self._send(method, f"/v1/plans/{quote(plan_id, safe='')}/{door}", body)

    def readiness(self) -> str:
        """The state of its workers, in words.

        Raises:
            CommandProblem: It does not answer, or is not ready.
        """
        with _problems(self._url):
            ready = self._client.readyz()
        return f"ready, {ready.workers} workers"

    def close(self) -> None:
        """Remove the robots that this command uploaded, and close the connection."""
        try:
            with _problems(self._url):
                for name in self._uploaded:
                    self._client.robots.delete(name)
        finally:
            self._client.close()

    def _send(self, method: str, path: str, body: dict[str, Any] | None = None) -> bytes:
        """The content of an answer, unread: the command prints it as the service wrote it."""
        with _problems(self._url):
            return self._client._sender.send(_call(method, path, body))

    def _pages(self, read: Any, field: str) -> list[dict[str, Any]]:
        with _problems(self._url):
            found = items(lambda after: read(after=after), lambda page: getattr(page, field))
            return [item.model_dump(mode="json") for item in found]


class _OpenRequest(Body):
    """A request of any fields: the service, not the client, says what is wrong with it."""

    model_config = ConfigDict(extra="allow")


def _call(method: str, path: str, body: dict[str, Any] | None) -> Call[bytes]:
    """A call whose answer stays as it comes."""
    request = None if body is None else _OpenRequest.model_validate(body)
    deadline = None if body is None else body.get("timeout")
    return Call(method, path, bytes, request, deadline=deadline)


@contextmanager
def _problems(url: str) -> Iterator[None]:
    """Problems of the client as problems of the command."""
    try:
        yield
    except ApiError as error:
        raise CommandProblem(error.problem.model_dump(mode="json")) from None
    except InvalidArgument as error:
        raise invalid_value("--url or --token", str(error)) from None
    except ArmwrightError as error:
        raise unreachable(
            f"{url}: {error}", "Start one with `armwright serve`, or leave --url out."
        ) from None
