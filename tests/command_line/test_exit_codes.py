from command_line.exit_codes import UNREACHABLE, ExitCode, exit_code
from service.http.errors import KINDS


def test_every_kind_of_problem_has_the_exit_code_of_its_class() -> None:
    classes = {code: int(exit_code(code)) for code in KINDS}
    assert classes["VALIDATION_ERROR"] == classes["NOT_FOUND"] == 3
    assert classes["PLANNING_FAILED"] == classes["NO_IK_SOLUTION"] == 4
    assert classes["TIMED_OUT"] == 5
    assert classes["UNAUTHENTICATED"] == classes["FORBIDDEN"] == 6
    assert classes["OVERLOADED"] == int(exit_code(UNREACHABLE)) == 7
    assert classes["CRASH"] == 8


def test_problems_that_another_attempt_may_solve_are_told_from_faults() -> None:
    unavailable = {code for code in KINDS if exit_code(code) is ExitCode.UNAVAILABLE}
    assert unavailable == {"OVERLOADED", "NOT_READY", "STORAGE_UNAVAILABLE"}
