"""Exit codes of the command, by class of error."""

from enum import IntEnum


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
