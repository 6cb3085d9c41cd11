"""A request that a file holds, with what the options of a command say in addition."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from command_line.backends.backend import connect
from command_line.backends.endpoints import Endpoint
from command_line.output import print_json, save
from command_line.parameters import Connection, Request, RobotSource
from command_line.robot_files import read_json


@dataclass(frozen=True)
class FileRequest:
    """A request whose body is a file's, overridden by further fields and by options.

    Args:
        endpoint: Endpoint of the request.
        file: A JSON object.
        options: Fields that the options of the command give; None leaves a field as it is.
    """

    endpoint: Endpoint
    file: Path
    options: Mapping[str, Any]

    def answer(
        self, connection: Connection, robot: RobotSource, request: Request
    ) -> dict[str, Any] | None:
        """The answer, saved where the command says so; None if it was printed as JSON."""
        body = read_json(self.file) | ({} if request.fields is None else read_json(request.fields))
        body |= {name: value for name, value in self.options.items() if value is not None}
        with connect(connection) as backend:
            body["robot"] = backend.robot_name(robot)
            answer = backend.answer(self.endpoint, body["robot"], body)
        if request.output is not None:
            save(request.output, answer)
        if connection.as_json:
            print_json(answer)
            return None
        told: dict[str, Any] = json.loads(answer)
        return told
