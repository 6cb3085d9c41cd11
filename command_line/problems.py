"""Problems of commands: title, detail and hint for people, the problem document for programs."""

import json
import os
import re
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from enum import IntEnum
from pathlib import Path
from typing import Any

import typer
from rich.console import Console
from rich.text import Text

from command_line.interrupt import interrupted
from kinematics.errors import ArmwrightError
from service.validation import ProblemError


class ExitCode(IntEnum):
    """Exit code of a command."""

    SUCCESS = 0
    #: The question was answered, and the answer is no: in collision, not proved, not installed.
    NEGATIVE = 1
    USAGE = 2
    #: The request, the robot, the scene or a file is at fault.
    REQUEST = 3
    #: The request is right and has no solution.
    NO_SOLUTION = 4
    DEADLINE = 5
    ACCESS = 6
    #: The service can't be reached, or has no capacity now.
    UNAVAILABLE = 7
    INTERNAL = 8


#: Code of a service that does not answer; services themselves never answer it.
UNREACHABLE = "UNREACHABLE"

_CLASSES = {
    ExitCode.NO_SOLUTION: (
        "START_STATE_IN_COLLISION",
        "GOAL_IN_COLLISION",
        "START_STATE_INVALID",
        "GOAL_STATE_INVALID",
        "START_STATE_VIOLATES_PATH_CONSTRAINTS",
        "GOAL_VIOLATES_PATH_CONSTRAINTS",
        "NO_IK_SOLUTION",
        "PLANNING_FAILED",
        "INVALID_MOTION_PLAN",
    ),
    ExitCode.DEADLINE: ("TIMED_OUT", "REQUEST_TIMEOUT", "PREEMPTED"),
    ExitCode.ACCESS: ("UNAUTHENTICATED", "FORBIDDEN", "QUOTA_EXCEEDED", "HOST_NOT_ALLOWED"),
    ExitCode.UNAVAILABLE: ("OVERLOADED", "NOT_READY", "STORAGE_UNAVAILABLE", UNREACHABLE),
    ExitCode.INTERNAL: ("CRASH",),
}
_BY_CODE = {code: kind for kind, codes in _CLASSES.items() for code in codes}


def exit_code(code: str) -> ExitCode:
    """The exit code of a problem; ``REQUEST`` where no other class has it.

    Args:
        code: The kind of problem, one of those that ``GET /v1/problems`` lists.
    """
    return _BY_CODE.get(code, ExitCode.REQUEST)


#: Title of the one problem that no service answers.
_UNREACHABLE_TITLE = "The service can't be reached"
#: In place of the path of a request, in problem documents of this process.
_INSTANCE = "command line"
#: Variable of the environment that has unexpected faults end with their traceback.
_DEBUG = "ARMWRIGHT_DEBUG"
#: Hint of a request whose fields are wrong: all of them are shown.
_FIELDS_HINT = "The fields stand in docs/reference, and on the page /docs of a service."
#: Limits that a rule may make, with one.
_RULES = {"acceleration": "10 x velocity", "jerk": "10 x acceleration"}
#: Fields of requests for which commands have an option of that name.
_FIELD = re.compile(
    r"\"?\b(timeout|margin|seed|planner|base_link|tip_link|srdf|joint_limits|default_limits"
    r"|visual_solids)\b\"?(?!\.\w)"
)


class CommandProblem(Exception):
    """A problem that ends a command.

    Args:
        document: The problem document (RFC 9457).
    """

    def __init__(self, document: Mapping[str, Any]) -> None:
        super().__init__(str(document["detail"]))
        self.document = dict(document)


def unreachable(detail: str, hint: str) -> CommandProblem:
    """The problem of a service that does not answer.

    Args:
        detail: The address and what happened.
        hint: Remedy.
    """
    problem = _document(ProblemError(UNREACHABLE, detail, hint=hint))
    return CommandProblem(problem | {"title": _UNREACHABLE_TITLE, "status": 503})


