"""Backends of commands: this process, or a service at a URL."""

from collections.abc import Iterator
from contextlib import closing, contextmanager
from typing import TYPE_CHECKING, Any, Literal, Protocol

from command_line.backends.endpoints import Endpoint
from command_line.parameters import Connection, RobotSource

if TYPE_CHECKING:
    from command_line.backends.local import LocalBackend
    from command_line.backends.remote import RemoteBackend


class Backend(Protocol):
    """Robots, and answers to requests, of this process or of a service."""

    def robot_name(self, source: RobotSource) -> str:
        """The name that requests call a robot by."""

    def robot_model(self, name: str) -> dict[str, Any]:
        """The model of a robot, as ``GET /v1/robots/{name}`` answers it."""

    def robot_names(self) -> list[dict[str, Any]]:
        """Summaries of all robots: name, whether it is built in, number of joints."""

    def keep_robot(self, document: dict[str, Any]) -> str:
        """Keep a robot under its name, which must be free; gives where."""

    def forget_robot(self, name: str) -> None:
        """Forget a robot that was kept."""

    def scenes(self) -> list[dict[str, Any]]:
        """Summaries of the stored scenes."""

    def answer(self, endpoint: Endpoint, robot: str | None, body: dict[str, Any]) -> bytes:
        """The answer to a request."""

    def equations(self, robot: str, notation: Literal["latex", "text"], axes: list[str]) -> bytes:
        """The formulas of a robot, as ``GET /v1/robots/{name}/equations`` answers them."""

    def close(self) -> None:
        """Remove what was made for this command alone."""


@contextmanager
def connect(connection: Connection) -> Iterator[Backend]:
    """The backend of a command, closed behind it.

    Args:
        connection: Address and key of a service, or none for this process.

    Raises:
        ProblemError: The address or the key of the service is malformed.
    """
    url = connection.url
    with closing(here() if url is None else at(url, connection.token)) as backend:
        yield backend


def here() -> "LocalBackend":
    """The backend of this process."""
    from command_line.backends.local import LocalBackend  # noqa: PLC0415  all of planning

    return LocalBackend()


def at(url: str, token: str | None) -> "RemoteBackend":
    """The backend of a service.

    Args:
        url: Address of the service.
        token: API key.

    Raises:
        ProblemError: The address or the key is malformed.
    """
    from command_line.backends.remote import RemoteBackend  # noqa: PLC0415  all of the client

    return RemoteBackend(url, token)