def invalid_value(name: str, detail: str, hint: str | None = None) -> ProblemError:
    """The problem of an option or file that can't be read.

    Args:
        name: The option or the path; empty where the detail names it.
        detail: Description of the fault.
        hint: Remedy.
    """
    told = f"{name}: {detail}" if name else detail
    return ProblemError("VALIDATION_ERROR", told, hint=hint, stage=_INSTANCE)


@contextmanager
def shows_problems(as_json: bool) -> Iterator[None]:
    """Show a problem that ends the block, and exit with the code of its class.

    Args:
        as_json: Whether to print the problem document, on standard output.

    Raises:
        typer.Exit: The block ended with a problem.
    """
    try:
        yield
    except (typer.Exit, typer.Abort):
        raise
    except Exception as error:
        if interrupted():  # modules that are interrupted while they load end with faults of theirs
            raise KeyboardInterrupt from None
        if os.environ.get(_DEBUG):
            raise
        problem = _document(error)
        if as_json:
            sys.stdout.write(json.dumps(problem) + "\n")
        else:
            _show(problem)
        raise typer.Exit(exit_code(problem["code"])) from None


def _document(error: Exception) -> dict[str, Any]:
    from service.http.errors import document, problem_of  # noqa: PLC0415  a web framework

    if isinstance(error, CommandProblem):
        return error.document
    if isinstance(error, ArmwrightError | ProblemError):
        return document(problem_of(error), _INSTANCE)
    if isinstance(error, OSError):
        return document(_of_file(error), _INSTANCE)
    hint = f"This is a fault of Armwright. With {_DEBUG}=1 the command shows where; report that."
    detail = f"{type(error).__name__}: {error}"
    return document(ProblemError("CRASH", detail, hint=hint), _INSTANCE)


def _of_file(error: OSError) -> ProblemError:
    if error.filename is None:
        return ProblemError("INVALID_REQUEST", str(error), stage=_INSTANCE)
    if isinstance(error, FileNotFoundError):
        hint = f"Commands read paths from {Path.cwd()}."
        return invalid_value(str(error.filename), "there is no such file", hint)
    return invalid_value(str(error.filename), f"{error.strerror}")


def _show(problem: Mapping[str, Any]) -> None:
    console = Console(stderr=True, highlight=False)
    console.print(Text(f"{problem['title']} ({problem['code']})", style="bold red"))
    errors = (problem.get("details") or {}).get("errors") or []
    hint = _FIELDS_HINT if errors else _with_options(problem.get("hint"))
    if problem["code"] == "MISSING_LIMIT":
        hint = _limits_hint(problem.get("details") or {})
    for line in [f"{item['path']}: {item['problem']}" for item in errors] or [problem["detail"]]:
        console.print(Text(str(line)), soft_wrap=True)
    if hint:
        console.print(Text(f"Hint: {hint}", style="yellow"), soft_wrap=True)


def _with_options(hint: str | None) -> str | None:
    """A hint in which the options of commands stand in place of the fields of requests."""
    if hint is None:
        return None
    return _FIELD.sub(lambda found: "--" + found[1].replace("_", "-"), hint)


def _limits_hint(details: Mapping[str, Any]) -> str:
    """The hint of a limit that is not known, in options of commands."""
    quantity = details.get("quantity", "acceleration")
    joint = next(iter(details.get("joints") or ()), "*")
    single = f'--joint-limits FILE with {{"{joint}": {{"{quantity}": ...}}}}'
    rule = _RULES.get(quantity)
    every = f'--default-limits "{quantity}={rule}", or ' if rule else ""
    return (
        f"Give it with the file of the robot: {every}{single}. "
        "A stored robot gets it when it is created."
    )


def negative() -> typer.Exit:
    """The end of a command that answered no."""
    return typer.Exit(ExitCode.NEGATIVE)
